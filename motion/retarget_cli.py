"""``python -m motion retarget``: clips on the skeleton of another file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from . import console, options
from .errors import UserError


@click.command(epilog="Example: python -m motion retarget clips/cmu --to hero.bvh -o out")
@click.argument("sources", nargs=-1, required=True, metavar="IN...", type=click.Path())
@click.option(
    "--to",
    "rig",
    required=True,
    type=click.Path(),
    metavar="FILE",
    help="Motion file of the skeleton to use.",
)
@click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="OUT", help="File or folder to write."
)
@options.rig_axes("to")
@click.option("--no-feet", is_flag=True, help="Do not hold the feet on the ground where the source's rest.")
@click.option("--keep-lead-in", is_flag=True, help="Keep a rest pose (T-pose) in front of the capture.")
@options.SOURCE_FPS
@options.SOURCE_UNIT
@options.source_axes
@options.ROLES
@click.option(
    "--to-roles", type=click.Path(), metavar="FILE", help="TOML file: the same for the skeleton's joints."
)
def retarget(
    sources: tuple[str, ...],
    rig: str,
    output: str,
    to_file: dict[str, Any],
    no_feet: bool,
    keep_lead_in: bool,
    source_fps: float | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
    to_roles: str | None,
) -> None:
    """Put the motion of IN (files and folders) on another skeleton, that of a motion file.

    Joints are paired by the roles that they play (see `roles`). Limbs keep the skeleton's lengths; height and
    travel are scaled by the ratio of leg lengths; feet stand still where they did. Joints without a
    counterpart follow their parents. Where zero rotations are no standing pose, the files' motion tells how
    the skeletons stand, so FILE had better hold some walking, or begin with a T-pose. What is written has
    the unit and the axes of FILE (an .npz file: metres).
    """
    from . import anatomy, leadin, writers
    from . import retarget as retargeting

    others = (rig, roles, to_roles)
    pairs = _pairs(sources, Path(output), others)
    system = source_up, source_forward, source_handedness
    model, theirs = options.model(rig, **to_file, roles=to_roles)
    with options.about(Path(rig)):
        target = anatomy.anatomy(model.skeleton, [model])
    found, paths = [], []
    for path, clip in options.clips(
        tuple(map(str, pairs)),
        roots=sources,
        label="reading",
        fps=source_fps,
        unit_to_m=source_unit,
        axes=system,
        roles=roles,
    ):
        paths.append(path)
        found.append(clip if keep_lead_in else leadin.without_lead_in(clip))
    for path, clip in zip(paths, found, strict=True):
        with options.about(path):
            anatomy.require_roles(clip.skeleton)
    bodies = anatomy.anatomies(found)
    work = list(zip(paths, found, bodies, strict=True))
    for path, clip, body in console.progress(work, label="retargeting", unit="files"):
        with options.about(path):
            moved = retargeting.retarget(clip, target, source=body, feet=not no_feet)
        moved = theirs.clip_to(moved).replace(unit_to_m=model.unit_to_m)
        writers.write(pairs[path], moved, axes=(theirs.up, theirs.forward, theirs.handedness))
    click.echo(f"wrote {len(pairs)} file{'s' * (len(pairs) != 1)} to {output}", err=True)


def _pairs(sources: tuple[str, ...], output: Path, others: tuple[str | None, ...]) -> Mapping[Path, Path]:
    """For each clip the file to write; a UserError where two would be written to one."""
    from . import writers

    if len(sources) > 1 and output.suffix.lower().removeprefix(".") in writers.WRITERS:
        raise UserError("not a folder", path=output, remedy="name a folder for several sources")
    pairs: dict[Path, Path] = {}
    taken: dict[Path, Path] = {}
    for source in sources:
        for path, out in writers.targets(Path(source), output, others=others).items():
            if taken.setdefault(out, path) != path:
                what = f"would be written to {out}, as would {taken[out]}"
                raise UserError(what, path=path, remedy="retarget them apart")
            pairs[path] = out
    return pairs
