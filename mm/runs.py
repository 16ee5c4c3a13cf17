"""What commands that drive characters share: their options, the drive, what is written and told of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from motion import console
from motion.errors import UserError
from motion.options import AXIS, FORWARD, HAND, ROLES, Length, about, model, rig_axes

from .options import heightmap, on_heights

if TYPE_CHECKING:
    from features.terrain import Heightmap
    from motion.anatomy import Anatomy

    from .control import Described
    from .course import Course
    from .description import Description
    from .recording import Recording
    from .rigged import Rigged

# How many characters of a crowd are kept when no recording is asked for: enough for the summary.
KEPT = 16

_OPTIONS = (
    click.option(
        "--course",
        "course_name",
        required=True,
        metavar="NAME|FILE",
        help="A ready-made course (`python -m mm courses` lists them), or a file: TOML, or what a user did "
        "(.rec, .csv, .bin).",
    ),
    click.option(
        "-o", "--output", type=click.Path(), metavar="OUT", help="Motion file to write: .bvh, .npz or .glb."
    ),
    click.option(
        "--record",
        "tape",
        type=click.Path(),
        metavar="FILE",
        help="Recording to write: all characters and all that was searched, for `viewer` and `bench data`.",
    ),
    click.option("--count", type=console.COUNT, default=1, show_default=True, help="Number of characters."),
    click.option(
        "--character",
        type=click.IntRange(0),
        default=0,
        show_default=True,
        help="Which character -o writes.",
    ),
    click.option("--spread", is_flag=True, help="Start characters at different points of the course."),
    click.option(
        "--seconds",
        type=console.SECONDS,
        help="Stop after this time.  [default: when the course is done]",
    ),
    click.option(
        "--walk",
        type=console.SPEED,
        help="Speed where the course walks, m/s.  [default: the data's walking speed]",
    ),
    click.option(
        "--run",
        "running",
        type=console.SPEED,
        help="Speed where it runs, m/s.  [default: the data's running speed]",
    ),
    click.option("--size", type=console.SIZE, help="Make the course larger by this factor.  [default: 1]"),
    click.option("--as-written", is_flag=True, help="Do not adapt the course's speeds to the data."),
    click.option(
        "--settings",
        type=click.Path(),
        metavar="FILE",
        help="TOML file with the controller's settings (`python -m mm settings`).",
    ),
    click.option(
        "--no-foot-lock", is_flag=True, help="Let feet slide instead of locking them to the ground."
    ),
    click.option(
        "--require-tag",
        multiple=True,
        metavar="NAME",
        help="Play only frames that have this tag.  [repeatable]",
    ),
    click.option(
        "--forbid-tag", multiple=True, metavar="NAME", help="Play no frames that have this tag.  [repeatable]"
    ),
    on_heights,
    click.option(
        "--rig",
        type=click.Path(),
        metavar="FILE",
        help="Put the motion on the skeleton of this motion file, at run time; -o writes the result.",
    ),
    rig_axes("rig"),
    ROLES,
    click.option(
        "--up", type=AXIS, default="y", show_default=True, help="Up axis of the file that -o writes."
    ),
    click.option("--forward", type=AXIS, help=f"Axis that characters face in that file.  {FORWARD}"),
    click.option(
        "--handedness", type=HAND, default="right", show_default=True, help="Handedness of that file."
    ),
    click.option(
        "--unit",
        type=Length(),
        default="m",
        show_default=True,
        help="Unit of that file: m, cm, mm, inch, foot, or its size in metres.",
    ),
    console.json_option,
)


class Driven(NamedTuple):
    """What drives characters.

    controller makes it of count, settings (an object of the class of that name) and obstacles; of a ground
    too, where it sees grounds. Who does not is put on a ground afterwards (`mm.grounded`).
    """

    description: Description
    controller: Callable[..., Described]
    settings: type
    sees_ground: bool = False


def options(command: Callable) -> Callable:
    """Options of a command that drives characters over a course; `perform` takes them."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def perform(
    load: Callable[[], Driven],
    given: dict[str, str | None],
    *,
    output: str | None,
    tape: str | None,
    character: int,
    heights: str | None,
    heights_spacing: float | None,
    rig: str | None,
    rig_file: dict[str, Any],
    roles: str | None,
    up: str,
    forward: str | None,
    handedness: str,
    unit: float,
    as_json: bool,
    **chosen: Any,
) -> None:
    """Drive characters, write what was asked for, and print the summary.

    load : gives what drives; it is called when faults in the options have been found.
    given : what the command was given, for the summary; its files are not written over.
    """
    from motion import axes, bvh, writers

    if rig is None and roles is not None:
        raise click.UsageError("--roles are those of the rig's joints: give --rig FILE too")
    if rig is None and rig_file != {"unit": None, "up": "y", "forward": None, "handedness": "right"}:
        raise click.UsageError("--rig-unit and --rig-up are about the rig's file: give --rig FILE too")
    if rig is not None and heights is not None:
        raise click.UsageError("rigs stand on level ground: leave out --heights, or --rig")
    up, forward, handedness = axes.system(up, forward, handedness)
    convention = axes.Convention(up=up, forward=forward, handedness=handedness)
    inputs = (*given.values(), chosen["settings"], heights, rig, roles)
    check_outputs((output, tape), inputs, chosen["course_name"])
    form = output and writers.suffix_of(Path(output))
    if character >= chosen["count"]:
        raise UserError(f"no character {character}", remedy=f"there are {chosen['count']}, counted from 0")
    keep = None if tape else max(character + 1, KEPT)
    ground, driven = heightmap(heights, heights_spacing), load()
    body = None if rig is None else _rig(rig, roles, rig_file)
    recording, shown = _drive(driven, keep=keep, ground=ground, rig=rig, body=body, **chosen)
    if output:
        clip = recording.clip(character) if shown is None else shown.clip(recording, character)
        moved = convention.clip_to(clip)
        if form == "bvh":
            bvh.write(output, moved, decimals=5, unit_to_m=unit)
        else:
            writers.write(Path(output), moved, unit_to_m=unit, axes=(up, forward, handedness))
    if tape:
        recording.save(tape)
    facts = {**given, **summarise(recording, chosen["count"])}
    facts |= {"heights": heights, "rig": rig, "output": output, "recording": tape}
    if as_json:
        console.print_json(facts)
    else:
        console.print_table(
            [{"": name, "value": value} for name, value in facts.items() if value is not None]
        )


