"""``python -m motion``: look at motion files, find the roles of their joints, convert them."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import console, options
from .checking.cli import check
from .dancecard_cli import dancecard
from .fetching.cli import fetch
from .options import AXIS, FORWARD, HAND, ROLES, SOURCE_UNIT, TIME, Length, source_axes
from .retarget_cli import retarget

if TYPE_CHECKING:
    from .clip import Clip


@console.group("motion", "Motion files: look at them, find their joints' roles, convert them.")
def main() -> None:
    pass


main.add_command(fetch)
main.add_command(check)
main.add_command(retarget)
main.add_command(dancecard)


@main.command(epilog="Example: python -m motion info clips/walk.bvh clips/cmu --json")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@options.FPS
@SOURCE_UNIT
@source_axes
@ROLES
@console.json_option
def info(
    files: tuple[str, ...],
    fps: float | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
    as_json: bool,
) -> None:
    """Frames, rate, unit, speeds and turns of motion FILES (folders are searched).

    Speeds and path are of the hips over the ground, in m/s and m; forward_share and left_share are the
    cosines between where the hips face, and their left, and where they go; net_turn_deg is positive to the
    left.
    """
    from .statistics import statistics

    system = source_up, source_forward, source_handedness
    rows = []
    for path, clip in options.clips(
        files, label="reading", fps=fps, unit_to_m=source_unit, axes=system, roles=roles
    ):
        with options.about(path):
            rows.append({"file": str(path), **statistics(clip)})
    if as_json:
        console.print_json([{key: _rounded(value) for key, value in row.items()} for row in rows])
    else:
        console.print_table(*_short_paths(rows))


@main.command("roles", epilog="Example: python -m motion roles rig.bvh --roles mine.toml")
@click.argument("file", type=click.Path())
@ROLES
@console.json_option
def show_roles(file: str, roles: str | None, as_json: bool) -> None:
    """The roles found in FILE: which joint is the hips, a foot, a hand, ...

    Where the guess is wrong, write a TOML file with a table [roles] and lines such as
    left_foot = "LeftAnkle" (an empty name removes a role), and give it to --roles.
    """
    from .roles import ROLES as known

    (_, clip) = next(options.clips((file,), label="reading", roles=roles))
    skeleton = clip.skeleton
    found = {role: skeleton.names[joint] for role, joint in skeleton.roles.items()}
    if as_json:
        idle = [name for name in skeleton.names if name not in found.values()]
        absent = [role for role in known if role not in found]
        console.print_json({"file": file, "roles": found, "absent": absent, "other_joints": idle})
        return
    console.print_table([{"role": role, "joint": found.get(role)} for role in known])


@dataclass(frozen=True)
class Changes:
    """What `convert` does to each clip, in this order."""

    keep_lead_in: bool
    start: float | None
    stop: float | None
    joints: tuple[str, ...]
    fit: Clip | None
    fps: float | None
    ground: bool
    mirror: bool
    axes: tuple[str, str, str]

    def drops_lead_in(self, clip: Clip) -> bool:
        """Whether first frames are left out, for they are a rest pose."""
        from .leadin import lead_in

        whole = self.start is None and self.stop is None
        return whole and not self.keep_lead_in and lead_in(clip) > 0

    def apply(self, clip: Clip) -> Clip:
        """The changed clip."""
        from . import axes, leadin, mirror, resample, root, subset

        if self.start is not None or self.stop is not None:
            last = len(clip) if self.stop is None else min(round(self.stop * clip.fps), len(clip))
            clip = resample.crop(clip, round((self.start or 0) * clip.fps), last)
        elif not self.keep_lead_in:
            clip = leadin.without_lead_in(clip)
        if self.joints:
            clip = subset.subset(clip, self.joints)
        if self.fit is not None:
            clip = subset.fit(clip, self.fit.skeleton)
        if self.fps is not None:
            clip = resample.resample(clip, self.fps)
        if self.ground:
            clip = root.ground(clip)
        if self.mirror:
            clip = mirror.mirror(clip)
        up, forward, handedness = self.axes
        return axes.convert(clip, up=up, forward=forward, handedness=handedness)


@main.command(epilog="Example: python -m motion convert clips/cmu -o out --fps 60 --unit cm --ground")
@click.argument("source", metavar="IN", type=click.Path())
@click.argument("target", metavar="[OUT]", required=False, type=click.Path())
@click.option("-o", "--output", type=click.Path(), metavar="OUT", help="The same as the argument OUT.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["bvh", "npz", "glb"]),
    help="Format to write.  [default: as OUT ends, or bvh]",
)
@click.option("--fps", type=console.RATE, help="Frame rate to resample to.  [default: as read]")
@click.option("--start", type=TIME, metavar="SECONDS", help="Cut off what comes before this time.")
@click.option("--stop", type=TIME, metavar="SECONDS", help="Cut off what comes after this time.")
@click.option("--keep-lead-in", is_flag=True, help="Keep a rest pose (T-pose) in front of the capture.")
@click.option("--mirror", is_flag=True, help="Mirror the motion: exchange left and right.")
@click.option("--ground", is_flag=True, help="Add a root joint that travels on the ground and faces forward.")
@click.option("--joints", metavar="NAMES", help="Keep these joints only, separated by commas.")
@click.option(
    "--fit",
    type=click.Path(),
    metavar="FILE",
    help="Take the bone lengths of this file, which must have the same joints.",
)
@click.option(
    "--unit",
    type=Length(),
    help="Unit to write: m, cm, mm, inch, foot, or its size in metres.  [default: as read; .npz: m]",
)
@click.option("--up", type=AXIS, default="y", show_default=True, help="Up axis to write.")
@click.option("--forward", type=AXIS, help=f"Axis that characters face, to write.  {FORWARD}")
@click.option("--handedness", type=HAND, default="right", show_default=True, help="Handedness to write.")
@options.SOURCE_FPS
@SOURCE_UNIT
@source_axes
@ROLES
def convert(
    source: str,
    target: str | None,
    output: str | None,
    form: str | None,
    fps: float | None,
    start: float | None,
    stop: float | None,
    keep_lead_in: bool,
    mirror: bool,
    ground: bool,
    joints: str | None,
    fit: str | None,
    unit: float | None,
    up: str,
    forward: str | None,
    handedness: str,
    source_fps: float | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
) -> None:
    """Convert the motion file IN, or all in the folder IN, to the file (.bvh, .npz, .glb) or folder OUT.

    An .npz file keeps everything: all digits, and which joint plays which role. One animation of a glTF file
    with several is named as hero.glb#Walk; to convert all of them give a folder as OUT.
    """
    from . import writers
    from .axes import system

    if (target is None) == (output is None):
        raise click.UsageError("give one place to write to, as OUT or with -o")
    names = tuple(name.strip() for name in (joints or "").split(",") if name.strip())
    if joints is not None and not names:
        raise click.UsageError("--joints names no joint")
    target = str(target or output)
    pairs = writers.targets(Path(source), Path(target), form=form, others=(roles, fit))
    changes = Changes(
        keep_lead_in=keep_lead_in,
        start=start,
        stop=stop,
        joints=names,
        fit=None if fit is None else options.model(fit, roles=roles)[0],
        fps=fps,
        ground=ground,
        mirror=mirror,
        axes=system(up, forward, handedness),
    )
    clips = options.clips(
        tuple(map(str, pairs)),
        roots=(source,),
        label="converting",
        fps=source_fps,
        unit_to_m=source_unit,
        axes=(source_up, source_forward, source_handedness),
        roles=roles,
    )
    cut = 0
    for path, clip in clips:
        with options.about(path):
            cut += changes.drops_lead_in(clip)
            changed = changes.apply(clip)
        writers.write(pairs[path], changed, unit_to_m=unit, axes=changes.axes)
    if cut:
        what = (
            f"{cut} of {len(pairs)} files begin with a rest pose that is no capture; its frames are left out"
        )
        click.echo(f"note: {what} (--keep-lead-in keeps them)", err=True)
    click.echo(f"wrote {len(pairs)} file{'s' * (len(pairs) != 1)} to {target}", err=True)


def _short_paths(rows: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], str | None]:
    """On a terminal the folder that all files are in goes into the table's title."""
    alike = len({Path(row["file"]).is_absolute() for row in rows}) == 1
    folder = os.path.commonpath([Path(row["file"]).parent for row in rows]) if alike else ""
    if not folder or not console.is_terminal(sys.stdout):
        return rows, None
    return [{**row, "file": os.path.relpath(row["file"], folder)} for row in rows], f"in {folder}"


def _rounded(value: Any) -> Any:
    return round(value, 7) if isinstance(value, float) else value
