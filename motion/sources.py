"""Where motion comes from: any supported file as a clip, and the files that a list of sources names."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from . import asfamc, bvh, kinematics, units
from . import roles as role_guess
from .clip import Clip
from .errors import UserError
from .files import kind


@dataclass(frozen=True)
class Format:
    """How to read a format; knows_unit says whether clips come in metres or in the file's unknown unit."""

    read: Callable[[Path], Clip]
    knows_unit: bool


FORMATS: dict[str, Format] = {
    ".bvh": Format(bvh.read, knows_unit=False),
    ".amc": Format(asfamc.read, knows_unit=True),
}


def _choices() -> str:
    return f"the formats are {', '.join(sorted(FORMATS))}"


def load(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    unit_to_m: float | None = None,
    roles: Mapping[str, int] | None = None,
) -> Clip:
    """Read a motion file of any supported format: in metres, roles set, rotations unrolled.

    fps replaces the file's frame rate, unit_to_m the unit found, roles the roles guessed.
    """
    path = Path(path)
    if kind(path) is None:
        raise UserError("no such file", path=path, remedy="check the path")
    form = FORMATS.get(path.suffix.lower())
    if form is None:
        raise UserError("not a motion file", path=path, remedy=_choices())
    for name, value in (("fps", fps), ("unit_to_m", unit_to_m)):
        if value is not None and not 0 < value < math.inf:
            raise UserError(f"{name} is {value}", path=path, remedy="give a positive number")
    clip = form.read(path)
    middle = len(clip) // 2
    if roles is None:
        pose, _ = kinematics.forward(clip.skeleton, clip.positions[middle], clip.rotations[middle])
        roles = role_guess.guess(clip.skeleton, pose)
    clip = clip.replace(skeleton=clip.skeleton.with_roles(roles))
    if fps is not None:
        clip = clip.replace(fps=float(fps))
    if unit_to_m is None:
        # A pose speaks: offsets may be stale where position channels replace them.
        unit_to_m = clip.unit_to_m if form.knows_unit else units.guess(clip.skeleton, clip.positions[middle])
    return units.to_metres(clip, unit_to_m)


def find(
    sources: Iterable[str | os.PathLike[str]] | str | os.PathLike[str], *, exclude: Sequence[str] = ()
) -> list[Path]:
    """Motion files that sources (files and folders, searched to any depth) name, sorted, each once.

    Those whose stem, or path from the source on, matches one of the shell patterns in exclude are left out.
    A missing path, a folder without clips, a file of another format, or a pattern that matches nothing is a
    UserError. Hidden files and folders inside a source are passed over.
    """
    if isinstance(sources, (str, os.PathLike)):
        sources = [sources]
    roots = list(map(Path, sources))
    found: dict[str, Path] = {}
    for source in roots:
        what = kind(source)
        if what == "folder":
            files = [
                Path(folder, name)
                for folder, subfolders, names in os.walk(source, onerror=_unreadable)
                if subfolders.sort() is None
                for name in names
                if Path(name).suffix.lower() in FORMATS and not _hidden(Path(folder, name), source)
            ]
            if not files:
                raise UserError("no clips in this folder", path=source, remedy=_choices())
        elif what == "file":
            if source.suffix.lower() not in FORMATS:
                raise UserError("not a motion file", path=source, remedy=_choices())
            files = [source]
        elif what == "other":
            raise UserError("not a regular file", path=source, remedy=_choices())
        else:
            raise UserError("no such file or folder", path=source, remedy="check the path")
        for file in files:
            found.setdefault(os.path.realpath(file), file)
    if not found:
        raise UserError("no sources given", remedy="name motion files or folders")
    return _without(sorted(found.values()), roots, exclude)


def _without(files: list[Path], sources: list[Path], patterns: Sequence[str]) -> list[Path]:
    names = {
        file: {file.stem, *(file.relative_to(s).as_posix() for s in sources if file.is_relative_to(s))}
        for file in files
    }
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for known in names.values() for name in known):
            some = ", ".join(file.stem for file in files[:5]) + ", ..." * (len(files) > 5)
            raise UserError(f"no clip to exclude is named like {pattern!r}", remedy=f"the clips are {some}")
    kept = [f for f in files if not any(fnmatchcase(name, p) for name in names[f] for p in patterns)]
    if not kept:
        raise UserError(f"all {len(files)} clips are excluded", remedy="exclude fewer")
    return kept


def inputs(sources: Iterable[str | os.PathLike[str]] | str | os.PathLike[str]) -> list[Path]:
    """All files that may be read for the sources, skeletons beside AMC files too: nothing to write over."""
    found = find(sources)
    folders = dict.fromkeys(file.parent for file in found if file.suffix.lower() == ".amc")
    return [*found, *(file for folder in folders for file in sorted(folder.glob("*.[aA][sS][fF]")))]


def _unreadable(error: OSError) -> None:
    what = f"cannot read this folder: {error.strerror}"
    raise UserError(what, path=error.filename, remedy="change its permissions") from error


def _hidden(path: Path, source: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(source).parts)
