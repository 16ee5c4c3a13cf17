"""``python -m bench``: compare systems, motions, search indexes, crowds, readers and builds on real data."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

import click

from mm import options
from motion import console

from .compare_cli import compare
from .data.cli import data
from .driven import courses
from .memory.cli import memory
from .options import MODELS, Listed, check_models, check_outputs, load, note, open_database
from .recall import search
from .scale.cli import scale


@console.group(
    "bench", "Measure memory, cost per frame, motion quality, search, crowds, reading: numbers to trust."
)
def main() -> None:
    pass


@main.command(epilog="Example: python -m bench crowd walk.mmdb --counts 1,256,1024")
@click.argument("db", type=click.Path())
@click.option(
    "--counts",
    type=Listed(int),
    default="1,16,256,1024,4096",
    show_default=True,
    help="Numbers of characters.",
)
@click.option("--index", default="exact", show_default=True, help="Search index.")
@MODELS
@click.option(
    "--seconds",
    type=console.SECONDS,
    default=5.0,
    show_default=True,
    help="Length of each run; shorter for large crowds.",
)
@console.json_option
def crowd(
    db: str, counts: tuple[int, ...], index: str, models: tuple[str, ...], seconds: float, as_json: bool
) -> None:
    """Time of a frame for crowds of several sizes, in microseconds for each character, by stage.

    It is measured with and without search; last stand the bytes that a frame allocates, and frees again, of
    all characters together. With --model learned systems are measured beside motion matching.
    """
    from . import crowd as crowds
    from . import systems as registry

    learned, database = registry.load_models(models) if models else {}, load(db)
    check_models(learned, models, database)
    why = registry.without_legs(database)
    if why is not None:
        note(f"no system holds the feet: {why.what}")
    rows = crowds.measure(
        database, counts=counts, index=index, models=learned, seconds=seconds, progress=True
    )
    if as_json:
        console.print_json(rows)
    else:
        columns = dict.fromkeys(key for row in rows for key in row)  # systems have other stages
        rows = [{**columns, **row} for row in rows]
        console.print_table(rows, title=f"{db}: microseconds a character and frame, one thread")


@main.command(epilog="Example: python -m bench retarget walk.mmdb --joints 191 --counts 1,256")
@click.argument("db", type=click.Path())
@click.option(
    "--joints", type=click.IntRange(1, 10_000), default=191, show_default=True, help="Joints of the rig."
)
@click.option(
    "--counts", type=Listed(int), default="1,16,256,1024", show_default=True, help="Numbers of characters."
)
@click.option("--index", default="exact", show_default=True, help="Search index.")
@click.option("--seconds", type=console.SECONDS, default=3.0, show_default=True, help="Length of each run.")
@console.json_option
def retarget(
    db: str, joints: int, counts: tuple[int, ...], index: str, seconds: float, as_json: bool
) -> None:
    """Time of driving a large rig at run time, in microseconds for each character and frame.

    The rig is the database's skeleton with legs of other lengths, and joints added until it has as many as
    asked for. Each row is one thread; twin_us is the plain NumPy of the same.
    """
    from . import retargeting

    rows = retargeting.measure(
        load(db), joints=joints, counts=counts, index=index, seconds=seconds, progress=True
    )
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows, title=f"{db}: microseconds a character and frame, one thread")


@main.command(epilog="Example: python -m bench networks walk.lmm --db walk.mmdb --counts 1,1024")
@click.argument("model", type=click.Path())
@click.option(
    "--db",
    "--database",
    "database",
    type=click.Path(),
    metavar="DB",
    help="Database that the model was trained from; its frames are the inputs.",
)
@click.option(
    "--counts", type=Listed(int), default="1,16,256,1024", show_default=True, help="Numbers of characters."
)
@click.option("--weights", type=Listed(), metavar="A,B", help="Types of weights to measure.  [default: all]")
@click.option(
    "--repeats", type=click.IntRange(1), default=5, show_default=True, help="Least number of timed passes."
)
@console.json_option
def networks(
    model: str,
    database: str | None,
    counts: tuple[int, ...],
    weights: tuple[str, ...] | None,
    repeats: int,
    as_json: bool,
) -> None:
    """Time of a model's networks for each character, their size, and the error of compact weights.

    MODEL is what `lmm train` wrote, or a folder of networks in the public reference's format. Beside our
    kernels stand NumPy and a loop compiled as the public C++ is written, both with float32 weights: of_numpy
    and of_loop are ours as a share of theirs. "frame" is all networks, the projector in one frame of six.
    Weights of bfloat16 are multiplied as such; float16 and int8 become float32 first.
    """
    from . import networks as measured

    subject = measured.load(model, None if database is None else load(database))
    rows = measured.measure(subject, counts=counts, weights=weights, repeats=repeats, progress=True)
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(
            measured.brief(rows, counts), title=f"{model}: microseconds a character, one thread"
        )


@main.command(epilog="Example: python -m bench reading clips/")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@click.option(
    "--repeats", type=click.IntRange(1), default=3, show_default=True, help="Number of passes over the files."
)
@console.json_option
def reading(files: tuple[str, ...], repeats: int, as_json: bool) -> None:
    """MB a second of the BVH reader, beside pybvh's where that is installed."""
    from . import reading as readers

    rows = readers.measure(files, repeats=repeats)
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows, title="BVH readers on the same files, one thread")


