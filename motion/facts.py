"""What files state wrongly or do not state at all: told once for all clips, or by rules for some of them.

A file of rules, ``clips.toml``::

    [[clips]]
    files = "labelled/*"
    fps = 60

    [[clips]]
    files = "inches/*"
    unit = "inch"
    up = "z"

Rules are read in order, and a later one goes before an earlier one, key by key.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal

from . import axes, config, files, sources
from . import roles as role_maps
from .clip import Clip
from .errors import UserError
from .lengths import LENGTHS

NAME = "clips.toml"  # of the file of rules that lies in a folder of clips
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_EXAMPLE = 'write tables [[clips]] with files = "walk*" and what is to be said of them, such as fps = 60'


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What is told about a clip; None where its file is believed.

    Attributes
    ----------
    fps : its frames per second.
    unit : its unit of length, a name of `motion.lengths.LENGTHS` or metres.
    up, forward, handedness : its axes.
    roles : role to joint name, over the roles guessed; in files also a roles file's path.
    start, stop : the first frame to use and one past the last, frames as read.
    keep_lead_in : whether a rest pose that stands before the capture is motion, too.
    check : whether `motion.check` may leave out frames of it.
    """

    fps: float | None = None
    unit: str | float | None = None
    up: Axis | None = None
    forward: Axis | None = None
    handedness: Literal["right", "left"] | None = None
    roles: dict[str, str] | Path | None = None
    start: int | None = None
    stop: int | None = None
    keep_lead_in: bool | None = None
    check: bool | None = None

    def __post_init__(self) -> None:
        config.validate(self)
        if self.fps is not None and not 0 < self.fps < math.inf:
            raise config.ConfigError(
                "fps", f"{self.fps:g} frames per second", remedy="give a positive number"
            )
        if isinstance(self.unit, str) and self.unit not in LENGTHS:
            what = f"{config.shown(self.unit)} is no unit"
            raise config.ConfigError("unit", what, remedy=f"give {', '.join(LENGTHS)} or metres a unit")
        if isinstance(self.unit, float) and not 0 < self.unit < math.inf:
            raise config.ConfigError("unit", f"{self.unit:g} metres", remedy="give a positive number")
        if min(self.start or 0, self.stop or 0) < 0 or (self.start or 0) >= (self.stop or math.inf):
            key = "start" if self.stop is None else "stop"
            raise config.ConfigError(key, f"frames {self.start or 0} to {self.stop or 'the end'} are none")
        try:
            axes.system(*self.axes)
        except UserError as error:
            raise config.ConfigError("up", error.what, remedy=error.remedy) from error

    @property
    def axes(self) -> tuple[str, str | None, str]:
        """Up, forward and handedness; forward None where up decides it."""
        return self.up or "y", self.forward, self.handedness or "right"

    def over(self, other: Facts) -> Facts:
        """These facts, and the other's where these say nothing."""
        own = {f.name: getattr(self, f.name) for f in fields(Facts)}
        rest = {name: getattr(other, name) for name, value in own.items() if value is None}
        return Facts(**{**own, **rest})


def of_all(
    *,
    fps: float | None = None,
    unit: str | float | None = None,
    up: str | None = None,
    forward: str | None = None,
    handedness: str | None = None,
    roles: Mapping[str, str] | str | os.PathLike[str] | None = None,
) -> Facts:
    """Facts about all clips, as options give them; roles of a file are read."""
    told = role_maps.load_overrides(roles) if isinstance(roles, str | os.PathLike) else dict(roles or {})
    return Facts(
        fps=fps,
        unit=unit,
        up=up,  # type: ignore[arg-type]
        forward=forward,  # type: ignore[arg-type]
        handedness=handedness,  # type: ignore[arg-type]
        roles=told,
    )


@dataclass(frozen=True, kw_only=True)
class Rule(Facts):
    """Facts about the clips whose name or path matches a shell pattern.

    Attributes
    ----------
    files : the pattern; ``*`` and ``?`` stand for any letters, slashes too. Paths begin behind the source, or
        with its own name.
    exclude : whether these clips are left out; None where an earlier rule decides.
    """

    files: str
    exclude: bool | None = None


@dataclass(frozen=True)
class _File:
    clips: tuple[Rule, ...]


@dataclass(frozen=True)
class Book:
    """The facts of many clips.

    Attributes
    ----------
    common : facts of all clips, to which rules for some go before.
    told : path to the rules' facts, for clips that a rule matches.
    excluded : the clips that rules leave out.
    notes : remarks for the user: which files of rules were read.
    """

    common: Facts = field(default_factory=Facts)
    told: Mapping[Path, Facts] = field(default_factory=dict)
    excluded: frozenset[Path] = frozenset()
    notes: tuple[str, ...] = ()

    def of(self, path: Path) -> Facts:
        """What is known of the clip at a path."""
        told = self.told.get(path)
        return self.common if told is None else told.over(self.common)


