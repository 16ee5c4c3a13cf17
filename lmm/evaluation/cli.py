"""``lmm evaluate``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mm import options
from motion import console, files
from motion.errors import UserError

if TYPE_CHECKING:
    from lmm.models import LocomotionModel
    from mm.database import Database


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
@click.option(
    "--against",
    type=click.Path(),
    metavar="MODEL",
    help="Another network of locomotion of the same data: how much do their errors differ?",
)
@click.option(
    "--labels",
    type=click.Path(),
    metavar="FOLDER",
    help="Labels that the model was trained with, where some were corrected by hand.",
)
@options.on_heights
@click.option("--seed", type=click.IntRange(0), help="Of random users, starts and queries.  [default: 20000]")
@console.json_option
def evaluate(
    db: str,
    model: str,
    output: str | None,
    seconds: float | None,
    minutes: float | None,
    quick: bool,
    against: str | None,
    labels: str | None,
    heights: str | None,
    heights_spacing: float | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Judge a model: is it good enough, and if not, what is to blame?

    DB is the database that it was trained from. Of learned motion matching: the errors of the decompressor,
    the stepper's drift and the projector's regret, on training clips and on held-out ones; how it drives
    characters over courses beside motion matching, and all eight mixtures of both, which tell the stage that
    is to blame; and whether anything diverges in ten minutes of random commands. Takes some minutes.

    Of a phase-functioned or mode-adaptive network: one step and free runs under the true trajectory, on
    training clips and on held-out ones; the relative error by file, as the thesis has it; what a frame
    costs; courses and ten minutes as above: does it die out, or leave the path?

    With --heights courses go over uneven ground, as those of `lmm run` do.
    """
    from lmm import models
    from mm.database import Database

    from . import evaluate as evaluating
    from . import locomotion, report

    folder = None if output is None else Path(output)
    if folder is not None:
        files.check_output(folder / "evaluation.json", inputs=[db, model, against, heights])
    plan = evaluating.QUICK if quick else evaluating.Plan()
    if seconds is not None:
        plan = replace(plan, seconds=seconds, mixed_seconds=min(seconds, plan.mixed_seconds))
    if minutes is not None:
        plan = replace(plan, minutes=minutes)
    ground = options.heightmap(heights, heights_spacing)
    judged, database = models.load(model), Database.load(db)
    seed = evaluating.SEED if seed is None else seed
    if isinstance(judged, models.LocomotionModel):
        judged.check(database, model)
        other = None if against is None else _other(against, database)
        found = locomotion.evaluate(
            judged,
            database,
            plan,
            labels=labels,
            against=other,
            ground=ground,
            seed=seed,
            progress=console.progress,
        )
    else:
        for flag, given in (("--against", against), ("--labels", labels)):
            if given is not None:
                what = f"{flag} is for networks of locomotion, and this is a model of {models.TITLES['lmm']}"
                raise UserError(what, path=model, remedy="leave it out")
        judged.check(database, model)
        found = evaluating.evaluate(
            judged, database, plan, ground=ground, seed=seed, progress=console.progress
        )
    command = shlex.join(["python", "-m", "lmm", *sys.argv[1:]])
    if as_json:
        console.print_json({"command": command, **found})
    else:
        report.show(found, model)
    if folder is not None:
        for path in report.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)


def _other(path: str, database: Database) -> LocomotionModel:
    """Another network of the same data."""
    from lmm import models

    other = models.load(path)
    if not isinstance(other, models.LocomotionModel):
        what = f"a model of {models.TITLES['lmm']} to compare with"
        raise UserError(what, path=path, remedy="give a phase-functioned or mode-adaptive network")
    other.check(database, path)
    return other
