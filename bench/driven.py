"""``python -m bench courses``: what systems do on each course, one after another, and what the course is."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from motion import console

from .options import CODECS, MODELS, Listed, check_models, check_outputs, load

if TYPE_CHECKING:
    from lmm.models import AnyModel
    from mm.course import Course
    from mm.database import Database

    from .entry import Entry

TABLES = ("summary.csv", "courses.csv", "summary.json", "report.html")


@click.command(epilog="Example: python -m bench courses walk.mmdb --courses circle,star -o out/courses")
@click.argument("db", type=click.Path())
@click.option(
    "--courses", type=Listed(), metavar="A,B", help="Names or files of courses.  [default: all ready-made]"
)
@click.option(
    "--systems",
    type=Listed(),
    metavar="A,B",
    help="Names, families or patterns.  [default: exact motion matching, and models]",
)
@MODELS
@CODECS
@click.option(
    "--seconds", type=console.SECONDS, default=40.0, show_default=True, help="Of each course, at most."
)
@click.option(
    "--scale/--no-scale", default=True, show_default=True, help="Bring course speeds to the data's."
)
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write tables and pictures there.")
@console.json_option
def courses(
    db: str,
    courses: tuple[str, ...] | None,
    systems: tuple[str, ...] | None,
    models: tuple[str, ...],
    codecs: tuple[str, ...],
    seconds: float,
    scale: bool,
    output: str | None,
    as_json: bool,
) -> None:
    """How systems do on each course: distance from the way, facing, speed, response, feet.

    Courses may be files, too, of what a user once did (`python -m mm courses --help`). It is `compare` with a
    row a course for a few systems, and no more than that: cost, memory and film strips are in the report that
    -o writes, beside a picture of each course as it was played, COURSE.png.
    """
    from mm import courses as library

    from . import comparison as comparing
    from . import report, tables
    from . import systems as registry

    folder = None if output is None else Path(output)
    loaded = [library.load(name) for name in courses or library.names()]
    if folder is not None:
        check_outputs(folder, (*TABLES, *(f"{course.name}.png" for course in loaded)))
    learned = registry.load_models(models) if models else {}
    registry.choose(systems, models=learned, codecs=codecs)
    database = load(db)
    check_models(learned, models, database)
    chosen = systems or tuple(entry.name for entry in standard(database, learned))
    result = comparing.compare(
        database,
        courses=loaded,
        systems=chosen,
        models=learned,
        codecs=codecs,
        seconds=seconds,
        scale=scale,
        name=db,
        progress=True,
    )
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(tables.to_json(result, command=command))
    else:
        order = [course.name for course in loaded]
        rows = result.courses.sort_values("course", key=lambda c: c.map(order.index), kind="stable")
        console.print_table(report.brief(rows[["course", *rows.columns.drop("course")]]), title=db)
        for line in result.notes:
            print(f"note: {line}")
    if folder is not None:
        for path in (*report.save(result, folder, command=command), *save_pictures(result.played, folder)):
            print(f"wrote {path}", file=sys.stderr)


def standard(database: Database, models: Mapping[str, AnyModel]) -> list[Entry]:
    """Systems to look at first: motion matching by exact search, and models that take no database to run.

    They hold the feet where legs are whole.
    """
    from .entry import called
    from .systems import choose, without_legs

    legs = without_legs(database) is None
    return choose([called("mm-exact", legs)]) + [e for e in choose(models=models, legs=legs) if e.alone]


def save_pictures(played: Sequence[Course], folder: Path) -> list[Path]:
    """Draw courses as they were played."""
    from mm.drawing import draw

    paths = [folder / f"{course.name}.png" for course in played]
    for course, path in zip(played, paths, strict=True):
        draw(course, path)
    return paths
