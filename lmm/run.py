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
    help="Stages that networks do: P projection, S stepping, D decompression.  [default: PSD]",
)
@click.option("--db", type=click.Path(), metavar="DB", help="The model's database, which the others need.")
@click.option("--index", help="Search index, where projection is not learned.  [default: exact]")
@click.option(
    "--mode",
    type=click.Choice(MODES),
    help="How a phase-functioned network's weights are made of the phase.  [default: cubic]",
)
@click.option(
    "--weights",
    type=click.Choice(WEIGHTS),
    help="What weights are held as; bfloat16 is multiplied as such.  [default: as stored]",
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
    """Drive characters over a course by learned motion matching, or by a network of locomotion.

    MODEL is a model that `train` wrote, or dancecard, which ships: networks of the clips that `python -m
    motion dancecard` writes. Alone it is all that is needed. With --db, which is the database that it was
    trained from, any of the three stages of learned motion matching may be those of motion matching:
    --learned D searches the database and plays its frames, and the network turns them into poses.

    Phase-functioned and mode-adaptive networks have no such stages; their --settings are those that
    `python -m lmm settings` prints. With --heights a phase-functioned network that was trained on uneven
    ground is told of the ground ahead; all others are put on it.

    The other options, and course files, are those of `python -m mm run`.
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
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write them there.")
def settings_(output: str | None) -> None:
    """Settings of phase-functioned and mode-adaptive networks as TOML: their defaults, what they mean.

    An edited copy goes to `run --settings`; it need not name all of them. Those of learned motion matching
    are motion matching's: `python -m mm settings`.
    """
    from .locomotion.settings import LocomotionSettings

    runs.show_settings(LocomotionSettings(), output)
