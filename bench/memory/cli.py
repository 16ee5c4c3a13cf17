"""``python -m bench memory``: what systems hold, and what errors their poses have for it."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import click

from bench.options import CODECS, MODELS, Listed, check_models, check_outputs, load
from motion import console


@click.command(epilog="Example: python -m bench memory walk.mmdb --model walk.lmm -o out/memory")
@click.argument("db", type=click.Path())
@MODELS
@CODECS
@click.option(
    "--systems", type=Listed(), metavar="A,B", help="Names, families or patterns of systems.  [default: all]"
)
@click.option(
    "--counts",
    type=Listed(int),
    default="1,16",
    show_default=True,
    help="Characters whose steps are watched.",
)
@click.option("--peak/--no-peak", default=True, show_default=True, help="Measure resident memory, slowly.")
@click.option(
    "-o", "--output", type=click.Path(), metavar="FOLDER", help="Write table, plot and report there."
)
@console.json_option
def memory(
    db: str,
    models: tuple[str, ...],
    codecs: tuple[str, ...],
    systems: tuple[str, ...] | None,
    counts: tuple[int, ...],
    peak: bool,
    output: str | None,
    as_json: bool,
) -> None:
    """Memory of every system by part (stored, loaded, at the peak), beside the error of its poses.

    That is all search indexes, compressed databases, and all ways to run models and to hold their weights.
    Errors are those of poses decoded of true frames, on clips that the models were trained on and on those
    that they were not; of PFNN and MANN those of one step from a true frame. Steps are watched for what they
    allocate. A star marks the Pareto front of loaded bytes and error.

    With -o the folder gets memory.csv, memory.json, pareto.png and report.html.
    """
    from bench import systems as registry

    from . import measure, page

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, page.FILES)
    learned = registry.load_models(models) if models else {}
    registry.choose(systems, models=learned, codecs=codecs)
    database = load(db)
    check_models(learned, models, database)
    found = measure.measure(
        database,
        db,
        models=learned,
        codecs=codecs,
        systems=systems,
        counts=counts,
        peaks=peak,
        progress=console.progress,
    )
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(page.to_json(found, command=command))
    else:
        console.print_table(
            page.brief(found), title=f"{db}: MB of 10^6 bytes, * where nothing smaller is better"
        )
        for line in (*page.facts(found), *found.notes):
            print(f"note: {line}")
    if folder is not None:
        for path in page.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)
