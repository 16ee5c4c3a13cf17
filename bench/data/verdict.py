"""What the numbers say, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import costs, duplicates, features, glitches, reach
from .analyse import Analysis
from .costs import Run

HELD = 0.95  # of the variance
LITTLE = 0.05  # share of spare frames that is not worth the trouble
NAMED = 3  # places that are named, at most
DEAR = 0.01  # by which searches may cost more without what is spare
MOST_ASKED = 0.9  # share of what is asked that a database should have enough of


def sentences(found: Analysis) -> list[str]:
    """Captures, features, what is there twice, what is missing, the run: a few sentences each."""
    told = [captures(found), columns(found), twice(found), missing(found)]
    return told + ([of_run(found.run)] if found.run is not None else [])


def captures(found: Analysis) -> str:
    """Where joints leap, and what nothing else is like."""
    leaps = found.leaps[found.leaps["times"] >= glitches.LEAPS]
    told = []
    if len(leaps):
        where = [
            f"{row.clip} at {row.at_s:.2f} s ({row.joint}, {row.pop_cm:.1f} cm)" for row in leaps.itertuples()
        ]
        told.append(f"Look at these captures: a joint leaps in {_some(where, 'places')}.")
    else:
        told.append(
            f"No joint leaps by {glitches.LEAPS:g} times what {glitches.RARE:g} % of the frames stay below, "
            f"{found.bounds.pop_cm:.1f} cm."
        )
    alone = duplicates.alone(found.twice, found.clips)
    if len(alone) and np.isfinite(alone["times"][0]):
        first = alone.iloc[0]
        told.append(
            f"Least like anything else is {first['clip']}, {first['from_s']:.1f} to {first['to_s']:.1f} s, "
            f"whose nearest costs {first['times']:.0f} times what counts as the same."
        )
    return " ".join(told)


def columns(found: Analysis) -> str:
    """How much the columns say."""
    table, schema = found.columns, found.database.schema
    needed = found.components.needed(HELD)
    told = [f"{needed} components hold {HELD:.0%} of what the {len(table)} columns say."]
    if len(found.redundant):
        pairs = [f"{row.column} and {row.other}" for row in found.redundant.itertuples()]
        told.append(
            f"{_some(pairs, 'pairs')} say the same (|correlation| over {features.SAME:g}): "
            "one of each would do."
        )
    else:
        told.append(f"No two say the same (|correlation| over {features.SAME:g}).")
    still = list(table["column"][table["constant"]])
    if still:
        told.append(f"{_some(still, 'columns')} hardly var{'ies' if len(still) == 1 else 'y'}.")
    first = found.weights.loc[found.weights["any_share"].idxmax()]
    told.append(
        f"{first['feature']} makes {first['any_share']:.0%} of the cost of two frames at random and "
        f"{first['near_share']:.0%} of that of near ones"
        + (f", of {len(schema.features)} features." if len(schema.features) > 1 else ".")
    )
    return " ".join(told)


def twice(found: Analysis) -> str:
    """What could be left out, and what that costs."""
    near, spare = float(found.twice.near.mean()), float(found.twice.spare.mean())
    told = f"Of {found.clips.seconds / 60:.1f} minutes {near:.1%} is there twice"
    if spare == 0:
        return f"{told}, no stretch of it could be left out."
    told += f", and {spare:.1%} ({spare * found.clips.seconds:.1f} s) could be left out"
    if found.price is not None:
        told += f": what a random user's searches find then costs {found.price:.2%} more"
        if found.price > DEAR:
            return f"{told}. That is a price: look at the stretches first."
    return f"{told}. " + ("Hardly worth it." if spare < LITTLE else "Worth it where memory counts.")


def missing(found: Analysis) -> str:
    """What the data cannot do, and what courses ask for in vain."""
    ways = ", ".join(f"{name} {_speeds(found, name)}" for name in reach.DIRECTIONS)
    turns = ", ".join(f"{name.removeprefix('turn_')} {_speeds(found, name)}" for name in reach.TURNS)
    told = [
        f"Travel that there is enough of, m/s: {ways}. Turns by more than {reach.TURNING:g} °/s: {turns}."
    ]
    if found.coverage is not None:
        *rows, of_all = found.coverage.by_course()
        least = min(rows, key=lambda row: row["with a choice"])
        lacks = "" if least["with a choice"] >= MOST_ASKED else ": there a character will lag, or glide"
        told.append(
            f"Of what the courses ask {of_all['covered']:.1%} has data near, {of_all['with a choice']:.1%} "
            f"enough to choose from, the least {least['course']}, {least['with a choice']:.0%}{lacks}."
        )
        holes = found.coverage.holes(1)
        if holes:
            hole = holes[0]
            way = "" if hole["direction °"] is None else f" {hole['direction °']:+.0f}° from the facing,"
            told.append(
                f"Longest asked in vain: {hole['speed m/s']:.1f} m/s,{way} turning {hole['turn °/s']:+.0f} "
                f"°/s ({hole['courses']}, {hole['seconds']:.1f} s)."
            )
    return " ".join(told)


def _speeds(found: Analysis, name: str) -> str:
    return " and ".join(f"{low:g} to {high:g}" for low, high in reach.spans(found.speeds, name)) or "none"


def of_run(run: Run) -> str:
    """How often it looked wrong, and why."""
    kinds = costs.by_kind(run).set_index("kind")
    total = len(run.moments)
    if not total:
        told = [f"In {run.seconds:.0f} s nothing looks wrong."]
    else:
        counts = kinds["moments"]
        worst = run.moments.iloc[0]
        told = [
            f"In {run.seconds:.0f} s the run looks wrong {total} times, {60 * total / run.seconds:.0f} a "
            f"minute: searches that find nothing like what is asked {counts['cost']}, pops {counts['pop']}, "
            f"feet that slip {counts['slip']}. {kinds['after_transition'].sum() / total:.0%} of them come "
            f"within {costs.AFTER:g} s of a jump, as {run.blended:.0%} of all time does.",
            f"The worst is at {worst['at_s']:.1f} s: {worst['kind']}, {worst['what']}, "
            f"{worst['times']:.1f} times the bound.",
        ]
    table = costs.by_feature(run)
    if table["share"].notna().any():
        first = table.loc[table["share"].idxmax()]
        told.append(f"{first['share']:.0%} of all cost is {first['feature']}.")
    return " ".join(told)


def _some(names: Sequence[str], what: str) -> str:
    """The first of many names, and how many more."""
    return ", ".join(names[:NAMED]) + f" and {len(names) - NAMED} more {what}" * (len(names) > NAMED)
