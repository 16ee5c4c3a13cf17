"""``python -m bench data``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import click

from motion import console

from ..options import Listed, check_outputs, load


@click.command(epilog="Example: python -m bench data walk.mmdb --run lap.rec -o out/data")
@click.argument("db", type=click.Path())
@click.option(
    "--run",
    "recorded",
    type=click.Path(),
    metavar="FILE",
    help="A recording of `mm run --record` on DB: costs by feature, and glitches.",
)
@click.option(
    "--character", type=click.IntRange(0), default=0, show_default=True, help="Of the recording, which one."
)
@click.option(
    "--near",
    type=console.SECONDS,
    default=1 / 30,
    show_default="1/30",
    help="So many seconds of ordinary motion apart, two frames are the same.",
)
@click.option(
    "--courses", type=Listed(), metavar="A,B", help="Names or TOML files.  [default: those of compare]"
)
@click.option(
    "--seconds", type=console.SECONDS, default=20.0, show_default=True, help="Of each course, at most."
)
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write tables and report there.")
@console.json_option
def data(
    db: str,
    recorded: str | None,
    character: int,
    near: float,
    courses: tuple[str, ...] | None,
    seconds: float,
    output: str | None,
    as_json: bool,
) -> None:
    """What a database holds: its features, captures to look at, what it lacks, what it has twice.

    Quantiles, outliers by clip and second, columns that say the same, principal components; how fast it goes
    in each direction and what courses ask of it in vain; stretches that are there twice, and what could be
    left out. With --run also what the searches of a recorded run cost by feature and time, and the moments
    at which it pops, slips, or finds nothing like what is asked. With -o the folder gets report.html,
    data.json and the tables as CSV and Parquet.
    """
    from mm import courses as known_courses
    from mm.recording import Recording

    from .. import comparison as comparing
    from . import analyse, costs, page, verdict

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, page.names(with_run=recorded is not None))
    loaded = [known_courses.load(name) for name in courses or comparing.COURSES]
    database = load(db)
    recording = None if recorded is None else Recording.load(recorded)
    if recorded is not None and recording is not None:
        costs.check(recording, database, recorded, character=character)
    found = analyse.analyse(
        database,
        name=db,
        courses=loaded,
        seconds=seconds,
        near=near,
        recording=recording,
        recording_name=recorded or "",
        character=character,
        progress=console.progress,
    )
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(page.to_json(found, command=command))
    else:
        console.print_table(page.brief(found), title=f"{db}: {len(found.columns)} columns")
        for line in verdict.sentences(found):
            print(f"\n{line}")
    if folder is not None:
        for path in page.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)
