"""What is shown, as files for other programs: motion with the body that is seen, and runs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mm.recording import Recording
from motion import bvh, files, gltf, resample
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import distinct

from . import skin
from .cast import Member
from .shows import Recorded

FORMS = (".bvh", ".glb", ".rec")


def check(path: str | os.PathLike[str]) -> None:
    """A UserError for a name that says none of the forms."""
    if Path(path).suffix.lower() not in FORMS:
        raise UserError("motion is not exported so", path=path, remedy=f"name it *{', *'.join(FORMS)}")


def write(
    members: Sequence[Member], path: str, *, start: float = 0.0, stop: float | None = None
) -> list[Path]:
    """Write the motion of all who are shown as path's suffix says; of several each to a file that bears its
    name, and of a run its number, too.

    .glb holds the body or skin, too; .rec a run with all of its characters. A clip has no run: that is a
    UserError, as is who ends before the start; then nothing is written.
    """
    out = Path(path)
    check(out)
    form = out.suffix.lower()
    who = [(each, k) for each in members for k in range(1 if form == ".rec" else each.show.count)]
    names = [m.name if form == ".rec" or m.show.count == 1 else f"{m.name}-{k + 1}" for m, k in who]
    paths = [out if len(who) == 1 else out.with_name(f"{out.stem}-{n}{out.suffix}") for n in distinct(names)]
    made = [_run(m, start, stop) if form == ".rec" else _clip(m, k, start, stop) for m, k in who]
    for target in paths:
        files.check_output(target)
    for (member, _), thing, target in zip(who, made, paths, strict=True):
        if isinstance(thing, Recording):
            thing.save(target)
        elif form == ".glb":
            gltf.write(target, thing, skin=_worn(member))
        else:
            bvh.write(target, thing, decimals=5)
    return paths


def _clip(member: Member, character: int, start: float, stop: float | None) -> Clip:
    assert isinstance(member.show, Recorded)
    clip = member.show.clip(character)
    return resample.crop(clip, *_frames(member.name, clip.fps, len(clip), start, stop))


def _run(member: Member, start: float, stop: float | None) -> Recording:
    if member.run is None:
        what = f"{member.name} is a clip, of which there is no run"
        raise UserError(what, remedy="export it as .bvh or .glb")
    run = member.run
    part = slice(*_frames(member.name, run.fps, len(run), start, stop))
    return replace(
        run,
        arrays={name: array[part] for name, array in run.arrays.items()},
        step_seconds=run.step_seconds[part],
        stage_seconds=run.stage_seconds[part],
    )


def _frames(name: str, fps: float, count: int, start: float, stop: float | None) -> tuple[int, int]:
    first = round(start * fps)
    last = count if stop is None else min(round(stop * fps) + 1, count)
    if first >= last:
        raise UserError(f"nothing of {name} from {start:g} s on", remedy=f"it lasts {count / fps:.2f} s")
    return first, last


def _worn(member: Member) -> gltf.Skin:
    """The skin that it wears, or else its body as one."""
    show = member.show
    if show.skin is None:
        return skin.of_body(show.body, show.skeleton)
    return skin.on(show.skin, show.skeleton)
