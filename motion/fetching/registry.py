"""The registry of data sets: what there is, on what terms, where, and what to expect of the files."""

from __future__ import annotations

import os
import re
import urllib.parse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import PurePosixPath
from typing import Literal

from .. import config
from ..config import ConfigError
from ..errors import UserError

_NAME = re.compile(r"[a-z0-9][a-z0-9-]*")
_TAKES = re.compile(r"(\d+)(?:-(\d+))?")


@dataclass(frozen=True)
class Licence:
    """The terms of a set: their name, what they allow in a line, where their text stands."""

    name: str
    allows: str
    address: str

    def __post_init__(self) -> None:
        config.validate(self)
        _check_address(self.address, "address")


@dataclass(frozen=True)
class File:
    """One download. An archive is unpacked into a folder, `into`; a plain file is put at `into`.

    size is in bytes; it and the checksums are absent where nobody publishes them. strip is the folder of the
    archive whose content is taken; keep are patterns of the paths below it to take (all, if empty).
    """

    address: str
    into: str
    kind: Literal["zip", "tar.gz", "plain"] = "plain"
    size: int | None = None
    sha256: str | None = None
    md5: str | None = None
    strip: str = ""
    keep: tuple[str, ...] = ()
    optional: bool = False  # a server that has no such file is no fault

    def __post_init__(self) -> None:
        config.validate(self)
        _check_address(self.address, "address")
        check_path(self.into, "into")
        if self.strip:
            check_path(self.strip, "strip")
        if self.size is not None and self.size < 1:
            raise ConfigError("size", "expected a number of bytes, at least 1")
        for name, digits in (("sha256", 64), ("md5", 32)):
            value = getattr(self, name)
            if value is not None and not re.fullmatch(rf"[0-9a-f]{{{digits}}}", value):
                raise ConfigError(name, f"expected {digits} hexadecimal digits in lower case")
        if self.kind == "plain" and (self.strip or self.keep):
            raise ConfigError("kind", "strip and keep are for archives", remedy="state kind = 'zip'")

    @property
    def name(self) -> str:
        """The file's own name, the last part of its address."""
        path = urllib.parse.unquote(urllib.parse.urlsplit(self.address).path)
        return re.sub(r"[^\w.+-]", "_", path.rstrip("/").rpartition("/")[2]) or "download"


@dataclass(frozen=True)
class Series:
    """Numbered files of numbered parts, such as a university's takes of its subjects.

    ``{part}`` and ``{take}`` in the patterns stand for a part's name and a take's number, the latter in at
    least two digits. takes gives the numbers of each part ("1-58", "1-3 7"); groups are ready-made choices of
    parts, one of which is the default. once are files that a part has one of (its skeleton). pause is the
    seconds to wait between two files, for the server's sake.
    """

    take: str
    once: tuple[str, ...]
    into: str
    takes: dict[str, str]
    default: str
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    part_name: str = "part"
    pause: float = 0.0

    def __post_init__(self) -> None:
        config.validate(self)
        check_path(self.into, "into")
        for part, text in self.takes.items():
            if not re.fullmatch(r"\w+", part):
                raise ConfigError(("takes", part), "expected a name of letters and digits")
            numbers(text, ("takes", part))
        for name, parts in self.groups.items():
            unknown = [part for part in parts if part not in self.takes]
            if unknown:
                raise ConfigError(("groups", name), f"no part {unknown[0]!r}")
        if self.default not in self.groups and self.default not in self.takes:
            raise ConfigError("default", f"no part or group {self.default!r}")
        try:
            list(self.files([self.default]))
        except (KeyError, IndexError, ValueError) as error:
            raise ConfigError("take", "only {part} and {take} can stand in braces") from error

    def chosen(self, names: Iterable[str]) -> list[str]:
        """The parts that names of parts and groups mean, once each; a number needs no leading zero."""
        parts: dict[str, None] = {}
        for name in names:
            found = next((n for n in (name, name.zfill(2)) if n in self.groups or n in self.takes), None)
            if found is None:
                raise UserError(f"no {self.part_name} {name!r}", remedy=f"choose from {self.summary()}")
            parts.update(dict.fromkeys(self.groups.get(found, (found,))))
        return list(parts)

    def files(self, names: Sequence[str]) -> Iterator[File]:
        """The files of the parts and groups named, of the default where none is."""
        for part in self.chosen(names or [self.default]):
            folder = self.into.format(part=part)
            for pattern in self.once:
                address = pattern.format(part=part)
                yield File(address=address, into=f"{folder}/{address.rpartition('/')[2]}")
            for take in numbers(self.takes[part], ("takes", part)):
                address = self.take.format(part=part, take=f"{take:02d}")
                yield File(address=address, into=f"{folder}/{address.rpartition('/')[2]}", optional=True)

    def summary(self) -> str:
        """The names that can be chosen, in a line."""
        return ", ".join([*self.groups, *self.takes])


