"""The arrays of an ``.npz`` file: headers first, nothing is unpickled, no promise fills the memory."""

from __future__ import annotations

import os
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import digits, files, text
from ..errors import UserError

MOST_BYTES = 1 << 30  # of one array: an hour of SMPL-X at 120 frames a second is half of it
MOST_ARRAYS = 1_000
EMPTY, RATIO = 8_000_000, 200  # from so many numbers on, no motion is packed to so small a part of its bytes
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, OSError, RuntimeError, struct.error)
# RuntimeError: encrypted members, and NotImplementedError for compressions that are not known.
_NO_HEADER = (
    SyntaxError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    MemoryError,
    tokenize.TokenError,
)
# What Python's own reader of literals and NumPy's of types make of headers that are neither.


@dataclass(frozen=True)
class Header:
    """What an array is, by its header."""

    member: str
    shape: tuple[int, ...]
    dtype: np.dtype
    fortran: bool
    start: int  # byte of the member where the data begins
    size: int  # bytes of the member
    packed: int  # bytes of the file that hold them

    def __str__(self) -> str:
        return f"{list(self.shape)} {self.dtype}" if self.shape else str(self.dtype)


class Archive:
    """An open file: `headers` by key, in lower case, and the arrays, read when asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        files.check_input(path)
        self.headers: dict[str, Header] = {}
        try:
            with zipfile.ZipFile(self.path) as archive:
                members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
                if len(members) > MOST_ARRAYS:
                    raise self.fault(f"{len(members)} arrays, at most {MOST_ARRAYS} are read", "not motion")
                for info in members:
                    key = info.filename.removesuffix(".npy").lower()
                    self.headers[key] = self._header(archive, info)
        except (*_BROKEN, *_NO_HEADER) as error:
            raise self.fault(f"not an NPZ file, or cut short: {_line(error)}") from error
        if not self.headers:
            raise self.fault("no arrays in this file")

    def fault(self, what: str, remedy: str = text.WHOLE_COPY) -> UserError:
        """The error about this file."""
        return UserError(what, path=self.path, remedy=remedy)

    def _header(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Header:
        with archive.open(info) as stream, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that Python 2 wrote it
            version = np.lib.format.read_magic(stream)
            if version == (1, 0):
                shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
            elif version in ((2, 0), (3, 0)):
                shape, fortran, dtype = np.lib.format.read_array_header_2_0(stream)
            else:
                raise ValueError(f"array format {version}")
            return Header(
                info.filename, shape, dtype, fortran, stream.tell(), info.file_size, info.compress_size
            )

    def first(self, keys: Iterable[str]) -> str | None:
        """The first of some keys that the file has."""
        return next((key for key in keys if key in self.headers), None)

    def raw(self, key: str) -> NDArray[Any]:
        """An array of numbers or strings; objects, sizes beyond reason and cut data are UserErrors."""
        header = self.headers[key]
        if header.dtype.hasobject or header.dtype.kind not in "fiubUS" or not header.dtype.itemsize:
            raise self.fault(
                f"{key} is of type {header.dtype}, which is not read",
                "save it as an array of numbers or strings; Python objects in files may run any program",
            )
        if any(side < 0 for side in header.shape):
            raise self.fault(f"{key} has the shape {list(header.shape)}")
        count = 1
        for side in header.shape:
            count *= side
        size = count * header.dtype.itemsize
        if size > MOST_BYTES:
            raise self.fault(
                f"{key} is said to be {list(header.shape)} {header.dtype}, which is {size / 2**30:,.1f} GiB",
                f"at most {MOST_BYTES / 2**30:g} GiB are read; cut the motion into pieces",
            )
        if size > header.size - header.start:
            raise self.fault(f"{key} is said to be {header}, but has {header.size:,} bytes")
        if count > EMPTY and size > RATIO * header.packed:
            what = f"{key} is said to be {header}, of which the file holds {header.packed:,} bytes"
            raise self.fault(what, "this is no motion; save it uncompressed if it is")
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(header.member) as stream:
                stream.read(header.start)
                data = stream.read(size)
                stream.read(1)  # reaching the end checks the checksum
        except _BROKEN as error:
            raise self.fault(f"{key} is damaged: {_line(error)}") from error
        if len(data) < size:
            raise self.fault(f"{key} is cut short")
        if header.dtype.kind == "U":
            codes = np.frombuffer(data, np.dtype(np.uint32).newbyteorder(header.dtype.byteorder))
            if (codes > 0x10FFFF).any() or ((codes >= 0xD800) & (codes < 0xE000)).any():
                raise self.fault(f"{key} holds what are no letters")
        found: NDArray[Any] = np.frombuffer(data, header.dtype, count)
        return found.reshape(header.shape, order="F" if header.fortran else "C")

    def numbers(self, key: str) -> NDArray[np.float64]:
        """An array of finite numbers; the first axis is time in messages about those that are not."""
        raw = self.raw(key)
        if raw.dtype.kind in "US":
            raise self.fault(f"{key} holds {raw.dtype}, expected numbers", "save it as numbers")
        with np.errstate(invalid="ignore"):
            values = raw.astype(np.float64)
            good = np.abs(values) <= digits.LIMIT
        if not good.all():
            place = np.argwhere(~good)[0].tolist()
            where = f" in frame {place[0] + 1}" if values.ndim > 1 else ""
            raise self.fault(
                f"{key} has a value that is no finite number{where}: {values[tuple(place)]:g}",
                f"{text.WHOLE_COPY}, or cut the frame out",
            )
        return values

    def string(self, key: str) -> str:
        """A string, as an array of one."""
        values = self.strings(key)
        if len(values) != 1:
            raise self.fault(f"{key} has {len(values)} values, expected one string", "save one string")
        return values[0]

    def strings(self, key: str) -> list[str]:
        """A list of strings."""
        raw = self.raw(key)
        if raw.dtype.kind not in "US":
            raise self.fault(f"{key} holds {raw.dtype}, expected strings", "save it as an array of strings")
        return [text.decode(v) if isinstance(v, bytes) else str(v) for v in raw.reshape(-1).tolist()]

    def listing(self) -> str:
        """What the file holds, for messages."""
        some = [f"{key} {header}" for key, header in list(self.headers.items())[:30]]
        return ", ".join(some) + ", ..." * (len(self.headers) > 30)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