def check_outputs(
    outputs: tuple[str | None, ...], inputs: tuple[str | None, ...], course: str | None
) -> None:
    """A UserError where an output cannot be written, or is an input or another output."""
    from motion import files

    from . import courses as library

    taken = [*inputs, None if course in library.names() else course]
    for output in filter(None, outputs):
        files.check_output(output, inputs=taken)
        taken.append(output)


def _rig(file: str, roles: str | None, reading: dict[str, Any]) -> Anatomy:
    """The anatomy of a motion file's skeleton."""
    from motion.anatomy import anatomy

    clip, _ = model(file, **reading, roles=roles)
    with about(Path(file)):
        return anatomy(clip.skeleton, [clip])


def _drive(
    driven: Driven,
    *,
    ground: Heightmap | None,
    rig: str | None,
    body: Anatomy | None,
    course_name: str,
    count: int,
    spread: bool,
    seconds: float | None,
    settings: str | None,
    no_foot_lock: bool,
    require_tag: tuple[str, ...],
    forbid_tag: tuple[str, ...],
    keep: int | None,
    **scaling: Any,
) -> tuple[Recording, Rigged | None]:
    from dataclasses import replace
    from functools import partial

    from motion import config

    from . import courses as library
    from .driver import Driver
    from .grounded import on_ground
    from .recording import record
    from .rigged import Rigged

    chosen: Any = config.load(driven.settings, settings) if settings else driven.settings()
    if no_foot_lock:
        chosen = replace(chosen, foot_lock=False)
    course = fitted(library.load(course_name), driven.description, **scaling)
    masks = driven.description.tag_mask(require_tag), driven.description.tag_mask(forbid_tag)
    make = partial(driven.controller, count=count, settings=chosen, obstacles=course.obstacles())
    controller = on_ground(make, ground, sees=driven.sees_ground)
    controller.check_tags(*masks)
    driver = Driver(
        course, count, controller.fps, spread=spread, required_tags=masks[0], forbidden_tags=masks[1]
    )
    rigged = None
    if rig is not None and body is not None:
        with about(Path(rig)):
            rigged = Rigged(controller, body)
    recording = record(rigged or controller, course, seconds=seconds, characters=keep, driver=driver)
    return recording, rigged


def fitted(
    course: Course,
    description: Description,
    *,
    walk: float | None = None,
    running: float | None = None,
    size: float | None = None,
    as_written: bool = False,
) -> Course:
    """A course at the speeds of the data, unless told others (`Course.scaled`)."""
    if as_written:
        if walk or running or size:
            raise UserError("as written and scaled at once", remedy="leave out --as-written, or the others")
        return course
    walk, running = walk or description.walk_mps or None, running or description.run_mps or None
    return course.scaled(walk=walk, run=running, size=size)


def summarise(recording: Recording, characters: int | None = None) -> dict[str, Any]:
    """What a run was like, in numbers; None where a number does not apply.

    Path error: mean distance of the characters to the nearest point of the course's way. Times are of the
    system's step, first the median, by character (those of the recording, if it does not keep all of them say
    how many there were); the first second is left out.
    """
    import numpy as np

    from .polyline import Polyline

    positions, _ = recording.roots()
    fps, arrays = recording.fps, recording.arrays
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps
    asked = np.linalg.norm(arrays["command_velocity"], axis=-1)
    warm = recording.step_seconds[min(round(fps), len(recording) - 1) :]
    each = 1e6 * warm / (characters or recording.count)
    error = None
    if recording.path is not None:
        error = 100 * float(Polyline(recording.path).distance(positions.reshape(-1, 2)).mean())
    per_second = fps / recording.count / len(recording)
    facts: dict[str, Any] = {
        "system": recording.system,
        "course": recording.course and recording.course.name,
        "description": recording.course and recording.course.description,
        "characters": characters or recording.count,
        "seconds": recording.seconds,
        "frames": len(recording),
        "speed_mps": float(moved.mean()) if len(moved) else None,
        "asked_speed_mps": float(asked.mean()),
        "path_error_cm": error,
        "searches_per_s": None,
        "transitions_per_s": None,
    }
    for flag, name in (("searched", "searches_per_s"), ("transition", "transitions_per_s")):
        if flag in arrays:
            facts[name] = float(arrays[flag].sum() * per_second)
    return facts | {
        "us_per_character": float(np.median(each)),
        "us_per_character_mean": float(each.mean()),
        "us_per_character_p99": float(np.percentile(each, 99)),
    }


def show_settings(settings: Any, output: str | None) -> None:
    """Print a controller's settings as TOML to edit, or write them to output."""
    from motion import templates

    text = templates.explained(settings)
    if output is None:
        click.echo(text, nl=False)
    else:
        check_outputs((output,), (), None)
        write_text(output, text)


def write_text(path: str, text: str) -> None:
    from motion import files

    with files.atomic(path, "w") as stream:
        stream.write(text)
