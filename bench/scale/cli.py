"""``python -m bench scale``: memory, time and error against minutes of data."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.options import MODELS, Listed, check_models, check_outputs, given, note, open_database
from mm import options
from motion import console
from motion.errors import UserError

if TYPE_CHECKING:
    from .lengths import Lengths

SHORTEST, LONGEST = 0.5, 6000.0  # minutes


@click.command(epilog="Example: python -m bench scale --minutes 1,2,5,10 -o out/scale")
@click.argument("sources", nargs=-1, type=click.Path(), metavar="[DB|SOURCES]...")
@click.option(
    "--minutes",
    type=Listed(float),
    metavar="A,B",
    help="Lengths.  [default: 1,2,5,10,30,60, as far as there is data]",
)
@MODELS
@click.option("--indexes", type=Listed(), metavar="A,B", help="Search indexes.  [default: all]")
@click.option("--queries", type=click.IntRange(1), help="Searches a length.  [default: 500, quick 200]")
@click.option(
    "--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Of dance and order."
)
@click.option("--quick", is_flag=True, help="Three short lengths, few searches, in two minutes.")
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write tables and report there.")
@options.building
@console.json_option
def scale(
    sources: tuple[str, ...],
    minutes: tuple[float, ...] | None,
    models: tuple[str, ...],
    indexes: tuple[str, ...] | None,
    queries: int | None,
    seed: int,
    quick: bool,
    output: str | None,
    as_json: bool,
    **chosen: Any,
) -> None:
    """How memory, time and error grow with the data, from minutes to hours, with fitted exponents.

    Without SOURCES it is the built-in data, which has any length; of a database, or of clips, lengths are
    growing random parts, and a tenth of the clips is in none of them. Each length has its database, its
    search indexes and motion matching driven over courses: what they hold, what a search and a frame cost
    (one pinned thread), how far what is found and shown is from what was asked. Models stand beside it as
    what no length changes; a database has to be theirs.

    What memory each length needs is told first, and nothing is measured where one does not fit. With -o the
    folder gets the tables as CSV and Parquet, scale.json, search.png, systems.png and report.html; and work/,
    which keeps what is found of each length: who was interrupted goes on there.
    """
    from bench import systems as registry
    from bench.pose_error import held_by_all
    from mm import search

    from . import lengths as data
    from . import measure, page, room

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, page.FILES)
    for name in indexes or ():
        if name not in search.names():
            raise UserError(f"no search index {name!r}", remedy=f"choose from {', '.join(search.names())}")
    for length in minutes or ():
        if not SHORTEST <= length <= LONGEST:
            raise UserError(f"{length:g} minutes", remedy=f"give numbers from {SHORTEST:g} to {LONGEST:,.0f}")
    learned = registry.load_models(models) if models else {}
    lengths: Lengths
    if sources:
        database, name = open_database(sources, None, chosen)
        check_models(learned, models, database)
        held = held_by_all(model.held_out for model in learned.values()) or None
        lengths = data.Taken(database, seed=seed, held_out=held, name=name)
    else:
        for flag in given(set(chosen) - {"schema", "mirror", "jobs"}):
            raise UserError("the built-in data is generated", remedy=f"leave out {flag}, or name clips")
        lengths = data.Danced(seed, chosen["schema"], chosen["mirror"])
    plan = measure.QUICK if quick else measure.Plan()
    plan = replace(plan, indexes=indexes or plan.indexes, queries=queries or plan.queries)
    wanted = _lengths(lengths, minutes, measure.QUICK_MINUTES if quick else measure.MINUTES)
    for line in room.check(lengths, wanted, plan.indexes):
        note(line)
    found = measure.measure(
        lengths,
        wanted,
        plan=plan,
        models=learned,
        work=folder and folder / "work",
        progress=console.progress,
    )
    command = shlex.join(["python", "-m", "bench", *sys.argv[1:]])
    if as_json:
        console.print_json(page.to_json(found, command=command))
    else:
        console.print_table(page.rows(found.indexes, page.INDEXES), title=f"{lengths.name}: search indexes")
        print()
        console.print_table(page.rows(found.systems, page.SYSTEMS), title="Motion matching")
        if len(found.models):
            print()
            console.print_table(page.rows(found.models, page.SYSTEMS), title="Models, of any length")
        print()
        console.print_table(page.exponents(found), title="Exponents of what grows with the minutes")
        for line in (*page.facts(found), *found.notes):
            print(f"note: {line}")
    if folder is not None:
        for path in page.save(found, folder, command=command):
            print(f"wrote {path}", file=sys.stderr)


def _lengths(
    lengths: Lengths, minutes: tuple[float, ...] | None, usual: tuple[float, ...]
) -> tuple[float, ...]:
    """What is asked for, which must be there; else the usual lengths that are, and all of the data."""
    if minutes is None:
        there = tuple(length for length in usual if length < lengths.longest)
        return there if len(there) == len(usual) else (*there, lengths.longest)
    for length in minutes:
        if length > lengths.longest * (1 + 1e-6):
            raise UserError(
                f"no {length:g} minutes in {lengths.name}", remedy=f"{lengths.longest:.3g} can be measured"
            )
    return tuple(dict.fromkeys(minutes))
