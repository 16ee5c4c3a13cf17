"""A data set into a folder: what is there and verified stays, the rest is downloaded, checked, unpacked."""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .. import console, files
from ..errors import UserError
from . import download, unpack
from . import lock as locks
from .download import Arrived, Patience
from .lock import Lock, Source
from .registry import DataSet, File
from .unpack import Limits, Unpacked


@dataclass
class Result:
    """What a fetch did: addresses by what became of them, and what the sets' publishers say of them."""

    folder: Path
    downloaded: list[str] = field(default_factory=list)
    present: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    unverified: list[str] = field(default_factory=list)  # no checksum is published of these


def fetch(
    chosen: DataSet,
    folder: Path,
    *,
    parts: Sequence[str] = (),
    accept: Callable[[], bool],
    elsewhere: Path | None = None,
    thorough: bool = False,
    patience: Patience | None = None,
    limits: Limits | None = None,
) -> Result:
    """Bring a data set, or parts of it, into a folder.

    accept is asked once for the licence, unless the folder's lock file says that it was accepted. elsewhere
    is a folder with files that were downloaded by other means. thorough reads what is there and compares its
    checksums, instead of sizes and dates. A fault is a UserError; what was done until then stays and counts.
    """
    wanted = chosen.choose(parts)
    if files.kind(folder) not in (None, "folder"):
        raise UserError("not a folder", path=folder, remedy="choose another with -o")
    record = locks.read(folder, chosen.name)
    if record.licence != chosen.licence.name:
        if not accept():
            raise UserError("the licence was not accepted", remedy="nothing was downloaded")
        record.licence = chosen.licence.name
    result = Result(folder)
    with locks.alone(folder) as work:
        locks.write(folder, record)
        for left in work.iterdir():
            if left.is_dir():  # of a run that was killed while it unpacked
                shutil.rmtree(left)
        todo = _missing(wanted, folder, record, result, thorough)
        _check_places(todo, folder, record)
        download.check_room(folder, sum(file.size or 0 for file in todo))
        many = len(todo) > 3  # then the files are counted, else the bytes of each
        job = _Job(folder, work, record, result, elsewhere, patience, limits, quiet=many)
        for i, file in enumerate(console.progress(todo, label=chosen.name, unit="files") if many else todo):
            if i and chosen.series is not None and chosen.series.pause:
                time.sleep(chosen.series.pause)
            try:
                job.bring(file)
            finally:
                locks.write(folder, record)
    result.unverified = [
        file.address
        for file in wanted
        if file.address in record.sources and not (file.sha256 or record.sources[file.address].published)
    ]
    return result


def _missing(
    wanted: Sequence[File], folder: Path, record: Lock, result: Result, thorough: bool
) -> list[File]:
    """The files that are not there, or not as they were, or of which something else is now published."""
    todo = []
    for file in wanted:
        source = record.sources.get(file.address)
        stale = source is not None and file.sha256 is not None and source.sha256 != file.sha256
        if file.optional and file.address in record.missing and not thorough:
            result.missing.append(file.address)
        elif not stale and locks.whole(folder, record, file.address, thorough=thorough):
            result.present.append(file.address)
        else:
            todo.append(file)
    return todo


def _check_places(todo: Sequence[File], folder: Path, record: Lock) -> None:
    """Say before the work that something stands where a set's file or folder is to be put."""
    for file in todo:
        place = folder / file.into
        mine = {path for path, entry in record.files.items() if entry.address == file.address}
        for path in [place] if not place.is_dir() or place.is_symlink() else sorted(place.rglob("*")):
            inside = path.relative_to(folder).as_posix()
            if os.path.lexists(path) and inside not in mine and (path.is_symlink() or not path.is_dir()):
                what = "stands where fetched files are to be put, and was not fetched"
                raise UserError(what, path=path, remedy="move it, or choose another folder with -o")


