"""Where motion goes: the formats that clips are written in, and a file for each clip of a source."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from . import bvh, files, gltf, npz, sources
from .clip import Clip
from .errors import UserError

WRITERS: dict[str, Callable[..., None]] = {"bvh": bvh.write, "npz": npz.write, "glb": gltf.write}
"""Writers by the suffix of their files without its dot; each takes a path, a clip and unit_to_m."""


def write(
    path: Path,
    clip: Clip,
    *,
    unit_to_m: float | None = None,
    axes: tuple[str, str, str] = ("y", "z", "right"),
) -> None:
    """Write a clip in the format of path's suffix, whole or not at all.

    axes (up, forward, handedness) are those that the clip is in, for formats that say so; .glb has ours.
    """
    form = suffix_of(path)
    if form == "npz":
        npz.write(path, clip, unit_to_m=unit_to_m, axes=axes)
    elif form == "glb" and axes != ("y", "z", "right"):
        raise UserError(
            "glTF files have Y up, +Z ahead, right-handed", path=path, remedy="leave out the axes"
        )
    else:
        WRITERS[form](path, clip, unit_to_m=unit_to_m)


def suffix_of(path: Path) -> str:
    """The format that a file's suffix names; a UserError lists the choices."""
    form = path.suffix.lower().removeprefix(".")
    if form not in WRITERS:
        *first, last = (f".{known}" for known in WRITERS)
        choices = f"{', '.join(first)} or {last}"
        raise UserError(
            f"cannot write {path.suffix} files", path=path, remedy=f"name a {choices} file, or a folder"
        )
    return form


def targets(
    source: Path, target: Path, *, form: str | None = None, others: Iterable[str | None] = ()
) -> dict[Path, Path]:
    """For each clip of source the file to write; refuses to write over an input or two clips into one file.

    form is one of `WRITERS`, by default that of target's suffix, or bvh. A folder's files keep their places
    in it; several animations of a file go into a folder of its name. others are files that are read, too.
    """
    found = sources.find([source])
    whole, there = files.kind(source) == "folder", files.kind(target)
    single = not whole and bool(target.suffix) and there != "folder"
    if single and form not in (None, suffix_of(target)):
        raise UserError(f"not a .{form} file", path=target, remedy="leave out --format, or name another file")
    if single and len(found) > 1:
        what = f"{source} holds {len(found)} animations"
        raise UserError(what, path=target, remedy=f"name a folder, or one of them, such as {found[0].name}")
    if whole and (there == "file" or target.suffix.lower().removeprefix(".") in WRITERS):
        raise UserError("not a folder", path=target, remedy=f"{source} is a folder, so name one to write to")
    above = source if whole else source.parent
    pairs = {clip: target if single else target / _inside(clip, above, form or "bvh") for clip in found}
    taken: dict[Path, Path] = {}
    inputs = {os.path.realpath(sources.split(clip)[0]) for clip in found}
    others = list(others)
    for clip, out in pairs.items():
        if os.path.realpath(out) in inputs:
            raise UserError("would write over its source", path=clip, remedy="name another place to write to")
        if out in taken:
            raise UserError(
                f"would be written to {out}, as would {taken[out]}", path=clip, remedy="convert them apart"
            )
        taken[out] = clip
        files.check_output(out, inputs=others)
    return pairs


def _inside(clip: Path, above: Path, form: str) -> Path:
    """Where a clip goes in the folder to write to, by where it lies below another."""
    file, animation = sources.split(clip)
    place = file.relative_to(above).with_suffix("")
    place = place if animation is None else place / animation
    return place.with_name(f"{place.name}.{form}")
