"""Where motion comes from: any supported file as a clip, and the files that a list of sources names."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from . import asfamc, bvh, gltf, kinematics, npz, units
from . import roles as role_guess
from .clip import Clip
from .errors import UserError
from .files import kind


@dataclass(frozen=True)
class Format:
    """How to read a format.

    Attributes
    ----------
    read : the clip of a file; where files hold several animations, of one of them by its label.
    knows_unit : whether clips come in metres or in the file's unknown unit.
    animations : the labels of a file's animations, for formats whose files may hold several.
    """

    read: Callable[..., Clip]
    knows_unit: bool
    animations: Callable[[Path], list[str]] | None = None


FORMATS: dict[str, Format] = {
    ".bvh": Format(bvh.read, knows_unit=False),
    ".amc": Format(asfamc.read, knows_unit=True),
    ".npz": Format(npz.read, knows_unit=True),
    ".gltf": Format(gltf.read, knows_unit=True, animations=gltf.animations),
    ".glb": Format(gltf.read, knows_unit=True, animations=gltf.animations),
}
_SEVERAL = "|".join(re.escape(suffix) for suffix, form in FORMATS.items() if form.animations)
_ADDRESS = re.compile(rf"(.*?(?:{_SEVERAL}))#(.+)", re.IGNORECASE | re.DOTALL)


def _choices() -> str:
    return f"the formats are {', '.join(sorted(FORMATS))}"


def split(path: str | os.PathLike[str]) -> tuple[Path, str | None]:
    """A clip's file, and its animation where the path names one behind ``#``, as ``hero.glb#Walk`` does."""
    address = _ADDRESS.fullmatch(os.fspath(path))
    if address is not None and kind(path) == "file":  # whose own name reads so
        address = None
    return (Path(path), None) if address is None else (Path(address[1]), address[2])


def name_of(path: str | os.PathLike[str]) -> str:
    """The name of a clip by its path: the animation's, or else the file's stem."""
    file, animation = split(path)
    return animation or file.stem


