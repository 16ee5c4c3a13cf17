"""Archives from strangers: unpacked into one folder and nowhere else, within limits, or not at all."""

from __future__ import annotations

import contextlib
import errno
import fnmatch
import functools
import gzip
import hashlib
import os
import re
import shutil
import stat
import tarfile
import tempfile
import unicodedata
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ..errors import UserError
from . import meter
from .download import check_room

CHUNK = 1 << 20
HEADERS = 1 << 20  # bytes of tar headers between two members, far more than any honest archive has
_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_THROWN = "it was not unpacked; look at the set's homepage, and do not unpack it by hand unless you trust it"


class BadArchive(UserError):
    """An archive that cannot be unpacked, today or ever."""


@dataclass(frozen=True)
class Limits:
    """What no data set exceeds: bytes and files unpacked, bytes unpacked a byte of the archive.

    The ratio counts from `free` bytes on. Text of numbers packs to a fifth or a tenth; zeros to a thousandth.
    """

    size: int = 64 << 30
    count: int = 200_000
    ratio: float = 100.0
    free: int = 64 << 20

    def bytes_of(self, packed: int) -> int:
        """The most bytes that an archive of a length may unpack to."""
        return min(self.size, max(self.free, int(packed * self.ratio)))


@dataclass(frozen=True)
class Unpacked:
    """A file that was unpacked: its path in the folder, size and checksum."""

    path: str
    size: int
    sha256: str


@dataclass
class _Member:
    """A member of either kind of archive."""

    name: str
    folder: bool
    plain: bool  # a regular file, no link and no device
    size: int
    open: Callable[[], IO[bytes]]


