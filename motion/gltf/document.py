"""What a glTF file holds, before anything is made of it: its JSON with checked access, and its buffers."""

from __future__ import annotations

import base64
import binascii
import functools
import json
import os
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from .. import digits, files, text
from ..errors import UserError

Bytes = NDArray[np.uint8]

_GLB, _JSON, _BIN = b"glTF", b"JSON", b"BIN\0"
_DATA_URI = re.compile(r"data:[^,]*;base64,", re.IGNORECASE)
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


@dataclass(eq=False)
class Document:
    """A glTF file: its JSON, and its buffers, which are read when asked for."""

    path: Path
    root: Item = field(init=False)
    json: Mapping[str, Any]
    binary: Bytes | None
    _decoded: dict[int, Bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.root = Item(self, "", self.json)
        self._lists: dict[str, list[Item]] = {}

    def items(self, kind: str) -> list[Item]:
        """The objects of a list at the top, such as ``nodes``; none where the file has no such list."""
        if kind not in self._lists:
            self._lists[kind] = self.root.items(kind)
        return self._lists[kind]

    def buffer(self, index: int) -> Bytes:
        """Bytes of a buffer; memory-mapped where it is a file, which may change between two calls."""
        item = self.items("buffers")[index]
        length = item.integer("byteLength", least=1)
        data = self._decoded.get(index)
        if data is None:
            data = _buffer(self, item, index)
            if _DATA_URI.match(item.text("uri")):
                self._decoded[index] = data
        if len(data) < length:
            raise item.fault(f"byteLength is {length}, but there are {len(data)} bytes: it is cut short")
        return data[:length]


@dataclass(frozen=True, eq=False)
class Item:
    """An object of the JSON and where it stands, as ``/accessors/3``; what is amiss in it is a UserError."""

    document: Document
    where: str
    data: Mapping[str, Any]

    def fault(self, what: str, remedy: str = "export the file again") -> UserError:
        """The error about this object."""
        return UserError(
            f"{self.where}: {what}" if self.where else what, path=self.document.path, remedy=remedy
        )

    def items(self, key: str) -> list[Item]:
        """A list of objects; empty where there is none."""
        found = self.data.get(key, [])
        where = f"{self.where}/{key}"
        if not isinstance(found, list):
            raise self.fault(f"{key} is {_shown(found)}, expected a list")
        for i, data in enumerate(found):
            if not isinstance(data, dict):
                raise self.fault(f"{key}/{i} is {_shown(data)}, expected an object")
        return [Item(self.document, f"{where}/{i}", data) for i, data in enumerate(found)]

    def item(self, key: str) -> Item | None:
        """An object, or None where there is none."""
        found = self.data.get(key)
        if found is None:
            return None
        if not isinstance(found, dict):
            raise self.fault(f"{key} is {_shown(found)}, expected an object")
        return Item(self.document, f"{self.where}/{key}", found)

    def needed(self, key: str) -> Item:
        """An object that must be there."""
        found = self.item(key)
        if found is None:
            raise self.fault(f"{key} is missing")
        return found

    def integer(self, key: str, default: int | None = None, *, least: int = 0, most: int = 1 << 53) -> int:
        """A whole number from least to most."""
        return self._whole(key, self.data.get(key, default), least, most)

    def index(self, key: str, kind: str) -> int | None:
        """The index of an object of a list at the top, or None where there is none."""
        found = self.data.get(key)
        return None if found is None else self._place(key, found, kind)

    def indices(self, key: str, kind: str) -> list[int]:
        """A list of such indices; empty where there is none."""
        found = self.data.get(key, [])
        if not isinstance(found, list):
            raise self.fault(f"{key} is {_shown(found)}, expected a list")
        return [self._place(f"{key}/{i}", value, kind) for i, value in enumerate(found)]

    def _place(self, key: str, value: Any, kind: str) -> int:
        count = len(self.document.items(kind))
        if not (isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count):
            raise self.fault(f"{key} is {_shown(value)}, but the file has {count} {kind}")
        return value

    def _whole(self, key: str, value: Any, least: int, most: int) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not (isinstance(value, int) and not isinstance(value, bool) and least <= value <= most):
            raise self.fault(f"{key} is {_shown(value)}, expected a whole number from {least} to {most}")
        return value

    def numbers(self, key: str, count: int) -> NDArray[np.float64] | None:
        """A list of finite numbers, or None where there is none."""
        found = self.data.get(key)
        if found is None:
            return None
        good = isinstance(found, list) and len(found) == count
        if not good or not all(
            isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) <= digits.LIMIT for v in found
        ):
            raise self.fault(f"{key} is {_shown(found)}, expected {count} finite numbers")
        return np.array(found, np.float64)

    def text(self, key: str, default: str = "") -> str:
        """A string."""
        found = self.data.get(key, default)
        if not isinstance(found, str):
            raise self.fault(f"{key} is {_shown(found)}, expected a string")
        return found


