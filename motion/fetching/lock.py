"""The lock file of a set's folder: what was fetched, from where, and how it can be recognised again."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from .. import config, files
from ..errors import UserError
from . import download
from .registry import LOCK, WORK, check_path

VERSION = 1
_REMOVE = "move the folder away to fetch it anew"


@dataclass
class Source:
    """A download: its size and checksum, and which published checksum it agreed with, if there is one."""

    size: int
    sha256: str
    published: str | None = None


@dataclass
class Held:
    """A file in the folder, by the address it came from."""

    address: str
    size: int
    sha256: str
    mtime_ns: int


@dataclass
class Lock:
    """What a folder holds of a data set, and the licence that was accepted for it."""

    set: str
    licence: str = ""  # name of the licence accepted; "" before that
    sources: dict[str, Source] = field(default_factory=dict)
    files: dict[str, Held] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)  # addresses that the server does not have
    version: int = VERSION

    def __post_init__(self) -> None:
        for path in self.files:
            check_path(path, ("files", path))


def read(folder: Path, name: str) -> Lock:
    """The lock of a set's folder, an empty one if there is none; another set's is a UserError."""
    path = folder / LOCK
    if files.kind(path) is None:
        return Lock(name)
    text = files.read_text(path, remedy=_REMOVE)
    try:
        lock = config.from_dict(Lock, json.loads(text))
    except (ValueError, RecursionError, UserError) as error:
        raise UserError(f"damaged lock file: {error}", path=path, remedy=_REMOVE) from error
    if lock.version != VERSION:
        what = f"lock file of version {lock.version}, this program reads {VERSION}"
        raise UserError(what, path=path, remedy=_REMOVE)
    if lock.set != name:
        what = f"this folder holds the set {lock.set!r}, not {name!r}"
        raise UserError(what, path=path, remedy="choose another folder with -o")
    return lock


def write(folder: Path, lock: Lock) -> None:
    """Write the lock, atomically."""
    with files.atomic(folder / LOCK, "w") as stream:
        json.dump(asdict(lock), stream, indent=1)
        stream.write("\n")


def held(folder: Path, path: str, size: int, sha256: str, address: str) -> Held:
    """The entry of a file that has just been put there."""
    return Held(address, size, sha256, (folder / path).stat().st_mtime_ns)


def whole(folder: Path, lock: Lock, address: str, *, thorough: bool = False) -> bool:
    """Whether all files of an address are there as they were fetched.

    One whose size and date are as they were is taken for unchanged, as make and git do; thorough reads it.
    """
    mine = {path: entry for path, entry in lock.files.items() if entry.address == address}
    return bool(mine) and all(_same(folder / path, entry, thorough) for path, entry in mine.items())


def _same(path: Path, entry: Held, thorough: bool) -> bool:
    try:
        found = path.lstat()
    except OSError:
        return False
    if found.st_size != entry.size:
        return False
    if found.st_mtime_ns == entry.mtime_ns and not thorough:
        return True
    return path.is_file() and download.digests(path)["sha256"] == entry.sha256


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[Path]:
    """The folder for what is under way, for this process alone; removed at the end if it is empty."""
    work = folder / WORK
    try:
        work.mkdir(parents=True, exist_ok=True)
        handle = os.open(work / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise UserError(
            f"cannot write: {error.strerror}", path=folder, remedy="choose one with -o"
        ) from error
    try:
        _hold(handle, folder)
        try:
            yield work
        finally:
            with contextlib.suppress(OSError):
                if os.listdir(work) == ["lock"]:
                    (work / "lock").unlink()
                    work.rmdir()
    finally:
        os.close(handle)


def _hold(handle: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows has other locks; two fetches into one folder are then the user's affair
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise UserError("another fetch is at work here", path=folder, remedy="wait for it to end") from error