@main.command(epilog="Example: python -m bench build clips/ --jobs 2")
@click.argument("sources", nargs=-1, required=True, type=click.Path())
@click.option("--repeats", type=click.IntRange(1), default=3, show_default=True, help="Warm builds.")
@options.building
@console.json_option
def build(sources: tuple[str, ...], repeats: int, as_json: bool, **chosen: Any) -> None:
    """How many times faster than real time a database is built, in a new process and in a warm one."""
    from . import building

    rows = building.measure(sources, repeats=repeats, options=chosen)
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows, title="Building a database, from files to file")


@main.command(epilog="Example: python -m bench likeness dancecard/ cmu/ --exclude '16_0*' -o out/likeness")
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="FOLDER", help="Write pictures, tables, a page there."
)
@click.option("--only", type=Listed(), metavar="A,B", help="Moves to look at: walk, 'run 3'.  [default: all]")
@click.option(
    "--worst",
    type=click.IntRange(0),
    default=30,
    show_default=True,
    help="Rows to print of what is farthest outside.",
)
@click.option("--full", is_flag=True, help="Print every move and measure.")
@console.exclude_option
@console.json_option
def likeness(
    a: str,
    b: str,
    output: str | None,
    only: tuple[str, ...] | None,
    worst: int,
    full: bool,
    exclude: tuple[str, ...],
    as_json: bool,
) -> None:
    """How much the motion of A resembles that of B, at the same speeds and moves.

    A and B are clips or folders, of any skeletons, rates and units. Both are cut into what the character does
    (stand, walk, run, turn, start, stop, backward, sidestep, crouch). Numbers of each move: joint angles,
    excursions, step times, speeds by frequency, jerk, skate; A's median beside B's spread. With -o the folder
    gets film strips, mean joint angles over the gait cycle and spectra, and index.html to look at all.
    """
    from .likeness import compare as comparing
    from .likeness import page

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, ("index.html", "table.csv", "summary.csv"))
    result = comparing.compare([a], [b], exclude=exclude, only=only, note=note, progress=console.progress)
    if as_json:
        console.print_json(page.to_json(result))
    else:
        console.print_table(page.rounded(result.summary()), title=f"A: {a}, B: {b}")
        often = result.by_measure(worst)
        if often:
            print()
            console.print_table(
                page.rounded(often), title="Outside of B's spread most often; medians over moves"
            )
        rows = result.table if full else result.worst(worst)
        if len(rows):
            print()
            console.print_table(page.rows(rows), title="" if full else "Farthest outside of B's spread")
    if folder is not None:
        command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
        for path in page.save(result, folder, command=command, progress=console.progress):
            if path.suffix != ".png":
                print(f"wrote {path}", file=sys.stderr)


