"""``python -m bench compare``: the run that says which system to take."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mm import options
from motion import console, files

from .options import CODECS, MODELS, Listed, check_models, note, open_database

if TYPE_CHECKING:
    from mm.database import Database

    from .plan import Plan

PRESETS = ("smoke", "quick", "full")
FILES = ("summary.csv", "summary.json", "courses.csv", "report.html")


@click.command(epilog="Example: python -m bench compare walk.mmdb --models models/ --quick -o report")
@click.argument("sources", nargs=-1, required=True, type=click.Path())
@click.option(
    "--courses", type=Listed(), metavar="A,B", help="Names or TOML files.  [default: seven of them]"
)
@click.option("--systems", type=Listed(), metavar="A,B", help="Names, families or patterns: mm, mm-*-free.")
@click.option(
    "--indexes",
    type=Listed(),
    metavar="A,B",
    help="Search indexes of motion matching.  [default: exact, or all with --systems]",
)
@MODELS
@click.option(
    "--models",
    "folder_of_models",
    type=click.Path(),
    metavar="DIR",
    help="Folder of models: those in it that were trained from this database.",
)
@click.option(
    "--train",
    type=click.Choice(PRESETS),
    help="Train what models lack of the kinds that systems are asked for of, all three by default.",
)
@CODECS
@click.option("--quick", is_flag=True, help="Two minutes: fewer and shorter courses, smaller crowds.")
@click.option("--seconds", type=console.SECONDS, help="Of each course, at most.  [default: 40]")
@click.option(
    "--repeats", type=click.IntRange(1, 1000), help="Seeds: starts, or random users, a course.  [default: 3]"
)
@click.option(
    "--seed", type=click.IntRange(0, 2**32 - 1), help="Of the random user.  [default: the course's own]"
)
@click.option(
    "--scale/--no-scale", default=True, show_default=True, help="Bring course speeds to the data's."
)
@click.option(
    "--counts", type=Listed(int), metavar="A,B", help="Characters of crowds.  [default: 1,16,256,1024,4096]"
)
@click.option(
    "--crowd-systems", type=Listed(), metavar="A,B", help="Whose crowds.  [default: one of each kind]"
)
@click.option("--no-crowds", is_flag=True, help="Leave crowds out.")
@options.on_heights
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write tables and report there.")
@options.building
@console.json_option
def compare(
    sources: tuple[str, ...],
    courses: tuple[str, ...] | None,
    systems: tuple[str, ...] | None,
    indexes: tuple[str, ...] | None,
    models: tuple[str, ...],
    folder_of_models: str | None,
    train: str | None,
    codecs: tuple[str, ...],
    quick: bool,
    seconds: float | None,
    repeats: int | None,
    seed: int | None,
    scale: bool,
    counts: tuple[int, ...] | None,
    crowd_systems: tuple[str, ...] | None,
    no_crowds: bool,
    heights: str | None,
    heights_spacing: float | None,
    output: str | None,
    as_json: bool,
    **chosen: Any,
) -> None:
    """Which system to take: memory, cost per frame and motion quality of every system over every course.

    SOURCES are clips and folders, or one database. With -o the folder gets summary.csv, courses.csv,
    summary.json, report.html, all tables in tables/ (as Parquet too, where pyarrow is installed), and the
    database where one was built. In work/ it keeps every run: a comparison that was interrupted goes on, and
    one with more systems measures these alone. Of another database, model, setting, version of this program
    or machine nothing is taken.

    Without --systems, --indexes or --codecs these are compared: motion matching by exact search, all ways to
    run the models, three compressed databases. Systems that end in -free do not hold the feet; where the
    skeleton lacks a joint of a leg only they run.

    With --model networks take the place of stages of motion matching, in all seven ways: lmm-PSD is learned
    projection, stepping and decompression, lmm-D the decompressor alone; lmm-D-free, by that name, does not
    hold the feet. A phase-functioned network runs as pfnn-cubic, pfnn-linear and pfnn-constant, a
    mode-adaptive one as mann-4, by its experts. lmm-PSD-bf16 and the like, by that name, multiply bfloat16
    numbers as crowds may (`bench crowd`), where the processor can; -fp32, -fp16, -int8 hold weights as such.

    Compressed databases run as mm-exact-quantised-11 and the like, by name, by pattern or with --codecs; with
    features of 8 bits as mm-coded-CODEC, too. With such systems or models every system's poses are held
    against those of the data, and those of mm-exact (or mm-exact-free, where only such run) under the same
    commands.

    Each course is driven from several starts, a random one by several users. Means stand with 95 % intervals,
    and the verdict calls a difference only what a paired test finds over the courses.

    With --heights all walk on uneven ground as with `mm run`; heights of feet are then those above what is
    beneath them, and how deep feet sink into the ground and how high they hover over it is told, too.
    """
    from mm import courses as known_courses

    from . import comparison as comparing
    from . import models as learning
    from . import report, tables
    from . import systems as registry

    folder = None if output is None else Path(output)
    if folder is not None:
        _check_folder(folder, (*sources, *models, *codecs, *filter(None, [heights])), chosen)
    place = folder_of_models or (str(folder / "models") if folder else None)
    if train and place is None:
        raise click.UsageError("a folder is needed to train models into: give --models DIR or -o DIR")
    # Faults in what was asked for come before the work, not after it.
    ground = options.heightmap(heights, heights_spacing)
    plan = _plan(quick, systems, indexes, codecs)
    given: dict[str, Any] = {"courses": courses, "seconds": seconds, "repeats": repeats, "crowd": counts}
    plan = replace(plan, **{name: value for name, value in given.items() if value is not None})
    loaded = [known_courses.load(name) for name in plan.courses]
    known = registry.load_models(models) if models else {}
    searched = None if systems and not indexes else plan.indexes
    if train is None and (place is None or files.kind(place) is None):
        registry.choose(systems, indexes=searched, models=known, codecs=plan.codecs)
    database, name = open_database(sources, folder and folder / "database.mmdb", chosen)
    if place is not None:
        models = _models(models, place, train, systems, database, sources)
        known = registry.load_models(models) if models else {}
    check_models(known, models, database)
    hours = {n: learning.training_hours(path) for n, path in zip(known, models, strict=True)}
    result = comparing.compare(
        database,
        courses=loaded,
        systems=systems,
        indexes=searched,
        models=known,
        codecs=plan.codecs,
        seconds=plan.seconds,
        timed_seconds=plan.timed_seconds,
        seed=seed,
        repeats=plan.repeats,
        crowd=() if no_crowds else plan.crowd,
        crowd_systems=crowd_systems,
        crowd_seconds=plan.crowd_seconds,
        scale=scale,
        ground=ground,
        name=name,
        work=folder and folder / "work",
        training_hours={n: h for n, h in hours.items() if h is not None},
        progress=True,
    )
    if quick:
        result.notes.append(_quick(plan))
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(tables.to_json(result, command=command))
    else:
        console.print_table(
            report.brief(result.summary),
            title=f"{name}: means over {len(loaded)} course{'s' * (len(loaded) != 1)}",
        )
        for line in result.notes:
            print(f"note: {line}")
        print(f"\n{result.verdict.paragraph}")
        for system, line in result.verdict.systems.items():
            print(f"{system}: {line}")
    if folder is not None:
        for path in report.save(result, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)
        if not tables.has_parquet():
            note(tables.PARQUET)


def _plan(
    quick: bool,
    systems: tuple[str, ...] | None,
    indexes: tuple[str, ...] | None,
    codecs: tuple[str, ...],
) -> Plan:
    """How much to measure; which codecs and indexes only where nobody says what."""
    from .plan import FULL, QUICK

    plan = QUICK if quick else FULL
    if indexes is not None:
        plan = replace(plan, indexes=indexes)
    if systems is not None or indexes is not None or codecs:
        plan = replace(plan, codecs=codecs)
    return plan


def _quick(plan: Plan) -> str:
    return (
        f"a quick comparison: {len(plan.courses)} courses of at most {plan.seconds:g} s, "
        f"{plan.repeats} seeds, crowds of at most {max(plan.crowd):,}; leave --quick out to be surer"
    )


def _models(
    given: tuple[str, ...],
    place: str,
    preset: str | None,
    systems: tuple[str, ...] | None,
    database: Database,
    sources: tuple[str, ...],
) -> tuple[str, ...]:
    """Files of models: those given, those in a folder, and those that are trained into it."""
    from . import models as learning

    found = [*given, *learning.within(place, database, note=note)]
    if preset is not None:
        stem = Path(sources[0]).stem if len(sources) == 1 else "database"
        for kind in learning.lacking(systems, found):
            path = Path(place, f"{stem}.{kind}")
            found.append(learning.train(database, kind, path, preset, note=note))
    return tuple(found)


def _check_folder(folder: Path, sources: tuple[str, ...], chosen: dict[str, Any]) -> None:
    """A UserError unless the reports can be written, over nothing that is read."""
    from motion.errors import UserError

    if files.kind(folder) not in (None, "folder"):
        raise UserError("cannot write: it is a file", path=folder, remedy="name a folder")
    inputs = [s for s in sources if files.kind(s) == "file"]
    for name in ("database.mmdb", *FILES):
        others = inputs if name != "database.mmdb" else ()
        files.check_output(folder / name, inputs=[*options.inputs(chosen), *others])