def folders_of(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """What tells clips of one name apart: the folders they lie in, nearest first; animations, their file."""
    file, animation = split(path)
    return (file.stem,) * (animation is not None) + file.parts[-2::-1]


def load_all(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    unit_to_m: float | None = None,
    roles: Mapping[str, int] | None = None,
) -> list[Clip]:
    """All clips of a motion file, each as `load` gives it: one, or every animation of a glTF file."""
    paths = clips_of(path, strict=True)
    return [load(one, fps=fps, unit_to_m=unit_to_m, roles=roles) for one in paths]


def clips_of(path: str | os.PathLike[str], *, strict: bool = False) -> list[Path]:
    """The paths of a file's clips: its own, or one an animation where it holds several (``hero.glb#Walk``).

    A file that cannot be read is a UserError when strict, else its own path stands for it.
    """
    file, animation = split(path)
    form = FORMATS.get(file.suffix.lower())
    if form is None or form.animations is None or animation is not None:
        return [Path(path)]
    try:
        labels = form.animations(file)
    except UserError:
        if strict:
            raise
        return [file]
    return [Path(f"{file}#{label}") for label in labels] if len(labels) > 1 else [file]


def load(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    unit_to_m: float | None = None,
    roles: Mapping[str, int] | None = None,
) -> Clip:
    """Read a motion file of any supported format: in metres, roles set, rotations unrolled.

    Of a glTF file with several animations one is named behind ``#``: ``hero.glb#Walk``. fps replaces the
    file's frame rate, unit_to_m the unit found, roles the roles guessed.
    """
    path, animation = split(path)
    if kind(path) is None:
        raise UserError("no such file", path=path, remedy="check the path")
    form = FORMATS.get(path.suffix.lower())
    if form is None:
        raise UserError("not a motion file", path=path, remedy=_choices())
    for name, value in (("fps", fps), ("unit_to_m", unit_to_m)):
        if value is not None and not 0 < value < math.inf:
            raise UserError(f"{name} is {value}", path=path, remedy="give a positive number")
    rate = {} if fps is None else {"fps": float(fps)}
    clip = form.read(path, **rate) if animation is None else form.read(path, animation, **rate)
    middle = len(clip) // 2
    if roles is None and clip.skeleton.roles:
        roles = clip.skeleton.roles
    elif roles is None:
        pose, _ = kinematics.forward(clip.skeleton, clip.positions[middle], clip.rotations[middle])
        roles = role_guess.guess(clip.skeleton, pose)
    clip = clip.replace(skeleton=clip.skeleton.with_roles(roles))
    if unit_to_m is None:
        # A pose speaks: offsets may be stale where position channels replace them.
        unit_to_m = clip.unit_to_m if form.knows_unit else units.guess(clip.skeleton, clip.positions[middle])
    return units.to_metres(clip, unit_to_m)


def find(
    sources: Iterable[str | os.PathLike[str]] | str | os.PathLike[str], *, exclude: Sequence[str] = ()
) -> list[Path]:
    """Clips of motion files that sources (files and folders, searched to any depth) name, sorted, each once.

    A file with several animations is named once for each, see `clips_of`. Those whose name, or path from the
    source on, matches one of the shell patterns in exclude are left out. A missing path, a folder
    without clips, a file of another format, or a pattern that matches nothing is a UserError. Hidden files
    and folders inside a source are passed over.
    """
    if isinstance(sources, (str, os.PathLike)):
        sources = [sources]
    roots = list(map(Path, sources))
    found: dict[str, Path] = {}
    for source in roots:
        file, animation = split(source)
        what = kind(file)
        if what == "folder" and animation is None:
            files = [
                Path(folder, name)
                for folder, subfolders, names in os.walk(source, onerror=_unreadable)
                if subfolders.sort() is None
                for name in names
                if _is_motion(name) and not _hidden(Path(folder, name), source)
            ]
            if not files:
                raise UserError("no clips in this folder", path=source, remedy=_choices())
        elif what == "file":
            if file.suffix.lower() not in FORMATS:
                raise UserError("not a motion file", path=source, remedy=_choices())
            files = [source]
        elif what is not None:
            raise UserError("not a regular file", path=source, remedy=_choices())
        else:
            raise UserError("no such file or folder", path=source, remedy="check the path")
        for file in files:
            for clip in clips_of(file):
                found.setdefault(os.path.realpath(clip), clip)
    if not found:
        raise UserError("no sources given", remedy="name motion files or folders")
    return _without(sorted(found.values()), roots, exclude)


def names(clips: Iterable[Path], roots: Sequence[Path]) -> dict[Path, set[str]]:
    """By what a pattern may name each clip: its name, and its path from a source on."""
    return {
        clip: {name_of(clip), *(clip.relative_to(s).as_posix() for s in roots if clip.is_relative_to(s))}
        for clip in clips
    }


def _without(files: list[Path], sources: list[Path], patterns: Sequence[str]) -> list[Path]:
    known = names(files, sources)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for several in known.values() for name in several):
            some = ", ".join(name_of(file) for file in files[:5]) + ", ..." * (len(files) > 5)
            raise UserError(f"no clip to exclude is named like {pattern!r}", remedy=f"the clips are {some}")
    kept = [f for f in files if not any(fnmatchcase(name, p) for name in known[f] for p in patterns)]
    if not kept:
        raise UserError(f"all {len(files)} clips are excluded", remedy="exclude fewer")
    return kept


def inputs(sources: Iterable[str | os.PathLike[str]] | str | os.PathLike[str]) -> list[Path]:
    """All files that may be read for the sources, skeletons beside AMC files too: nothing to write over."""
    found = sorted({split(path)[0] for path in find(sources)})
    folders = dict.fromkeys(file.parent for file in found if file.suffix.lower() == ".amc")
    skeletons = [file for folder in folders for file in sorted(folder.glob("*.[aA][sS][fF]"))]
    lent = dict.fromkeys(npz.skeleton_file(file) for file in found if file.suffix.lower() == ".npz")
    return [*found, *skeletons, *filter(None, lent)]


def _is_motion(name: str) -> bool:
    """Whether a file's name is that of a motion: no rest pose or shape of a body that lies beside these."""
    lends = any(fnmatchcase(name.lower(), pattern) for pattern in npz.NOT_CLIPS)
    return Path(name).suffix.lower() in FORMATS and not lends


def _unreadable(error: OSError) -> None:
    what = f"cannot read this folder: {error.strerror}"
    raise UserError(what, path=error.filename, remedy="change its permissions") from error


def _hidden(path: Path, source: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(source).parts)
