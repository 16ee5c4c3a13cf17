"""What is shown, as files for other programs: motion with the body that is seen, and runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mm.recording import Recording
from motion import bvh, files, gltf, resample
from motion.clip import Clip
from motion.errors import UserError

from . import skin
from .cast import Member
from .shows import Recorded


def write(
    members: Sequence[Member], path: str, *, start: float = 0.0, stop: float | None = None
) -> list[Path]:
    """Write each member's motion as path's suffix says; of several each to a file that bears its name, too.

    .bvh and .glb hold its first character, .glb also its body or skin; .rec holds the run with all of them.
    A clip has no run: that is a UserError.
    """
    out = Path(path)
    paths = [out if len(members) == 1 else out.with_name(f"{out.stem}-{m.name}{out.suffix}") for m in members]
    form = out.suffix.lower()
    for member, target in zip(members, paths, strict=True):
        files.check_output(target)
        if form == ".rec":
            _run(member, start, stop).save(target)
        elif form == ".glb":
            gltf.write(target, _clip(member, start, stop), skin=_worn(member))
        else:
            bvh.write(target, _clip(member, start, stop), decimals=5)
    return paths


def _clip(member: Member, start: float, stop: float | None) -> Clip:
    assert isinstance(member.show, Recorded)
    clip = member.show.clip()
    return resample.crop(clip, *_frames(clip.fps, len(clip), start, stop))


def _run(member: Member, start: float, stop: float | None) -> Recording:
    if member.run is None:
        what = f"{member.name} is a clip, of which there is no run"
        raise UserError(what, remedy="export it as .bvh or .glb")
    run = member.run
    part = slice(*_frames(run.fps, len(run), start, stop))
    return replace(
        run,
        arrays={name: array[part] for name, array in run.arrays.items()},
        step_seconds=run.step_seconds[part],
        stage_seconds=run.stage_seconds[part],
    )


def _frames(fps: float, count: int, start: float, stop: float | None) -> tuple[int, int]:
    first = round(start * fps)
    last = count if stop is None else min(round(stop * fps) + 1, count)
    if first >= last:
        raise UserError(f"nothing from {start:g} s on", remedy=f"it lasts {count / fps:.2f} s")
    return first, last


def _worn(member: Member) -> gltf.Skin:
    """The skin that it wears, or else its body as one."""
    show = member.show
    if show.skin is None:
        return skin.of_body(show.body, show.skeleton)
    return skin.on(show.skin, show.skeleton)
