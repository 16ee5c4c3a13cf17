"""``python -m mm run``, ``courses`` and ``settings``: drive characters, and what to drive them with."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.errors import UserError

from . import runs

if TYPE_CHECKING:
    from .codecs.compressed import Compressed
    from .course import Course
    from .database import Database


@click.command(epilog="Example: python -m mm run walk.mmdb --course thesis -o lap.bvh")
@click.argument("db", type=click.Path())
@runs.options
@click.option(
    "--index", default="exact", show_default=True, help="Search index; of 8-bit features also coded."
)
def run(db: str, index: str, **options: Any) -> None:
    """Drive characters over a course by motion matching.

    DB is a database that `build` wrote, or `compress`. The course's speeds are scaled to those of the data.
    With --rig each character poses a rig of other joints and lengths at run time, by the roles of its joints;
    the world is as much larger for it as its legs are longer. With --heights feet are put on uneven ground.

    \b
    A course file (`courses NAME -o FILE` writes a ready-made one to edit):
      closed = true
      waypoints = [{ position = [0, 0], speed = 1.4 },
                   { position = [4, 6], speed = 3.0, gait = "run" }]
    """

    runs.perform(lambda: of_data(load(db), index), {"database": db}, **options)


def load(path: str) -> Database | Compressed:
    """A database, compressed or not."""
    from motion import files

    from .codecs import compressed
    from .database import Database

    small = files.kind(path) == "file" and files.format_of(path) == compressed.KIND
    return (compressed.Compressed if small else Database).load(path)


def of_data(data: Database | Compressed, index: str = "exact") -> runs.Driven:
    """What drives by motion matching on a database."""
    from .codecs.stages import controller
    from .controller import Controller
    from .database import Database
    from .description import Description
    from .settings import Settings

    if isinstance(data, Database):
        description = Description.of(data, rigs=False)
        return runs.Driven(description, partial(Controller, data, index=index), Settings)
    return runs.Driven(data.description, partial(controller, data, index=index), Settings)


@click.command(
    epilog="\b\nExamples: python -m mm courses thesis --plot thesis.png\n"
    "          python -m mm courses thesis -o mine.toml",
)
@click.argument("name", required=False, metavar="[NAME|FILE]")
@click.option(
    "-o", "--output", type=click.Path(), metavar="FILE", help="Write the course as TOML, to edit it."
)
@click.option("--plot", type=click.Path(), metavar="FILE.png", help="Write a picture of the course.")
@click.option("--walk", type=console.SPEED, help="Speed where the course walks, m/s.")
@click.option("--run", "running", type=console.SPEED, help="Speed where it runs, m/s.")
@click.option("--size", type=console.SIZE, help="Make it larger by this factor.")
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
    """List the ready-made courses, or describe and draw one.

    FILE may be a course in TOML, or what a user once did: a recording of `run --record`; a CSV file with
    columns time, move_x, move_z (or time, velocity_x, velocity_z); or a log of the simulated character in the
    public reference's format (.bin). -o turns any of them into TOML.
    """
    from dataclasses import replace

    from motion import templates

    from . import courses as library
    from .drawing import draw

    if (plot or output) and not name:
        raise UserError(
            f"no course to {'draw' if plot else 'write'}",
            remedy=f"name one of {', '.join(library.names())}, or a TOML file",
        )
    runs.check_outputs((output, plot), (), name)
    chosen = [library.load(n) for n in ([name] if name else library.names())]
    if walk or running or size:
        chosen = [course.scaled(walk=walk, run=running, size=size) for course in chosen]
    rows = [_describe(course) for course in chosen]
    if plot:
        draw(chosen[0], plot)
    if output:  # a file's name is its course's
        runs.write_text(output, templates.compact(replace(chosen[0], name="")))
    if as_json:
        console.print_json(rows if not name else {**rows[0], "course": chosen[0].to_dict()})
    else:
        console.print_table(rows)


@click.command(epilog="Example: python -m mm settings -o mine.toml")
@click.option(
    "-o", "--output", type=click.Path(), metavar="FILE", help="Write to this file instead of printing."
)
def settings(output: str | None) -> None:
    """Print the controller's settings as TOML, with their defaults and explanations.

    Edit a copy and give it to `run --settings`; settings you leave out keep their defaults.
    """
    from .settings import Settings

    runs.show_settings(Settings(), output)


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
