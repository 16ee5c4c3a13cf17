"""The project's own files: named arrays with a JSON header, checked, atomic, memory-mapped.

The container is safetensors (an 8-byte length, a JSON header, raw arrays). Our metadata, one JSON object
with format name, version and content, stands under ``__metadata__``; so does a checksum of header and data.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from .errors import UserError

_DTYPES = {
    "F64": "<f8",
    "F32": "<f4",
    "F16": "<f2",
    "I64": "<i8",
    "I32": "<i4",
    "I16": "<i2",
    "I8": "i1",
    "U64": "<u8",
    "U32": "<u4",
    "U16": "<u2",
    "U8": "u1",
    "BOOL": "?",
}


@contextlib.contextmanager
def atomic(path: str | os.PathLike[str], mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a temporary file beside path; on success it becomes path, on any error it is removed.

    A full disk or missing folder is a UserError.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        os.fchmod(handle, 0o644) if hasattr(os, "fchmod") else None
        options = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
        with os.fdopen(handle, mode, **options) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        if isinstance(error, FileNotFoundError) and error.filename not in (None, str(path), temporary):
            raise
        raise UserError(f"cannot write: {error.strerror}", path=path, remedy="nothing was written") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def fingerprint(arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> str:
    """Hash (hex, 128 bits) of names, types, shapes and contents of arrays, and of JSON-able metadata."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(json.dumps(metadata, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(memoryview(array.reshape(-1).view(np.uint8)))
    return digest.hexdigest()


def save(
    path: str | os.PathLike[str],
    kind: str,
    version: int,
    metadata: Mapping[str, Any],
    arrays: Mapping[str, NDArray],
) -> str:
    """Write arrays and JSON-able metadata atomically; returns the content's fingerprint."""
    body = {"format": kind, "version": version, **metadata}
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    mark = fingerprint(arrays, body)
    header = {"metadata": json.dumps(body, sort_keys=True), "checksum": mark}
    with atomic(path) as stream:
        stream.write(safetensors.numpy.save(arrays, header))
    return mark


def load(
    path: str | os.PathLike[str], kind: str, version: int
) -> tuple[dict[str, Any], dict[str, NDArray], str]:
    """Read a file written by `save`, its arrays memory-mapped and read-only.

    Returns metadata, arrays and fingerprint. A missing, foreign, older, newer, cut or damaged file is a
    UserError.
    """
    path = Path(path)
    remake = f"make it again or restore a whole copy of this {kind}"

    def damaged(why: str) -> UserError:
        return UserError(f"damaged {kind}: {why}", path=path, remedy=remake)

    try:
        size = path.stat().st_size
        with open(path, "rb") as stream:
            length = int.from_bytes(stream.read(8), "little")
            if size < 8 or length > min(size - 8, 100_000_000):
                raise UserError(f"not a {kind} file, or cut short", path=path, remedy=remake)
            raw = stream.read(length)
        data = np.memmap(path, np.uint8, "r", 8 + length) if size > 8 + length else np.zeros(0, np.uint8)
    except OSError as error:
        raise UserError(f"cannot read: {error.strerror}", path=path) from error
    try:
        table = json.loads(raw)
        header = table.pop("__metadata__")
        body = json.loads(header["metadata"])
        found, found_version, mark = body["format"], body["version"], header["checksum"]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"not a {kind} file, or its header is damaged", path=path, remedy=remake) from error
    if found != kind:
        raise UserError(f"a {found}, expected a {kind}", path=path)
    if found_version != version:
        raise UserError(
            f"{kind} format version {found_version}, this program reads {version}",
            path=path,
            remedy="make it again with this program",
        )
    arrays: dict[str, NDArray] = {}
    try:
        for name, entry in table.items():
            dtype, (start, stop) = np.dtype(_DTYPES[entry["dtype"]]), entry["data_offsets"]
            if not 0 <= start <= stop <= len(data):
                raise damaged("cut short")
            arrays[name] = data[start:stop].view(dtype).reshape(entry["shape"])
    except (ValueError, KeyError, TypeError) as error:
        raise damaged("its table of arrays is unreadable") from error
    if fingerprint(arrays, body) != mark:
        raise damaged("the checksum differs from its content")
    return body, arrays, mark