def book(
    clips: Sequence[Path],
    roots: Iterable[str | os.PathLike[str]],
    *,
    rules: str | os.PathLike[str] | None = None,
    common: Facts | None = None,
) -> Book:
    """The facts of clips that `motion.sources.find` found in some sources.

    Rules are those of `NAME` in the folders searched, the outer folder's first, then those of the file given.
    In the first, paths are those from the folder on. A rule that matches no clip, and a clip that would be
    left out with all others, are UserErrors.
    """
    tops = list(map(Path, roots))
    told: dict[Path, Facts] = {}
    excluded: dict[Path, bool] = {}
    notes = []
    scopes: list[tuple[Path, list[Path], list[Path]]] = [
        (path, [path.parent], [clip for clip in clips if clip.is_relative_to(path.parent)])
        for path in found(clips, tops)
    ]
    if rules is not None:
        scopes.append((Path(rules), [*tops, *(top.parent for top in tops)], list(clips)))
    for path, above, under in scopes:
        names = sources.names(under, above)
        matched: set[Path] = set()
        for rule in load(path):
            reached = [clip for clip in under if any(fnmatchcase(n, rule.files) for n in names[clip])]
            if not reached:
                some = ", ".join(sources.name_of(clip) for clip in under[:5]) + ", ..." * (len(under) > 5)
                what = f"no clip is named like {rule.files!r}"
                raise UserError(what, path=path, remedy=f"the clips are {some}")
            matched.update(reached)
            for clip in reached:
                told[clip] = rule.over(told.get(clip, Facts()))
                if rule.exclude is not None:
                    excluded[clip] = rule.exclude
        notes.append(f"{path} has rules for {len(matched)} of {len(clips)} clips")
    gone = frozenset(clip for clip, left_out in excluded.items() if left_out)
    if gone and len(gone) == len(clips):
        raise UserError(f"all {len(clips)} clips are excluded", path=scopes[-1][0], remedy="exclude fewer")
    return Book(common or Facts(), told, gone, tuple(notes))


def found(clips: Iterable[Path], roots: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """The files of rules in the folders that were searched for clips, the outer folder's first."""
    folders = _folders(clips, list(map(Path, roots)))
    return [folder / NAME for folder in folders if files.kind(folder / NAME) == "file"]


def inputs(rules: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Files of rules and the roles files that they name: nothing to write over."""
    paths = list(map(Path, rules))
    named = [(path.parent, rule.roles) for path in paths for rule in config.load(_File, path).clips]
    return [*paths, *(folder / roles for folder, roles in named if isinstance(roles, Path))]


def load(path: str | os.PathLike[str]) -> tuple[Rule, ...]:
    """Rules of a TOML file, its roles files read; a missing or malformed one is a UserError with its key."""
    rules = config.load(_File, path).clips
    if not rules:
        raise UserError("no rules in this file", path=path, remedy=_EXAMPLE)
    folder = Path(path).parent
    return tuple(
        replace(rule, roles=role_maps.load_overrides(folder / rule.roles))
        if isinstance(rule.roles, Path)
        else rule
        for rule in rules
    )


def read(path: str | os.PathLike[str], facts: Facts) -> Clip:
    """A motion file as a clip, in metres and our axes, roles set; untrimmed.

    Frames to start and stop at that the file does not have are a UserError, too.
    """
    unit = LENGTHS[facts.unit] if isinstance(facts.unit, str) else facts.unit
    clip = sources.load(path, fps=facts.fps, unit_to_m=unit)
    if facts.roles:
        told = facts.roles if isinstance(facts.roles, dict) else role_maps.load_overrides(facts.roles)
        try:
            clip = clip.replace(skeleton=role_maps.apply(clip.skeleton, told))
        except UserError as error:
            raise UserError(error.what, path=path, remedy=error.remedy) from error
    if max((facts.start or 0) + 1, facts.stop or 0) > len(clip):
        what = f"frames {facts.start or 0} to {facts.stop or 'the end'} of a clip of {len(clip)}"
        raise UserError(what, path=path, remedy="correct start and stop in the file of rules")
    up, forward, handedness = axes.system(*facts.axes)
    if (up, forward, handedness) == ("y", "z", "right"):
        return clip
    return axes.convert(clip, up=up, forward=forward, handedness=handedness, inverse=True)


def _folders(clips: Iterable[Path], roots: Sequence[Path]) -> list[Path]:
    """The folders searched that clips lie in, sources themselves included, outer ones first."""
    found: set[Path] = set()
    for folder in {clip.parent for clip in clips}:
        for root in roots:
            if folder.is_relative_to(root) and files.kind(root) == "folder":
                inside = folder.relative_to(root).parts
                found.update(root.joinpath(*inside[:depth]) for depth in range(len(inside) + 1))
    return sorted(found, key=lambda folder: (len(folder.parts), folder))
