"""``python -m mm run``, ``courses`` and ``settings``: drive characters, and what to drive them with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.errors import UserError
from motion.options import AXIS, FORWARD, HAND, ROLES, Length, about, model, rig_axes

if TYPE_CHECKING:
    from motion.anatomy import Anatomy

    from .course import Course
    from .database import Database
    from .recording import Recording
    from .rigged import Rigged

# How many characters of a crowd are kept when no recording is asked for: enough for the summary.
KEPT = 16


@click.command(epilog="Example: python -m mm run walk.mmdb --course thesis -o lap.bvh")
@click.argument("db", type=click.Path())
@click.option(
    "--course", "course_name", required=True, metavar="NAME|FILE", help="See `courses`, or a TOML file."
)
@click.option("-o", "--output", type=click.Path(), metavar="OUT", help="Motion to write, .bvh or .npz.")
@click.option("--record", "tape", type=click.Path(), metavar="FILE", help="Recording to write, of all of it.")
@click.option("--count", type=console.COUNT, default=1, show_default=True, help="Characters.")
@click.option("--character", type=click.IntRange(0), default=0, show_default=True, help="Which one to write.")
@click.option("--spread", is_flag=True, help="Let the characters start at different places or times.")
@click.option(
    "--seconds", type=console.SECONDS, help="Stop after this time.  [default: when the course is done]"
)
@click.option("--walk", type=console.SPEED, help="The course's walking speed, m/s.  [default: the data's]")
@click.option("--run", "running", type=console.SPEED, help="Its running speed, m/s.  [default: the data's]")
@click.option("--size", type=console.SIZE, help="Factor on its lengths.  [default: the course's own]")
@click.option("--as-written", is_flag=True, help="Leave speeds and lengths as the course has them.")
@click.option("--index", default="exact", show_default=True, help="Search index.")
@click.option(
    "--settings", type=click.Path(), metavar="FILE", help="TOML file with the controller's settings."
)
@click.option("--no-foot-lock", is_flag=True, help="Do not hold the feet on the ground.")
@click.option("--require-tag", multiple=True, metavar="NAME", help="Play frames with this tag.  [repeatable]")
@click.option("--forbid-tag", multiple=True, metavar="NAME", help="Play none with this tag.  [repeatable]")
@click.option(
    "--rig", type=click.Path(), metavar="FILE", help="Drive the skeleton of this motion file; -o writes that."
)
@rig_axes("rig")
@ROLES
@click.option("--up", type=AXIS, default="y", show_default=True, help="Axis that points up in OUT.")
@click.option("--forward", type=AXIS, help=f"Axis that characters face in it.  {FORWARD}")
@click.option("--handedness", type=HAND, default="right", show_default=True, help="Handedness of its axes.")
@click.option("--unit", type=Length(), default="m", show_default=True, help="m, cm, ... or metres a unit.")
@console.json_option
def run(
    db: str,
    output: str | None,
    tape: str | None,
    character: int,
    rig: str | None,
    rig_file: dict[str, Any],
    roles: str | None,
    up: str,
    forward: str | None,
    handedness: str,
    unit: float,
    as_json: bool,
    **options: Any,
) -> None:
    """Drive characters over a course by motion matching.

    DB is a database that `build` wrote. The course's speeds are scaled to those of the data. With --rig each
    character poses a rig of other joints and lengths at run time, by the roles of its joints; the world is
    as much larger for it as its legs are longer.

    \b
    A course file (`courses NAME -o FILE` writes a ready-made one to edit):
      closed = true
      waypoints = [{ position = [0, 0], speed = 1.4 },
                   { position = [4, 6], speed = 3.0, gait = "run" }]
    """
    from motion import axes, bvh, writers

    from .database import Database

    if rig is None and roles is not None:
        raise click.UsageError("--roles are those of the rig's joints: give --rig FILE too")
    if rig is None and rig_file != {"unit": None, "up": "y", "forward": None, "handedness": "right"}:
        raise click.UsageError("--rig-unit and --rig-up are about the rig's file: give --rig FILE too")
    up, forward, handedness = axes.system(up, forward, handedness)
    convention = axes.Convention(up=up, forward=forward, handedness=handedness)
    _check_outputs((output, tape), (db, options["settings"], rig, roles), options["course_name"])
    form = output and writers.suffix_of(Path(output))
    if character >= options["count"]:
        raise UserError(f"no character {character}", remedy=f"there are {options['count']}, counted from 0")
    keep = None if tape else max(character + 1, KEPT)
    database = Database.load(db)
    body = None if rig is None else _rig(rig, roles, rig_file)
    recording, shown = _drive(database, keep=keep, rig=rig, body=body, **options)
    if output:
        clip = recording.clip(character) if shown is None else shown.clip(recording, character)
        moved = convention.clip_to(clip)
        if form == "bvh":
            bvh.write(output, moved, decimals=5, unit_to_m=unit)
        else:
            writers.write(Path(output), moved, unit_to_m=unit, axes=(up, forward, handedness))
    if tape:
        recording.save(tape)
    facts = {"database": db, **summarise(recording, options["count"])}
    facts |= {"rig": rig, "output": output, "recording": tape}
    if as_json:
        console.print_json(facts)
    else:
        console.print_table(
            [{"": name, "value": value} for name, value in facts.items() if value is not None]
        )


def _check_outputs(
    outputs: tuple[str | None, ...], inputs: tuple[str | None, ...], course: str | None
) -> None:
    """A UserError where an output cannot be written, or is an input or another output."""
    from motion import files

    from . import course as library

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
    database: Database,
    *,
    rig: str | None,
    body: Anatomy | None,
    course_name: str,
    count: int,
    spread: bool,
    seconds: float | None,
    index: str,
    settings: str | None,
    no_foot_lock: bool,
    require_tag: tuple[str, ...],
    forbid_tag: tuple[str, ...],
    keep: int | None,
    **scaling: Any,
) -> tuple[Recording, Rigged | None]:
    from dataclasses import replace

    from motion import config

    from . import course as library
    from .controller import Controller
    from .driver import Driver
    from .recording import record
    from .rigged import Rigged
    from .settings import Settings

    chosen = config.load(Settings, settings) if settings else Settings()
    if no_foot_lock:
        chosen = replace(chosen, foot_lock=False)
    course = fitted(library.load(course_name), database, **scaling)
    masks = _tag_masks(database, require_tag, forbid_tag)
    controller = Controller(database, count=count, settings=chosen, index=index, obstacles=course.obstacles())
    driver = Driver(
        course, count, controller.fps, spread=spread, required_tags=masks[0], forbidden_tags=masks[1]
    )
    rigged = None
    if rig is not None and body is not None:
        with about(Path(rig)):
            rigged = Rigged(controller, body)
    recording = record(rigged or controller, course, seconds=seconds, characters=keep, driver=driver)
    return recording, rigged


def _tag_masks(database: Database, required: tuple[str, ...], forbidden: tuple[str, ...]) -> tuple[int, int]:
    """Bits of tags; a UserError where no frame can be played."""
    masks = database.tag_mask(required), database.tag_mask(forbidden)
    if not ((database.tags & masks[0] == masks[0]) & (database.tags & masks[1] == 0)).any():
        wanted = [f"with {', '.join(required)}"] * bool(required)
        wanted += [f"without {', '.join(forbidden)}"] * bool(forbidden)
        raise UserError(f"no frame {' and '.join(wanted)}", remedy="require or forbid fewer tags")
    return masks


def fitted(
    course: Course,
    database: Database,
    *,
    walk: float | None = None,
    running: float | None = None,
    size: float | None = None,
    as_written: bool = False,
) -> Course:
    """A course at a database's speeds, unless told others (`Course.scaled`)."""
    from . import speeds

    if as_written:
        if walk or running or size:
            raise UserError("as written and scaled at once", remedy="leave out --as-written, or the others")
        return course
    own = speeds.of_database(database)
    walk, running = walk or own[0] or None, running or own[1] or None
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


