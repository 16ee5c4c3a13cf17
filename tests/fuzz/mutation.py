"""Ways to spoil a file: its bytes, its lines and words, its numbers, and what lies in a container."""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
from collections.abc import Callable, Sequence
from typing import Any

NASTY = (
    *b"0 -0 1 -1 2 255 256 65535 2147483647 -2147483648 4294967295 9223372036854775807 99999999999999999999 "
    b"1e308 -1e309 1e-400 1e15 1.0000000000000000000000000001 nan inf -inf NaN(1) 1,5 1_0 0x10 1e 1e+ . - + "
    b"1.2.3 --1 +-1 { } [ ] \" ' # // \\ , ; : |".split(),
    *(b"\0", b"\xff", b"\x1a", b"\r", b"\n", b"\t", b" ", "٣".encode(), "\u2028".encode(), "\u00a0".encode()),
)


def mutate(rng: random.Random, data: bytes, words: Sequence[bytes] = (), other: bytes = b"") -> bytes:
    """One to eight changes of bytes, words and lines; `words` are the format's own, `other` a second file."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5, 8))):
        data = rng.choice(_CHANGES)(rng, data, (*words, *NASTY), other)
    return data


def _flip(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    if not data:
        return rng.choice(words)
    at = rng.randrange(len(data))
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


def _cut(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    start, stop = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return rng.choice((data[:start], data[start:], data[:start] + data[min(stop, start + 40) :]))


def _insert(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((b"", b" ", b"\n")) + rng.choice(words) + data[at:]


def _pieces(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    """Change words or lines: drop, repeat, swap, or put another in their place."""
    pattern = rng.choice((rb"\s+", rb"\n", rb"(?<=[{}\[\],:=])"))
    pieces = re.split(b"(" + pattern + b")", data)
    i, j = rng.randrange(len(pieces)), rng.randrange(len(pieces))
    kind = rng.randrange(5)
    if kind == 0:
        del pieces[i]
    elif kind == 1:
        pieces.insert(i, pieces[j])
    elif kind == 2:
        pieces[i], pieces[j] = pieces[j], pieces[i]
    elif kind == 3:
        pieces[i] = rng.choice(words)
    else:
        pieces[i] = pieces[i] * rng.choice((2, 3, 50))
    return b"".join(pieces)


def _number(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    found = list(re.finditer(rb"-?\d+(\.\d*)?", data))
    if not found:
        return _flip(rng, data, words, other)
    match = rng.choice(found)
    nearby = str(int(float(match[0][:9])) + rng.choice((-1, 1))).encode()
    return data[: match.start()] + rng.choice((nearby, rng.choice(NASTY))) + data[match.end() :]


def _integer(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    """Overwrite four or eight bytes by a little-endian number."""
    value = rng.choice((0, 1, 2, 3, 7, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1, rng.randrange(2**32)))
    new = struct.pack(rng.choice(("<I", "<Q")), value)
    at = rng.randrange(max(len(data) - len(new), 0) + 1) & rng.choice((~0, ~3))
    return data[:at] + new + data[at + len(new) :]


def _splice(rng: random.Random, data: bytes, words: Sequence[bytes], other: bytes) -> bytes:
    at, start = rng.randrange(len(data) + 1), rng.randrange(len(other) + 1)
    return data[:at] + other[start : start + rng.choice((10, 100, 1000))]


Change = Callable[[random.Random, bytes, Sequence[bytes], bytes], bytes]
_CHANGES: tuple[Change, ...] = (_flip, _cut, _insert, _pieces, _pieces, _number, _number, _integer, _splice)


# Containers: what is inside is spoiled, what holds it together stays right.


def mutate_json(rng: random.Random, value: Any) -> Any:
    """A JSON value with one place changed: dropped, repeated, or replaced by something of another kind."""
    odd: list[Any] = [None, True, 0, -1, 1.5, 2**31, 2**63, 1e308, "", "x", [], {}, [[]], [0], {"a": 0}]
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        if rng.random() < 0.1:
            return {k: v for k, v in value.items() if k != key}
        if rng.random() < 0.05:
            return {**value, rng.choice(("x", "", "name")): rng.choice(odd)}
        return {**value, key: mutate_json(rng, value[key])}
    if isinstance(value, list) and value and rng.random() < 0.9:
        at = rng.randrange(len(value))
        if rng.random() < 0.15:
            return value[:at] + value[at + 1 :] * rng.choice((1, 1, 3))
        return [*value[:at], mutate_json(rng, value[at]), *value[at + 1 :]]
    if isinstance(value, (int, float)) and not isinstance(value, bool) and rng.random() < 0.6:
        return rng.choice((value + 1, value - 1, -value, value * 2, value * 1e9, value * 65536, float(value)))
    return rng.choice(odd)


def in_json(rng: random.Random, data: bytes) -> bytes:
    """A JSON file with one value changed."""
    try:
        return json.dumps(mutate_json(rng, json.loads(data))).encode()
    except (ValueError, RecursionError, OverflowError):
        return data


def in_glb(rng: random.Random, data: bytes) -> bytes:
    """A binary glTF with one value of its JSON, or bytes of its buffer, changed; lengths are right."""
    try:
        length = struct.unpack_from("<I", data, 12)[0]
        text, rest = data[20 : 20 + length], data[20 + length :]
        text = in_json(rng, text) if rng.random() < 0.8 else text
        body = rest[8:]
        if rng.random() < 0.3:
            body = mutate(rng, body)
        text += b" " * (-len(text) % 4)
        body += b"\0" * (-len(body) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if rest:
            chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
    except struct.error:
        return data


def in_zip(rng: random.Random, data: bytes) -> bytes:
    """An archive with one member changed, dropped or renamed; checksums are right."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()[:50]}
    except Exception:  # no archive any more, in one of many ways
        return data
    if members:
        name = rng.choice(list(members))
        body = members[name]
        kind = rng.random()
        if kind < 0.1:
            del members[name]
        elif kind < 0.2:
            members[rng.choice(list(members)) if rng.random() < 0.5 else "x.npy"] = body
        elif kind < 0.6 and body[:6] == b"\x93NUMPY":
            stop = 10 + int.from_bytes(body[8:10], "little")
            members[name] = body[:10] + mutate(rng, body[10:stop])[: stop - 10].ljust(stop - 10) + body[stop:]
        else:
            members[name] = mutate(rng, body)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, body in members.items():
            archive.writestr(name, body)
    return out.getvalue()


def in_container(rng: random.Random, data: bytes) -> bytes:
    """A file of named arrays with its metadata, its table or its arrays changed; the checksum is right."""
    from .documents import sealed

    try:
        length = int.from_bytes(data[:8], "little")
        table, body = json.loads(data[8 : 8 + length]), data[8 + length :]
        inner = json.loads(table["__metadata__"]["metadata"])
        kind = rng.random()
        if kind < 0.5:
            inner = mutate_json(rng, inner)
        elif kind < 0.8:
            rest = mutate_json(rng, {k: v for k, v in table.items() if k != "__metadata__"})
            table = {"__metadata__": table["__metadata__"], **rest}
        else:
            at = rng.randrange(len(body) + 1)
            body = body[:at] + mutate(rng, body[at : at + 64])[: len(body[at : at + 64])] + body[at + 64 :]
        table["__metadata__"]["metadata"] = json.dumps(inner)
        return sealed(json.dumps(table, separators=(",", ":")).encode(), body)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return data