@dataclass(frozen=True)
class _Job:
    """Bringing files into a folder, one after the other, and what is noted of them."""

    folder: Path
    work: Path
    record: Lock
    result: Result
    elsewhere: Path | None
    patience: Patience | None
    limits: Limits | None
    quiet: bool

    def bring(self, file: File) -> None:
        """Download a file, or take it from elsewhere, and put it, or what it holds, in its place."""
        target = self.work / f"{hashlib.sha256(file.address.encode()).hexdigest()[:8]}-{file.name}"
        try:
            # What an earlier run brought and could not unpack, for want of room, is not brought again.
            arrived = _copied(file, target, target) or self._arrived(file, target)
        except download.Missing:
            if not file.optional:
                raise
            self.result.missing.append(file.address)
            self.record.missing = sorted({*self.record.missing, file.address})
            return
        _compare(file, arrived, self.record, target)
        for one in self._place(file, target, arrived):
            entry = locks.held(self.folder, one.path, one.size, one.sha256, file.address)
            self.record.files[one.path] = entry
        self.record.sources[file.address] = Source(arrived.size, arrived.sha256, arrived.published)
        self.result.downloaded.append(file.address)

    def _arrived(self, file: File, target: Path) -> Arrived:
        elsewhere = None if self.elsewhere is None else self.elsewhere / file.name
        return _copied(file, target, elsewhere) or download.download(
            file.address,
            target,
            size=file.size,
            sha256=file.sha256,
            md5=file.md5,
            patience=self.patience,
            label="" if self.quiet else file.name,
        )

    def _place(self, file: File, target: Path, arrived: Arrived) -> list[Unpacked]:
        """The files that a download became."""
        place = self.folder / file.into
        if file.kind == "plain":
            self._remove_old(file)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(target, place)
            return [Unpacked(file.into, arrived.size, arrived.sha256)]
        new = self.work / "unpacked"
        try:
            inside = unpack.unpack(
                target,
                new,
                file.kind,
                strip=file.strip,
                keep=file.keep,
                limits=self.limits,
                label="" if self.quiet else f"unpacking {file.name}",
            )
        except unpack.BadArchive:
            target.unlink()
            raise
        self._remove_old(file)
        if place.is_dir():
            shutil.rmtree(place)  # nothing but empty folders is left in it
        place.parent.mkdir(parents=True, exist_ok=True)
        os.rename(new, place)
        target.unlink()
        return [Unpacked(f"{file.into}/{one.path}", one.size, one.sha256) for one in inside]

    def _remove_old(self, file: File) -> None:
        for path in [path for path, entry in self.record.files.items() if entry.address == file.address]:
            (self.folder / path).unlink(missing_ok=True)
            del self.record.files[path]


def _copied(file: File, target: Path, source: Path | None) -> Arrived | None:
    """The file from where it was brought by other means, checked; None if it is not there."""
    if source is None or files.kind(source) != "file":
        return None
    found = download.digests(source, ("sha256", "md5"))
    size = source.stat().st_size
    found["size"] = str(size)
    wanted = None if file.size is None else str(file.size)
    for kind, expected in (("size", wanted), ("sha256", file.sha256), ("md5", file.md5)):
        if expected is not None and found[kind] != expected:
            if source == target:
                target.unlink()
                return None
            what = f"its {kind} is {found[kind]}, published is {expected}"
            raise UserError(what, path=source, remedy=f"download it again from {file.address}")
    if source != target:
        download.check_room(target.parent, size)
        with files.atomic(target) as stream, open(source, "rb") as content:
            shutil.copyfileobj(content, stream, 1 << 20)
    published = "sha256" if file.sha256 else "md5" if file.md5 else None
    return Arrived(size, found["sha256"], published)


def _compare(file: File, arrived: Arrived, record: Lock, target: Path) -> None:
    """A UserError where nothing is published and the file differs from the one fetched first."""
    before = record.sources.get(file.address)
    if before is None or arrived.published is not None or before.sha256 == arrived.sha256:
        return
    target.unlink()
    raise UserError(
        f"{file.address}: its sha256 is {arrived.sha256}, when first fetched it was {before.sha256}",
        remedy="if the publisher has replaced it and you trust that, move the folder away to fetch it anew",
    )
