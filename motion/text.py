"""Text files that other programs wrote: their bytes, or one clear error."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from . import files
from .errors import UserError

WHOLE_COPY = "restore a whole copy of the file"


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Bytes of a text file without byte order mark, lines ending in ``\\n`` or ``\\r\\n``.

    A missing, unreadable or empty file, a folder or device, and text in 16-bit characters are a UserError.
    """
    path = Path(path)
    files.check_input(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read: {error.strerror}", path=path, remedy="check the path") from error
    if not data or data.isspace():
        raise UserError("the file is empty", path=path, remedy=WHOLE_COPY)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UserError("16-bit text", path=path, line=1, remedy="save it as plain text (UTF-8)")
    data = data.removeprefix(b"\xef\xbb\xbf").removesuffix(b"\x1a")  # the end of a file under DOS
    if data.count(b"\r") == data.count(b"\r\n"):
        return data
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def lines(content: str) -> Iterator[str]:
    """Lines of a text, without their ends, one at a time."""
    at = 0
    while at <= len(content):
        stop = content.find("\n", at)
        stop = len(content) if stop < 0 else stop
        yield content[at:stop]
        at = stop + 1


def decode(data: bytes) -> str:
    """UTF-8, or Latin-1 where it is not."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def shown(token: str, limit: int = 30) -> str:
    """A quoted, printable, short form of a word from a file, for messages."""
    return ascii(token if len(token) <= limit else token[: limit - 3] + "...")