@click.command(
    epilog="Examples: python -m mm courses thesis --plot thesis.png python -m mm courses thesis -o mine.toml"
)
@click.argument("name", required=False, metavar="[NAME|FILE]")
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write the course as TOML, to edit.")
@click.option("--plot", type=click.Path(), metavar="FILE.png", help="Draw the course.")
@click.option("--walk", type=console.SPEED, help="Scale its walking speed to this, m/s.")
@click.option("--run", "running", type=console.SPEED, help="Scale its running speed to this, m/s.")
@click.option("--size", type=console.SIZE, help="Factor on its lengths.")
@console.json_option
def courses(
    name: str | None,
    output: str | None,
    plot: str | None,
    walk: float | None,
    running: float | None,
    size: float | None,
    as_json: bool,
) -> None:
    """List the ready-made courses, or describe and draw one."""
    from dataclasses import replace

    from motion import templates

    from . import course as library
    from .drawing import draw

    if (plot or output) and not name:
        raise UserError(
            f"no course to {'draw' if plot else 'write'}",
            remedy=f"name one of {', '.join(library.names())}, or a TOML file",
        )
    _check_outputs((output, plot), (), name)
    chosen = [library.load(n) for n in ([name] if name else library.names())]
    if walk or running or size:
        chosen = [course.scaled(walk=walk, run=running, size=size) for course in chosen]
    rows = [_describe(course) for course in chosen]
    if plot:
        draw(chosen[0], plot)
    if output:  # a file's name is its course's
        _write(output, templates.compact(replace(chosen[0], name="")))
    if as_json:
        console.print_json(rows if not name else {**rows[0], "course": chosen[0].to_dict()})
    else:
        console.print_table(rows)


@click.command(epilog="Example: python -m mm settings -o mine.toml")
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write them there.")
def settings(output: str | None) -> None:
    """The controller's settings as TOML: their defaults, and what they mean.

    An edited copy goes to `run --settings`; it need not name all of them.
    """
    from motion import templates

    from .settings import Settings

    text = templates.explained(Settings())
    if output is None:
        click.echo(text, nl=False)
    else:
        _check_outputs((output,), (), None)
        _write(output, text)


def _write(path: str, text: str) -> None:
    from motion import files

    with files.atomic(path, "w") as stream:
        stream.write(text)


def _describe(course: Course) -> dict[str, Any]:
    from .driver import Driver
    from .polyline import Polyline

    driver = Driver(course)
    kind = next(k for k in ("waypoints", "stick", "velocity", "random") if getattr(course, k))
    length = None if driver.path is None else Polyline(driver.path).length * course.laps
    return {
        "name": course.name,
        "kind": kind,
        "seconds": driver.nominal,
        "metres": length,
        "description": course.description,
    }