def unpack(
    archive: Path,
    folder: Path,
    kind: str,
    *,
    strip: str = "",
    keep: Iterable[str] = (),
    limits: Limits | None = None,
    label: str = "",
) -> list[Unpacked]:
    """Unpack a zip or tar.gz into a folder, which must not exist and appears in one step.

    strip is the folder of the archive whose content is taken, keep are patterns of the paths to take; all if
    there is none. A path that leads out, a link or a device to be taken, two members of one place (letters'
    case and the forms of accents set aside), an encrypted or damaged member, and more than the limits allow
    are a UserError, which leaves nothing.
    """
    limits, patterns = limits or Limits(), [pattern.casefold() for pattern in keep]
    above = tuple(part for part in strip.split("/") if part)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name[:40]}.", dir=folder.parent))
    try:
        with _about(archive), _members(archive, kind, limits) as members:
            most, needed = limits.bytes_of(archive.stat().st_size), None
            if kind == "zip":  # it says beforehand what it holds
                members = list(members)
                needed = sum(one.size for one in members if _place(one, above, patterns))
                if needed > most:
                    raise _too_large(most)
                check_room(folder.parent, needed)
            with meter.meter(label, needed) as report:
                found = _write(members, temporary, above, patterns, most, limits.count, report)
        if not found:
            raise BadArchive("holds none of the files to take", path=archive, remedy="correct strip and keep")
        os.chmod(temporary, 0o755)
        os.rename(temporary, folder)
        return found
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise UserError(
            "the disk is full", path=folder.parent, remedy="make room; nothing was unpacked"
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_name(name: str) -> None:
    """A UserError where a member's path leads out of the folder, or is no path on some system."""
    parts, why = _parts(name), None
    if name.startswith("/") or re.match(r"[A-Za-z]:", name):
        why = "it is absolute"
    elif ".." in parts:
        why = "it leads out of the folder"
    elif "\\" in name:
        why = "it has a backslash"
    elif ":" in name or re.search(r"[\x00-\x1f\x7f]", name):
        why = "it has a colon or a control character"
    elif any(_DEVICE.fullmatch(part) for part in parts):
        why = "it names a device"
    elif any(len(os.fsencode(part)) > 255 for part in parts) or len(name) > 1024:
        why = "it is too long"
    if why:
        raise UserError(f"hostile or damaged: member {_shown(name)}: {why}", remedy=_THROWN)


def _parts(name: str) -> tuple[str, ...]:
    return tuple(part for part in name.split("/") if part not in ("", "."))


def _place(member: _Member, above: tuple[str, ...], patterns: list[str]) -> str | None:
    """Where a member goes, below the folder to strip; None if it is not to be taken."""
    parts = _parts(member.name)
    path = "/".join(parts[len(above) :])
    if member.folder or not path or parts[: len(above)] != above:
        return None
    if patterns and not any(fnmatch.fnmatchcase(path.casefold(), pattern) for pattern in patterns):
        return None
    return path


def _write(
    members: Iterable[_Member],
    folder: Path,
    above: tuple[str, ...],
    patterns: list[str],
    most: int,
    count: int,
    report: Callable[[int], None],
) -> list[Unpacked]:
    """Write the members to be taken into a folder; of no more than count members no more than most bytes."""
    total, found, taken = 0, [], _Taken()
    for i, member in enumerate(members):
        if i >= count:
            raise UserError(f"hostile: more than {count:,} members", remedy=_THROWN)
        check_name(member.name)
        path = _place(member, above, patterns)
        if path is None:
            continue
        if not member.plain:
            what = f"hostile: member {_shown(member.name)} is a link or a device"
            raise UserError(what, remedy=_THROWN)
        taken.add(path, member.name)
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        digest, size = hashlib.sha256(), 0
        with member.open() as source, open(target, "xb") as stream:
            while block := source.read(CHUNK):
                size += len(block)
                if total + size > most:
                    raise _too_large(most)
                digest.update(block)
                stream.write(block)
                report(total + size)
        total += size
        if size != member.size:
            raise UserError(f"damaged: member {_shown(member.name)} is cut", remedy=_THROWN)
        found.append(Unpacked(path, size, digest.hexdigest()))
    return found


class _Taken:
    """The places that are taken, as a file system that knows neither case nor accents' forms sees them."""

    def __init__(self) -> None:
        self.files: dict[tuple[str, ...], str] = {}
        self.folders: dict[tuple[str, ...], str] = {}

    def add(self, path: str, name: str) -> None:
        key = tuple(self._fold(part) for part in path.split("/"))
        above = [key[:i] for i in range(1, len(key))]
        other = self.files.get(key) or self.folders.get(key)
        other = other or next((self.files[k] for k in above if k in self.files), None)
        if other is not None:
            what = f"members {_shown(other)} and {_shown(name)} are one place"
            raise UserError(f"hostile or damaged: {what}", remedy=_THROWN)
        self.files[key] = name
        self.folders.update(dict.fromkeys(above, name))

    @staticmethod
    def _fold(part: str) -> str:
        return unicodedata.normalize("NFC", unicodedata.normalize("NFC", part).casefold()).rstrip(". ")


@contextlib.contextmanager
def _members(archive: Path, kind: str, limits: Limits) -> Iterator[Iterable[_Member]]:
    if kind == "zip":
        with zipfile.ZipFile(archive) as opened:
            yield (_zipped(opened, info) for info in opened.infolist())
        return
    most = limits.bytes_of(archive.stat().st_size)
    with gzip.open(archive) as plain:
        reader = _Reader(plain, HEADERS)
        # As a stream: members come in the order of the file, and nothing is sought or read twice.
        with tarfile.open(fileobj=reader, mode="r|") as tar:  # type: ignore[call-overload]
            yield _tarred(tar, reader, most)


def _zipped(opened: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Member:
    if info.flag_bits & 1:
        raise UserError(f"member {_shown(info.filename)} is encrypted", remedy=_THROWN)
    mode = stat.S_IFMT(info.external_attr >> 16)
    plain = mode in (0, stat.S_IFREG)
    # orig_filename is what is written in the archive; filename is already cut at a NUL.
    folder = info.is_dir() and mode in (0, stat.S_IFDIR)
    return _Member(info.orig_filename, folder, plain, info.file_size, functools.partial(opened.open, info))


def _tarred(tar: tarfile.TarFile, reader: _Reader, most: int) -> Iterator[_Member]:
    for info in tar:
        end = info.offset_data + info.size
        reader.limit = min(end + HEADERS, most + 2 * HEADERS)
        if info.size < 0 or end > most + HEADERS:
            raise _too_large(most)
        plain = info.isreg() and not info.issparse()
        yield _Member(info.name, info.isdir(), plain, info.size, functools.partial(_file, tar, info))
    while reader.read(CHUNK):  # the checksum stands at the end
        pass


def _file(tar: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    opened = tar.extractfile(info)
    if opened is None:
        raise UserError(f"member {_shown(info.name)} is no file", remedy=_THROWN)
    return opened


class _Reader:
    """A stream that may be read up to a limit, which bounds what headers make tarfile keep in memory."""

    def __init__(self, stream: Any, limit: int) -> None:
        self.stream, self.limit, self.done = stream, limit, 0

    def read(self, count: int) -> bytes:
        block = self.stream.read(count)
        self.done += len(block)
        if self.done > self.limit + tarfile.RECORDSIZE:
            raise UserError("hostile: it unpacks to far more than its members", remedy=_THROWN)
        return block


@contextlib.contextmanager
def _about(archive: Path) -> Iterator[None]:
    """What goes wrong inside is a fault of the archive."""
    damaged = (zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, gzip.BadGzipFile, ValueError)
    try:
        yield
    except UserError as error:
        if error.path is not None:
            raise
        raise BadArchive(error.what, path=archive, remedy=error.remedy) from error
    except (*damaged, NotImplementedError, RuntimeError, OverflowError) as error:
        raise BadArchive(f"not an archive, or damaged: {error}", path=archive, remedy=_THROWN) from error


def _too_large(most: int) -> UserError:
    what = f"hostile: it unpacks to more than {meter.amount(most)}, far more than its size allows"
    return UserError(what, remedy=_THROWN)


def _shown(name: str) -> str:
    return ascii(name if len(name) <= 80 else name[:77] + "...")
