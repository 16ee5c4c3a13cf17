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
    "-o", "--output", type=click.Path(), metavar="FOLDER", help="Write evaluation.json and pictures there."
)
@click.option(
    "--seconds", type=console.SECONDS, help="Longest time on each course.  [default: 40; 10 with --quick]"
)
@click.option(
    "--minutes",
    type=console.Number(0, 1440, above_0=True),
    help="Length of the run with random commands.  [default: 10; 1 with --quick]",
)
@click.option("--quick", is_flag=True, help="Measure less, in about a minute.")
@click.option(
    "--against",
    type=click.Path(),
    metavar="MODEL",
    help="For pfnn and mann: another network of the same data, to compare errors with.",
)
@click.option(
    "--labels",
    type=click.Path(),
    metavar="FOLDER",
    help="For pfnn and mann: the folder that was given to `train --labels`.",
)
@options.on_heights
@click.option("--seed", type=click.IntRange(0), help="Random seed: users, starts, queries.  [default: 20000]")
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

    DB is the database that MODEL was trained from. It takes some minutes.

    Of learned motion matching it measures the error of the decompressor, the drift of the stepper and the
    regret of the projector, each on training clips and on held-out clips. Then characters are driven over
    courses by the model, by motion matching, and by all mixtures of their stages; the mixtures show which
    stage is to blame. Last come ten minutes of random commands, to see whether anything diverges.

    Of a phase-functioned or mode-adaptive network it measures the error of one step and of free runs along
    the true trajectory, on training clips and on held-out clips; the relative error of each clip, as in the
    thesis; the time of a frame; and courses and ten minutes as above: does the motion die out, or leave the
    path?

    With --heights the courses lead over uneven ground.
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