@main.command(epilog="Example: python -m bench coverage walk.mmdb --courses thesis,circle -o out/coverage")
@click.argument("sources", nargs=-1, required=True, type=click.Path())
@click.option(
    "--courses", type=Listed(), metavar="A,B", help="Names or TOML files.  [default: those of compare]"
)
@click.option(
    "--seconds", type=console.SECONDS, default=60.0, show_default=True, help="Of each course, at most."
)
@click.option(
    "--scale/--no-scale", default=True, show_default=True, help="Bring course speeds to the data's."
)
@click.option(
    "--few", type=click.IntRange(1, 10_000), default=30, show_default=True, help="Frames that are a choice."
)
@click.option("--worst", type=click.IntRange(0), default=20, show_default=True, help="Holes to print.")
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write heat maps and tables there.")
@options.building
@console.json_option
def coverage(
    sources: tuple[str, ...],
    courses: tuple[str, ...] | None,
    seconds: float,
    scale: bool,
    few: int,
    worst: int,
    output: str | None,
    as_json: bool,
    **chosen: Any,
) -> None:
    """Which of the speeds, directions and turn rates that courses ask for are in the data.

    SOURCES are clips and folders, or one database. An object that obeys through the controller's springs goes
    over the courses; covered is what it does that the data has within 0.25 m/s, 22.5 degrees and 30 degrees a
    second. With -o the folder gets coverage.png (heat maps), holes.csv and courses.csv.
    """
    from mm import courses as known_courses

    from . import comparison as comparing
    from . import coverage as covering

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, covering.FILES)
    loaded = [known_courses.load(name) for name in courses or comparing.COURSES]
    database, name = open_database(sources, None, chosen)
    found = covering.measure(database, loaded, seconds=seconds, scale=scale, few=few)
    if as_json:
        console.print_json(covering.to_json(found))
    else:
        console.print_table(found.by_course(), title=f"{name}: what the courses ask, and the data has")
        holes = found.holes(worst)
        if holes:
            print()
            console.print_table(holes, title="Asked, but not there; distance 1 is the bound")
        for line in found.notes():
            print(f"note: {line}")
    if folder is not None:
        for path in covering.save(found, folder, name):
            print(f"wrote {path}", file=sys.stderr)


@main.command(
    epilog="Example: python -m bench thesis walk.mmdb --models holden.pfnn,xl.pfnn --quick -o out/thesis"
)
@click.argument("db", type=click.Path())
@click.option(
    "--models",
    type=Listed(),
    default=(),
    metavar="A,B",
    help="Phase-functioned networks of this database; who has more joints is AVA.",
)
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write tables and report there.")
@click.option("--quick", is_flag=True, help="Train nothing: what no model is given for stays empty.")
@click.option(
    "--preset",
    type=click.Choice(("full", "quick", "smoke")),
    default="quick",
    show_default=True,
    help="How long to train what is missing.",
)
@click.option("--laps", type=click.IntRange(2, 1000), default=19, show_default=True, help="Of the course.")
@click.option(
    "--mode",
    type=click.Choice(("cubic", "linear", "constant")),
    default="constant",
    show_default=True,
    help="How weights are made of the phase on the laps.",
)
@console.json_option
def thesis(
    db: str,
    models: tuple[str, ...],
    output: str | None,
    quick: bool,
    preset: str,
    laps: int,
    mode: Any,
    as_json: bool,
) -> None:
    """Reproduce the thesis's experiment with phase-functioned networks, beside its own figures.

    DB is the database that the models were trained from. Time of a frame over 19 laps of the course of six
    waypoints; relative error by file; how long labelling, training, loading and a frame take, and how large
    all of it is; training curves, from the logs beside the models: for HOLDEN, HOLDEN-XL with one more
    hidden layer, HOLDEN-XT trained twice as long, AVA of a rig of 191 joints, and AVA-M, AVA's error on the
    joints that the others have, too.

    Configurations without a model are trained into the folder, hours in all, and found there again; what was
    stopped goes on. With --quick they stay empty. The folder gets summary.csv, laps.csv, files.csv,
    thesis.json and report.html.
    """
    from .thesis import measure, page, published, rows

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, page.FILES)
    elif not quick:
        raise click.UsageError("a folder is needed to train models into: give -o FOLDER, or --quick")
    databases = rows.Databases(load(db))
    placed = rows.placed(models, databases)
    if folder is not None and not quick:
        missing = [name for name in published.CONFIGURATIONS if name not in placed]
        trained = [rows.train(databases, name, folder, preset=preset, note=note) for name in missing]
        placed = rows.placed([*models, *trained], databases)
    found = measure.measure(databases, placed, laps=laps, mode=mode, name=db, progress=console.progress)
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(page.to_json(found, command=command))
    else:
        console.print_table(page.brief(found), title=f"{db}: {laps} laps of the thesis's course, {mode} mode")
        for line in found.notes:
            print(f"note: {line}")
    if folder is not None:
        for path in page.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)


main.add_command(compare)
main.add_command(courses)
main.add_command(data)
main.add_command(memory)
main.add_command(scale)
main.add_command(search)