@dataclass(frozen=True)
class Notes:
    """What a reader of the files should know: their skeleton, unit, rate, axes and traps."""

    joints: str = ""
    unit: str = ""
    fps: float | None = None
    up: str = "y"
    traps: tuple[str, ...] = ()


@dataclass(frozen=True)
class DataSet:
    """A data set: terms, files, notes, and the options that the other commands need for it."""

    name: str
    title: str
    holds: str
    homepage: str
    licence: Licence
    credit: str
    files: tuple[File, ...] = ()
    series: Series | None = None
    notes: Notes = field(default_factory=Notes)
    options: str = ""  # of ``motion info`` and ``motion convert``
    verified: str = ""  # where size and checksum come from, or why they are absent

    def __post_init__(self) -> None:
        config.validate(self)
        if not _NAME.fullmatch(self.name):
            raise ConfigError("name", f"{self.name!r} is no name", remedy="use a-z, 0-9 and dashes")
        _check_address(self.homepage, "homepage")
        if not self.files and self.series is None:
            raise ConfigError("files", "a set without files", remedy="give files or a series")
        taken: dict[str, int] = {}
        for i, file in enumerate(self.files):
            if taken.setdefault(file.into.casefold(), i) != i:
                raise ConfigError(("files", i, "into"), f"{file.into} is taken by another file")

    @property
    def size(self) -> int | None:
        """Bytes to download; None where some are not known."""
        sizes = [file.size for file in self.files]
        return None if self.series is not None or None in sizes else sum(filter(None, sizes))

    def choose(self, parts: Sequence[str]) -> list[File]:
        """The files to fetch, of the parts named where the set has parts."""
        if self.series is None:
            if parts:
                raise UserError(f"{self.name} has no parts to choose from", remedy="leave the option out")
            return list(self.files)
        return [*self.files, *self.series.files(parts)]


@dataclass(frozen=True)
class Registry:
    """Data sets by name."""

    sets: tuple[DataSet, ...]

    def __post_init__(self) -> None:
        config.validate(self)
        taken: dict[str, int] = {}
        for i, one in enumerate(self.sets):
            if taken.setdefault(one.name, i) != i:
                raise ConfigError(("sets", i, "name"), f"two sets are named {one.name!r}")

    def find(self, name: str) -> DataSet:
        """The set of a name; an unknown one is a UserError that lists the choices."""
        for one in self.sets:
            if one.name == name:
                return one
        raise UserError(f"no data set {name!r}", remedy=config.choices(one.name for one in self.sets))


def load(path: str | os.PathLike[str] | None = None) -> Registry:
    """The registry of a TOML file, or the built-in one."""
    if path is not None:
        return config.load(Registry, path)
    with resources.as_file(resources.files(__package__) / "registry.toml") as builtin:
        return config.load(Registry, builtin)


def numbers(text: str, key: config.Key = ()) -> list[int]:
    """The numbers of "1-3 7", in that order."""
    found: list[int] = []
    for word in text.split():
        match = _TAKES.fullmatch(word)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not first <= last < 10_000:
            raise ConfigError(key, f"{word!r} is no range", remedy="write ranges as in '1-3 7'")
        found.extend(range(first, last + 1))
        if len(found) > 100_000:
            raise ConfigError(key, "more than 100,000 numbers", remedy="name each once")
    if not found:
        raise ConfigError(key, "no number in it", remedy="write ranges as in '1-3 7'")
    return found


def _check_address(address: str, key: str) -> None:
    try:
        parts = urllib.parse.urlsplit(address)
        good = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        good = False
    if not good or not address.isascii() or re.search(r"[\s\x00-\x1f\x7f]", address):
        raise ConfigError(key, f"{config.shown(address)} is no address", remedy="give one with https://")


def check_path(text: str, key: str | config.Key) -> None:
    """A ConfigError unless text is a plain relative path, and not one that a set's folder needs itself."""
    path = PurePosixPath(text)
    strange = path.is_absolute() or not path.parts or ".." in path.parts or re.search(r"[\\:\x00-\x1f]", text)
    if strange or path.parts[0].casefold() in RESERVED:
        raise ConfigError(key, f"{config.shown(text)} is no place below the set's folder")


LOCK, WORK = "fetched.json", ".fetching"
RESERVED = (LOCK, WORK)
"""What a set's folder holds besides its files: the lock file, and a folder for what is under way."""
