"""``python -m mm run`` and ``courses``: drive a character over a course, and what courses there are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.errors import UserError

if TYPE_CHECKING:
    from .course import Course
    from .database import Database
    from .recording import Recording

POSITIVE = click.FloatRange(min=0, min_open=True)
# How many characters of a crowd are kept when no recording is asked for: enough for the summary.
KEPT = 16


@click.command(epilog="Example: python -m mm run walk.mmdb --course thesis -o lap.bvh")
@click.argument("db", type=click.Path())
@click.option(
    "--course", "course_name", required=True, metavar="NAME|FILE", help="See `courses`, or a TOML file."
)
@click.option("-o", "--output", type=click.Path(), metavar="OUT.bvh", help="Motion to write, in metres.")
@click.option("--record", "tape", type=click.Path(), metavar="FILE", help="Recording to write, of all of it.")
@click.option("--count", type=click.IntRange(1), default=1, show_default=True, help="Characters.")
@click.option("--character", type=click.IntRange(0), default=0, show_default=True, help="Which one to write.")
@click.option("--spread", is_flag=True, help="Let the characters start at different places or times.")
@click.option("--seconds", type=POSITIVE, help="Stop after this time.  [default: when the course is done]")
@click.option("--walk", type=POSITIVE, help="The course's walking speed, m/s.  [default: the data's]")
@click.option("--run", "running", type=POSITIVE, help="Its running speed, m/s.  [default: the data's]")
@click.option("--size", type=POSITIVE, help="Factor on its lengths.  [default: the course's own]")
@click.option("--as-written", is_flag=True, help="Leave speeds and lengths as the course has them.")
@click.option("--index", default="exact", show_default=True, help="Search index.")
@click.option(
    "--settings", type=click.Path(), metavar="FILE", help="TOML file with the controller's settings."
)
@click.option("--no-foot-lock", is_flag=True, help="Do not hold the feet on the ground.")
@console.json_option
def run(db: str, output: str | None, tape: str | None, character: int, as_json: bool, **options: Any) -> None:
    """Drive characters over a course by motion matching.

    DB is a database that `build` wrote. The course's speeds are scaled to those of the data.
    """
    from motion import bvh

    from .database import Database

    for path in filter(None, (output, tape)):
        if Path(path).is_dir():
            raise UserError("cannot write: it is a folder", path=path, remedy="name a file to write")
    if character >= options["count"]:
        raise UserError(f"no character {character}", remedy=f"there are {options['count']}, counted from 0")
    keep = None if tape else max(character + 1, KEPT)
    recording = _drive(Database.load(db), keep=keep, **options)
    if output:
        bvh.write(output, recording.clip(character), decimals=5)
    if tape:
        recording.save(tape)
    facts = {"database": db, **summarise(recording), "output": output, "recording": tape}
    facts["characters"] = options["count"]
    if as_json:
        console.print_json(facts)
    else:
        console.print_table(
            [{"": name, "value": value} for name, value in facts.items() if value is not None]
        )


def _drive(
    database: Database,
    *,
    course_name: str,
    count: int,
    spread: bool,
    seconds: float | None,
    index: str,
    settings: str | None,
    no_foot_lock: bool,
    keep: int | None,
    **scaling: Any,
) -> Recording:
    from dataclasses import replace

    from motion import config

    from . import course as library
    from .controller import Controller
    from .recording import record
    from .settings import Settings

    chosen = config.load(Settings, settings) if settings else Settings()
    if no_foot_lock:
        chosen = replace(chosen, foot_lock=False)
    course = fitted(library.load(course_name), database, **scaling)
    controller = Controller(database, count=count, settings=chosen, index=index, obstacles=course.obstacles())
    return record(controller, course, seconds=seconds, spread=spread, characters=keep)


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


def summarise(recording: Recording) -> dict[str, Any]:
    """What a run was like, in numbers; None where a number does not apply.

    Path error: mean distance of the characters to the nearest point of the course's way. Times are of the
    system's step with all characters, the first second left out.
    """
    import numpy as np

    from .polyline import Polyline

    positions, _ = recording.roots()
    fps, arrays = recording.fps, recording.arrays
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps
    asked = np.linalg.norm(arrays["command_velocity"], axis=-1)
    warm = recording.step_seconds[min(round(fps), len(recording) - 1) :]
    error = None
    if recording.path is not None:
        error = 100 * float(Polyline(recording.path).distance(positions.reshape(-1, 2)).mean())
    per_second = fps / recording.count / len(recording)
    facts: dict[str, Any] = {
        "system": recording.system,
        "course": recording.course.name,
        "description": recording.course.description,
        "characters": recording.count,
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
        "us_per_frame": 1e6 * float(warm.mean()),
        "us_per_frame_median": 1e6 * float(np.median(warm)),
        "us_per_frame_p99": 1e6 * float(np.percentile(warm, 99)),
    }


@click.command(epilog="Example: python -m mm courses thesis --plot thesis.png")
@click.argument("name", required=False, metavar="[NAME|FILE]")
@click.option("--plot", type=click.Path(), metavar="FILE.png", help="Draw the course.")
@click.option("--walk", type=POSITIVE, help="Scale its walking speed to this, m/s.")
@click.option("--run", "running", type=POSITIVE, help="Scale its running speed to this, m/s.")
@click.option("--size", type=POSITIVE, help="Factor on its lengths.")
@console.json_option
def courses(
    name: str | None,
    plot: str | None,
    walk: float | None,
    running: float | None,
    size: float | None,
    as_json: bool,
) -> None:
    """List the ready-made courses, or describe and draw one."""
    from . import course as library
    from .drawing import draw

    if plot and not name:
        raise UserError(
            "no course to draw", remedy=f"name one of {', '.join(library.names())}, or a TOML file"
        )
    chosen = [library.load(n) for n in ([name] if name else library.names())]
    if walk or running or size:
        chosen = [course.scaled(walk=walk, run=running, size=size) for course in chosen]
    rows = [_describe(course) for course in chosen]
    if as_json:
        console.print_json(rows if not name else {**rows[0], "course": chosen[0].to_dict()})
    else:
        console.print_table(rows)
    if plot:
        draw(chosen[0], plot)


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
