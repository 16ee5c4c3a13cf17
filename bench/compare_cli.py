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
    "--courses", type=Listed(), metavar="A,B", help="Names of courses, or TOML files.  [default: seven]"
)
@click.option(
    "--systems",
    type=Listed(),
    metavar="A,B",
    help="Systems by name (see above), kind or pattern: lmm-D, mm, mm-*-free.",
)
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
    metavar="FOLDER",
    help="Folder of models; those that were trained from this database are taken.",
)
@click.option(
    "--train",
    type=click.Choice(PRESETS),
    help="First train a model of each kind (lmm, pfnn, mann) that --systems names but no model is given of; "
    "without --systems of all three.",
)
@CODECS
@click.option(
    "--quick",
    is_flag=True,
    help="Measure less, in about two minutes: fewer and shorter courses, smaller crowds.",
)
@click.option("--seconds", type=console.SECONDS, help="Longest time on each course.  [default: 40]")
@click.option(
    "--repeats",
    type=click.IntRange(1, 1000),
    help="Runs of each course, from other starts or with other random users.  [default: 3]",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**32 - 1),
    help="Random seed of the random user.  [default: the course's own]",
)
@click.option(
    "--scale/--no-scale",
    default=True,
    show_default=True,
    help="Scale the speeds of courses to those of the data.",
)
@click.option(
    "--counts", type=Listed(int), metavar="A,B", help="Sizes of crowds.  [default: 1,16,256,1024,4096]"
)
@click.option(
    "--crowd-systems",
    type=Listed(),
    metavar="A,B",
    help="Systems to measure crowds of.  [default: one of each kind]",
)
@click.option("--no-crowds", is_flag=True, help="Do not measure crowds.")
@options.on_heights
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write tables and report there.")
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
    """Compare systems by memory, cost per frame and motion quality over courses, and say which to take.

    SOURCES are clips and folders, or one database. By default motion matching with exact search, three
    compressed databases, and all ways to run the models given by --model are compared.

    With -o the folder gets report.html, summary.csv, courses.csv, summary.json, all tables in tables/ (also
    as Parquet where pyarrow is installed), and the database where one was built. Finished runs are kept in
    its folder work/: a comparison that was interrupted goes on where it stopped, and one with more systems
    measures only those. Runs of another database, model, setting, program version or machine are not used.

    \b
    Names of systems:
      mm-exact, mm-aabb, ...     motion matching with that search index
      mm-exact-quantised-11      ... on a database that `mm compress` makes so (see --codecs);
                                 mm-coded-CODEC searches features of 8 bits as they are stored
      lmm-PSD, lmm-PD, lmm-D     learned motion matching; the letters name what networks do: P projection,
                                 S stepping, D decompression, in all seven mixtures
      pfnn-cubic, -linear, ...   a phase-functioned network, by the interpolation of its weights
      mann-4                     a mode-adaptive network, by its number of experts
      NAME-free                  without foot locking; the only ones where a leg's joint is missing
      NAME-fp32, -fp16, -int8    with weights held so; -bf16 also multiplies so, where the processor can

    With models or compressed databases, poses of every system are also compared with those of the data, and
    with those of mm-exact under the same commands.

    Each course is driven from several starts, the random one by several users. Means have 95 % intervals, and
    the verdict calls a difference only what a paired test over the courses finds.

    With --heights all walk on uneven ground, as with `mm run`. Heights of feet are then those above the
    ground, and you are told how deep feet sink into it and how high they hover over it.
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
        raise click.UsageError("a folder is needed to train models into: give --models FOLDER or -o FOLDER")
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
