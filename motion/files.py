"""The project's own files: named arrays with a JSON header, checked, atomic, memory-mapped.

The container is safetensors (an 8-byte length, a JSON header, raw arrays). Our metadata, one JSON object
with format name, version and content, stands under ``__metadata__``; so does a checksum of the whole file.
The same content always gives the same bytes, so the checksum is the content's fingerprint.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import stat
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
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
    "BOOL": "|b1",
}
_NAMES = {np.dtype(text): name for name, text in _DTYPES.items()}
_CHUNK = 1 << 22
_HEADER = 100_000_000  # bytes of a header at most
_BLANK = "0" * 32


def kind(path: str | os.PathLike[str]) -> Literal["file", "folder", "other"] | None:
    """What lies at a path: a regular file, a folder, something else (a pipe, a device) or nothing.

    A path that cannot be looked at (no permission, a name too long) is a UserError.
    """
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        if error.errno == errno.ELOOP:
            return None
        raise _cannot("read", error, path) from error
    except ValueError as error:  # a NUL character in the path
        raise UserError(f"cannot read: {error}", path=path, remedy="check the path") from error
    return "folder" if stat.S_ISDIR(mode) else "file" if stat.S_ISREG(mode) else "other"


def check_input(path: str | os.PathLike[str]) -> None:
    """A UserError unless path is a regular file: reading a pipe or a device may never end."""
    found = kind(path)
    if found == "file":
        return
    folder, other = "it is a folder, expected a file", "it is not a regular file"
    what = {None: "No such file or directory", "folder": folder, "other": other}[found]
    raise UserError(f"cannot read: {what}", path=path, remedy="check the path")


def read_text(path: str | os.PathLike[str], *, remedy: str) -> str:
    """Text of a UTF-8 file, with or without a byte order mark; a missing or binary one is a UserError."""
    check_input(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise _cannot("read", error, path) from error
    except UnicodeDecodeError as error:
        raise UserError("not a text file", path=path, remedy=remedy) from error


def check_output(
    path: str | os.PathLike[str], *, inputs: Iterable[str | os.PathLike[str] | None] = ()
) -> None:
    """Say before the work, not after it, that path cannot be written or that it is one of the inputs.

    inputs are files that are read, and others that are written; None stands for one that was not given.
    """
    if not os.fspath(path):
        raise UserError("an output without a name", remedy="name a file to write")
    if kind(path) == "folder":
        raise UserError("cannot write: it is a folder", path=path, remedy="name a file to write")
    if kind(path) == "other":
        raise UserError("cannot write: it is not a regular file", path=path, remedy="name a file to write")
    for other in inputs:
        if other is not None and _same(path, other):
            raise UserError(
                f"would be written over {os.fspath(other)}", path=path, remedy="name another file to write"
            )
    try:
        folder = Path(os.path.realpath(path)).parent
        while kind(folder) is None:
            folder = folder.parent
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _cannot("write", error, path) from error


def _same(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return os.path.abspath(one) == os.path.abspath(other)


def _cannot(what: str, error: OSError, path: str | os.PathLike[str]) -> UserError:
    remedy = "nothing was written" if what == "write" else "check the path and its permissions"
    return UserError(f"cannot {what}: {error.strerror or error}", path=path, remedy=remedy)


@contextlib.contextmanager
def atomic(path: str | os.PathLike[str], mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a temporary file beside path; on success it becomes path, on any error it is removed.

    A full disk, a folder that cannot be written or a device in the file's place is a UserError.
    """
    if kind(path) in ("folder", "other"):
        raise UserError("cannot write: it is not a regular file", path=path, remedy="name a file to write")
    temporary, body = None, None
    made: list[Path] = []
    try:
        path = folder = Path(os.path.realpath(path))
        while kind(folder := folder.parent) is None:
            made.append(folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=half_written(path), dir=path.parent)
        os.fchmod(handle, 0o644) if hasattr(os, "fchmod") else None
        options: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
        with os.fdopen(handle, mode, **options) as stream:
            try:
                yield stream
            except OSError as error:
                # One that names a file is about that file; a write to the stream names none.
                body = error if error.filename is not None else None
                raise
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
        temporary, made = None, []
    except OSError as error:
        if error is body:
            raise
        raise _cannot("write", error, path) from error
    finally:
        with contextlib.suppress(OSError):
            if temporary is not None:
                os.unlink(temporary)
            for folder in made:
                folder.rmdir()


