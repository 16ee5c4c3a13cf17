"""``python -m lmm run`` and ``settings``: drive characters by networks, or by networks and data."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from mm import runs
from motion.errors import UserError

from .network import WEIGHTS

if TYPE_CHECKING:
    from mm.database import Database
    from mm.description import Description

    from .evaluator import Products
    from .locomotion.model import LocomotionModel
    from .model import Model

MODES = ("cubic", "linear", "constant")


@click.command(epilog="Example: python -m lmm run walk.lmm --course thesis -o lap.bvh")
@click.argument("model", type=click.Path())
@runs.options
@click.option(
    "--learned",
    metavar="LETTERS",
    help="Stages done by networks: P projection, S stepping, D decompression; the others use --db.  "
    "[default: PSD]",
)
@click.option("--db", type=click.Path(), metavar="DB", help="Database that the model was trained from.")
@click.option("--index", help="Search index, where P is not in --learned.  [default: exact]")
@click.option(
    "--mode",
    type=click.Choice(MODES),
    help="For a phase-functioned network: interpolation of weights over the phase.  [default: cubic]",
)
@click.option(
    "--weights",
    type=click.Choice(WEIGHTS),
    help="Type of weights in memory; bfloat16 also multiplies as such.  [default: as stored]",
)
def run(
    model: str,
    learned: str | None,
    db: str | None,
    index: str | None,
    mode: str | None,
    weights: str | None,
    **options: Any,
) -> None:
    """Drive characters over a course by a trained model.

    MODEL is a file that `train` wrote, or dancecard, which ships with the program and was trained on clips of
    `python -m motion dancecard`. The model is all that is needed; no database is read.

    With --db the three stages of learned motion matching can be mixed with those of motion matching:
    --learned D searches the database and plays its frames, and only decompresses poses by a network.

    Phase-functioned and mode-adaptive networks have no stages. Their --settings are those of `python -m lmm
    settings`. With --heights a phase-functioned network that was trained on uneven ground sees the ground
    ahead; the feet of all others are merely put on it.

    All other options, and course files, are as for `python -m mm run`.
    """
    from mm.database import Database

    from . import models
    from .mixtures import LETTERS, letters

    def load() -> runs.Driven:
        loaded, products = models.with_weights(models.load(model), weights)
        if isinstance(loaded, models.LocomotionModel):
            return of_network(loaded, mode, products)
        database = None if db is None else Database.load(db)
        if database is not None:
            loaded.check(database, path=model)
        if "P" in asked:
            _check_tags(loaded.description, (*options["require_tag"], *options["forbid_tag"]))
        return of_stages(loaded, asked, database, index or "exact", products)

    asked, kind = LETTERS if learned is None else letters(learned), models.kind_of(model)
    for foreign, of in (
        ({"--learned": learned, "--db": db, "--index": index}, "lmm"),
        ({"--mode": mode}, "pfnn"),
    ):
        given = [flag for flag, value in foreign.items() if value is not None]
        if given and kind != of:
            what = f"{given[0]} is for {models.TITLES[of]}, and this is a model of {models.TITLES[kind]}"
            raise UserError(what, path=model, remedy="leave it out")
    if asked != LETTERS and db is None:
        raise click.UsageError("stages that are not learned need the model's database: give --db DB too")
    if index is not None and "P" in asked:
        raise click.UsageError("--index is for searches: leave P out of --learned")
    runs.perform(load, {"model": model, "database": db}, **options)


def of_stages(
    model: Model,
    learned: str = "PSD",
    database: Database | None = None,
    index: str = "exact",
    products: Products = "float32",
) -> runs.Driven:
    """What drives by stages, those of letters learned by networks; see `lmm.controller.controller`."""
    from mm.settings import Settings

    from .controller import controller

    make = partial(controller, model, learned=learned, database=database, index=index, products=products)
    return runs.Driven(model.description, make, Settings)


def of_network(
    model: LocomotionModel, mode: str | None = None, products: Products = "float32"
) -> runs.Driven:
    """What drives by a network that makes locomotion of a trajectory; mode is a way to evaluate it."""
    from . import models
    from .locomotion.settings import LocomotionSettings

    ways = models.controllers(model)
    make = partial(ways[mode] if mode else next(iter(ways.values())), products=products)
    return runs.Driven(model.description, make, LocomotionSettings, sees_ground=model.sees_ground)


def _check_tags(description: Description, names: Iterable[str]) -> None:
    """A UserError for tags that a projector does not know: all but the one that its data is divided by."""
    for name in names:
        if not description.tag_mask([name]) & description.crouch_tag:
            raise UserError(
                f"the projector knows nothing of the tag {name!r}",
                remedy="search the database for it: --learned SD --db DB",
            )


@click.command("settings", epilog="Example: python -m lmm settings -o mine.toml")
@click.option(
    "-o", "--output", type=click.Path(), metavar="FILE", help="Write to this file instead of printing."
)
def settings_(output: str | None) -> None:
    """Print the settings of phase-functioned and mode-adaptive networks as TOML, with explanations.

    Edit a copy and give it to `run --settings`; settings you leave out keep their defaults. Learned motion
    matching has the settings of motion matching: `python -m mm settings`.
    """
    from .locomotion.settings import LocomotionSettings

    runs.show_settings(LocomotionSettings(), output)
