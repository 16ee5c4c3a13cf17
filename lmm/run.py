"""``python -m lmm run``: drive characters by networks, or by a mixture of networks and data."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from mm import runs
from motion.errors import UserError

if TYPE_CHECKING:
    from mm.description import Description


@click.command(epilog="Example: python -m lmm run walk.lmm --course thesis -o lap.bvh")
@click.argument("model", type=click.Path())
@runs.options
@click.option(
    "--learned",
    default="PSD",
    show_default=True,
    metavar="LETTERS",
    help="Stages that networks do: P projection, S stepping, D decompression.",
)
@click.option("--db", type=click.Path(), metavar="DB", help="The model's database, which the others need.")
@click.option("--index", help="Search index, where projection is not learned.  [default: exact]")
def run(model: str, learned: str, db: str | None, index: str | None, **options: Any) -> None:
    """Drive characters over a course by learned motion matching.

    MODEL is a model that `train` wrote. Alone it is all that is needed. With --db, which is the database that
    it was trained from, any of the three stages may be those of motion matching: --learned D searches the
    database and plays its frames, and the network turns them into poses.

    The other options, and course files, are those of `python -m mm run`.
    """

    def load() -> runs.Driven:
        from mm.database import Database

        from .controller import controller
        from .model import Model

        database = None if db is None else Database.load(db)
        loaded = Model.load(model)
        if database is not None:
            loaded.check(database, path=model)
        if "P" in asked:
            _check_tags(loaded.description, (*options["require_tag"], *options["forbid_tag"]))
        make = partial(controller, loaded, learned=asked, database=database, index=index or "exact")
        return runs.Driven(loaded.description, make)

    from .mixtures import LETTERS, letters

    asked = letters(learned)
    if asked != LETTERS and db is None:
        raise click.UsageError("stages that are not learned need the model's database: give --db DB too")
    if index is not None and "P" in asked:
        raise click.UsageError("--index is for searches: leave P out of --learned")
    runs.perform(load, {"model": model, "database": db}, **options)


def _check_tags(description: Description, names: Iterable[str]) -> None:
    """A UserError for tags that a projector does not know: all but the one that its data is divided by."""
    for name in names:
        if not description.tag_mask([name]) & description.crouch_tag:
            raise UserError(
                f"the projector knows nothing of the tag {name!r}",
                remedy="search the database for it: --learned SD --db DB",
            )