def half_written(path: Path) -> str:
    """How names begin of the temporary files that are to become path, and of no others."""
    return f".{path.name[:40]}.{zlib.crc32(os.fsencode(path.name)):08x}."


def fingerprint(arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> str:
    """Hash (hex, 128 bits) of names, types, shapes and contents of arrays, and of JSON-able metadata."""
    arrays = _canonical(arrays)
    return _checksum(_header(arrays, metadata, _BLANK), map(_bytes, arrays.values()))


def save(
    path: str | os.PathLike[str],
    kind: str,
    version: int,
    metadata: Mapping[str, Any],
    arrays: Mapping[str, NDArray],
) -> str:
    """Write arrays and JSON-able metadata atomically; returns the content's fingerprint."""
    body = {"format": kind, "version": version, **metadata}
    arrays = _canonical(arrays)
    mark = fingerprint(arrays, body)
    with atomic(path) as stream:
        stream.write(_header(arrays, body, mark))
        for array in arrays.values():
            stream.write(_bytes(array))
    return mark


def _canonical(arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Contiguous little-endian arrays, widest elements first: without holes all of them lie aligned."""
    found = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    found = {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in found.items()}
    return dict(sorted(found.items(), key=lambda item: (-item[1].itemsize, item[0])))


def _bytes(array: NDArray) -> memoryview:
    return array.reshape(-1).view(np.uint8).data


def _header(arrays: Mapping[str, NDArray], body: Mapping[str, Any], mark: str) -> bytes:
    """Length and JSON header; the checksum stands first, so that its place does not depend on the rest."""
    table: dict[str, Any] = {"__metadata__": {"checksum": mark, "metadata": json.dumps(body, sort_keys=True)}}
    start = 0
    for name, array in arrays.items():
        stop = start + array.nbytes
        entry = {"dtype": _NAMES[array.dtype], "shape": list(array.shape), "data_offsets": [start, stop]}
        table[name] = entry
        start = stop
    text = json.dumps(table, separators=(",", ":")).encode()
    text += b" " * (-(8 + len(text)) % 64)
    return len(text).to_bytes(8, "little") + text


def _checksum(header: bytes, blocks: Iterable[memoryview]) -> str:
    """Hash of a header (its checksum blanked) and of the data after it.

    A hash of the hashes of fixed chunks, which threads compute: loading a database means hashing it.
    """
    digest, chunks = hashlib.sha256(header), [*_chunks(blocks)]

    def of(chunk: memoryview) -> bytes:
        return hashlib.sha256(chunk).digest()

    if sum(chunk.nbytes for chunk in chunks) <= _CHUNK:  # hashed before threads have begun
        digest.update(b"".join(map(of, chunks)))
    else:
        with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
            digest.update(b"".join(pool.map(of, chunks)))
    return digest.hexdigest()[: len(_BLANK)]


def _chunks(blocks: Iterable[memoryview]) -> Iterator[memoryview]:
    for block in blocks:
        yield from (block[i : i + _CHUNK] for i in range(0, len(block), _CHUNK))


def load(
    path: str | os.PathLike[str], kind: str, version: int
) -> tuple[dict[str, Any], dict[str, NDArray], str]:
    """Read a file written by `save`, its arrays memory-mapped and read-only.

    Returns metadata, arrays and fingerprint. A missing, foreign, older, newer, cut or damaged file is a
    UserError; the checksum of the whole content is verified.
    """
    path = Path(path)
    check_input(path)
    remake = f"make it again or restore a whole copy of this {kind}"
    try:
        size = path.stat().st_size
        with open(path, "rb") as stream:
            prefix = stream.read(8)
            length = int.from_bytes(prefix, "little")
            if size < 8 or length > min(size - 8, _HEADER):
                raise UserError(f"not a {kind} file, or cut short", path=path, remedy=remake)
            raw = stream.read(length)
        data = np.memmap(path, np.uint8, "r", 8 + length) if size > 8 + length else np.zeros(0, np.uint8)
    except OSError as error:
        raise _cannot("read", error, path) from error
    try:
        table = json.loads(raw)
        header = table.pop("__metadata__")
        body, mark = json.loads(header["metadata"]), header["checksum"].encode()
        found, found_version = body["format"], body["version"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UserError(f"not a {kind} file, or its header is damaged", path=path, remedy=remake) from error
    if found != kind:
        raise UserError(f"a {found}, expected a {kind}", path=path)
    if found_version != version:
        raise UserError(
            f"{kind} format version {found_version}, this program reads {version}",
            path=path,
            remedy="make it again with this program",
        )
    try:
        arrays = _arrays(table, data)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        why = f"damaged {kind}: its arrays do not fit the file, which may be cut short"
        raise UserError(why, path=path, remedy=remake) from error
    blank = prefix + raw.replace(mark, _BLANK.encode(), 1)
    if _checksum(blank, map(_bytes, arrays.values())).encode() != mark:
        why = f"damaged {kind}: the checksum differs from its content"
        raise UserError(why, path=path, remedy=remake)
    return body, arrays, mark.decode()


def format_of(path: str | os.PathLike[str]) -> str | None:
    """The kind of what `save` wrote at path, by its header alone; None for any other file."""
    try:
        return str(json.loads(_table(path)["__metadata__"]["metadata"])["format"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def array_sizes(path: str | os.PathLike[str]) -> dict[str, int]:
    """Bytes of each array of what `save` wrote at path, by its header alone; a UserError for other files."""
    try:
        table = _table(path)
        del table["__metadata__"]
        spans = {name: entry["data_offsets"] for name, entry in table.items()}
        return {name: stop - start for name, (start, stop) in spans.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UserError("not a file of arrays, or its header is damaged", path=path) from error


def _table(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The header; a ValueError where it is none."""
    check_input(path)
    try:
        with open(path, "rb") as stream:
            length = int.from_bytes(stream.read(8), "little")
            raw = stream.read(min(length, _HEADER))
    except OSError as error:
        raise _cannot("read", error, path) from error
    return json.loads(raw)


@contextlib.contextmanager
def content_of(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """What goes wrong inside means: the checksum is right, but the content is not that of such a file."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, UserError) as error:
        why = f"no {error}" if isinstance(error, KeyError) else error
        raise UserError(f"damaged {kind}: {why}", path=path, remedy="make it again") from error


def check_shapes(arrays: Mapping[str, NDArray], expected: Mapping[str, tuple[str, tuple[int, ...]]]) -> None:
    """A ValueError unless each expected array is there with its type and shape."""
    for name, (dtype, shape) in expected.items():
        array = arrays[name]
        if array.dtype != dtype or array.shape != shape:
            raise ValueError(f"{name} are {array.dtype} {array.shape}, expected {dtype} {shape}")


def _arrays(table: Mapping[str, Any], data: NDArray[np.uint8]) -> dict[str, NDArray]:
    """Views of the data by the header's table, in file order; a ValueError unless they cover all of it."""
    arrays: dict[str, NDArray] = {}
    reached = 0
    for name, entry in table.items():
        start, stop = entry["data_offsets"]
        if start != reached or not start <= stop <= len(data):
            raise ValueError(name)
        arrays[name] = data[start:stop].view(_DTYPES[entry["dtype"]]).reshape(entry["shape"])
        if arrays[name].flags.writeable:
            arrays[name].flags.writeable = False
        reached = stop
    if reached != len(data):
        raise ValueError("data beyond the last array")
    return arrays


def write_together(
    folder: Path, contents: Mapping[str, str | bytes], *, stale: Iterable[str] = ()
) -> list[Path]:
    """Write texts, or bytes, by file name into a folder, all of them or none; the files' paths.

    stale : names of files that others of their kind may have left there; those not written again go, so that
    what lies together belongs together.
    """
    with contextlib.ExitStack() as stack:
        for name, content in contents.items():
            mode = "w" if isinstance(content, str) else "wb"
            stream = stack.enter_context(atomic(folder / name, mode))
            stream.write(content)
            stream.flush()  # a disk that is full leaves all the old files
    for name in set(stale) - set(contents):
        (folder / name).unlink(missing_ok=True)
    return [folder / name for name in contents]
