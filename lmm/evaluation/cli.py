"""``lmm evaluate``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import click

from motion import console, files


@click.command(epilog="Example: python -m lmm evaluate walk.mmdb walk.lmm -o judged")
@click.argument("db", type=click.Path())
@click.argument("model", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="DIR", help="Write evaluation.json and pictures there."
)
@click.option(
    "--seconds", type=console.SECONDS, help="Of each course, at most.  [default: 40; 10 with --quick]"
)
@click.option(
    "--minutes",
    type=console.Number(0, 1440, above_0=True),
    help="Of the long run.  [default: 10; 1 with --quick]",
)
@click.option("--quick", is_flag=True, help="Fewer and shorter measurements, about a minute.")
@click.option("--seed", type=click.IntRange(0), help="Of random users, starts and queries.  [default: 20000]")
@console.json_option
def evaluate(
    db: str,
    model: str,
    output: str | None,
    seconds: float | None,
    minutes: float | None,
    quick: bool,
    seed: int | None,
    as_json: bool,
) -> None:
    """Judge a model: is it good enough, and if not, which stage is to blame?

    DB is the database that it was trained from. Prints the errors of the decompressor, the stepper's drift
    and the projector's regret, on training clips and on held-out ones; how it drives a character over
    courses beside motion matching, each stage alone replaced by its network too; and whether anything
    diverges in ten minutes of random commands. Takes some minutes.
    """
    from lmm.model import Model
    from mm.database import Database

    from . import evaluate as evaluating
    from . import report

    folder = None if output is None else Path(output)
    if folder is not None:
        files.check_output(folder / "evaluation.json", inputs=[db, model])
    plan = evaluating.QUICK if quick else evaluating.Plan()
    if seconds is not None:
        plan = replace(plan, seconds=seconds, mixed_seconds=min(seconds, plan.mixed_seconds))
    if minutes is not None:
        plan = replace(plan, minutes=minutes)
    judged, database = Model.load(model), Database.load(db)
    judged.check(database, model)
    found = evaluating.evaluate(
        judged,
        database,
        plan,
        seed=evaluating.SEED if seed is None else seed,
        progress=console.progress,
    )
    command = shlex.join(["python", "-m", "lmm", *sys.argv[1:]])
    if as_json:
        console.print_json({"command": command, **found})
    else:
        report.show(found, model)
    if folder is not None:
        for path in report.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)