def open_document(path: str | os.PathLike[str]) -> Document:
    """Open a glTF file of version 2; anything amiss in its frame or its JSON is a UserError.

    The last files opened are kept, so that the animations of one file do not parse it again each.
    """
    files.check_input(path)
    try:
        stamp = os.stat(path)
    except OSError as error:
        raise UserError(f"cannot read: {error.strerror}", path=path, remedy="check the path") from error
    return _open(Path(path), (stamp.st_ino, stamp.st_size, stamp.st_mtime_ns))


@functools.lru_cache(maxsize=4)
def _open(path: Path, stamp: tuple[int, ...]) -> Document:
    data = _mapped(path)
    if len(data) == 0:
        raise UserError("the file is empty", path=path, remedy=text.WHOLE_COPY)
    content, binary = data, None
    if data[:4].tobytes() == _GLB:
        content, binary = _chunks(data, path)
    elif path.suffix.lower() == ".glb":
        raise UserError(
            "not a GLB file, which begins with glTF", path=path, remedy="is it a .gltf or another format?"
        )
    try:
        found = json.loads(content.tobytes().decode("utf-8-sig"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) and binary is None else None
        what = error.msg if isinstance(error, json.JSONDecodeError) else str(error)
        raise UserError(f"no valid JSON: {what}", path=path, line=line, remedy=text.WHOLE_COPY) from error
    if not isinstance(found, dict) or not isinstance(found.get("asset"), dict):
        raise UserError("not a glTF file: it has no asset", path=path, remedy="give a glTF 2.0 file")
    document = Document(path, found, binary)
    version = document.root.needed("asset").text("version")
    if not re.match(r"2\.\d", version):
        raise document.root.fault(
            f"/asset: glTF version {_shown(version)}, expected 2.0", "export it as glTF 2.0"
        )
    return document


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _mapped(path: Path) -> Bytes:
    try:
        if path.stat().st_size == 0:
            return np.zeros(0, np.uint8)
        return np.memmap(path, np.uint8, "r")
    except OSError as error:
        raise UserError(f"cannot read: {error.strerror}", path=path, remedy="check the path") from error


def _chunks(data: Bytes, path: Path) -> tuple[Bytes, Bytes | None]:
    """The JSON and the binary chunk of a GLB file."""

    def fault(what: str) -> UserError:
        return UserError(what, path=path, remedy=text.WHOLE_COPY)

    if len(data) < 20:
        raise fault("the file is cut short")
    version, length = struct.unpack("<II", data[4:12].tobytes())
    if version != 2:
        raise UserError(
            f"GLB version {version}, expected 2", path=path, remedy="export it as glTF 2.0 binary"
        )
    if length > len(data):
        raise fault(f"the header says {length} bytes, but the file has {len(data)}: it is cut short")
    at, found = 12, list[tuple[bytes, Bytes]]()
    while at + 8 <= length and len(found) < 2:
        size = int.from_bytes(data[at : at + 4].tobytes(), "little")
        if at + 8 + size > length:
            raise fault(f"the chunk at byte {at} is longer than the file")
        found.append((data[at + 4 : at + 8].tobytes(), data[at + 8 : at + 8 + size]))
        at += 8 + size + -size % 4
    if not found or found[0][0] != _JSON:
        raise fault("the first chunk is not JSON")
    return found[0][1], found[1][1] if len(found) > 1 and found[1][0] == _BIN else None


def _buffer(document: Document, item: Item, index: int) -> Bytes:
    if item.data.get("uri") is None:
        if index != 0 or document.binary is None:
            raise item.fault("it has no uri, and the file no binary chunk for it")
        return document.binary
    return of_uri(document.path, item)


def of_uri(path: Path, item: Item) -> Bytes:
    """Bytes that the uri of a buffer or an image holds or names; no such ones are a UserError."""
    match = _DATA_URI.match(item.text("uri"))
    if match is None:
        return _external(path, item)
    try:
        return np.frombuffer(base64.b64decode(item.text("uri")[match.end() :], validate=True), np.uint8)
    except (ValueError, binascii.Error) as error:
        raise item.fault(f"the data of its uri is no base64: {error}") from error


def _external(path: Path, item: Item) -> Bytes:
    """Bytes of a file that stands in the folder of the glTF file, or below it."""
    uri = unquote(item.text("uri"))
    inside = "such a file stands beside the glTF file, or in a folder there"
    if not uri or _SCHEME.match(uri) or uri.startswith(("/", "\\")) or "\0" in uri:
        raise item.fault(f"uri {_shown(uri)} is no relative path", inside)
    folders = {Path(os.path.realpath(path.parent)), Path(os.path.realpath(path)).parent}
    place = Path(os.path.realpath(path.parent / uri.replace("\\", "/")))
    if not any(place.is_relative_to(folder) for folder in folders):
        raise item.fault(f"uri {_shown(uri)} leads out of the file's folder", inside)
    if files.kind(place) != "file":
        raise item.fault(f"there is no file {_shown(uri)}", "put it beside the glTF file, or export as .glb")
    return _mapped(place)


def _shown(value: Any) -> str:
    if isinstance(value, (dict, list)) and len(value) > 20:
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value)}"
    if isinstance(value, int) and abs(value) > 1 << 63:
        return "a huge number"
    shown = ascii(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."
