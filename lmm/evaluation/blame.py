"""Which learned stage is to blame for what, by the rows of the mixtures: one for each set of stages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import permutations
from typing import Any, NamedTuple

from lmm.mixtures import LETTERS

NETWORKS = {"P": "Projector", "S": "Stepper", "D": "Decompressor"}
LITTLE = 0.05  # of what motion matching has: an excess below that is blamed on nobody


class Judged(NamedTuple):
    """A column of the rows of which less is better, in words, its unit, and how much of it nobody sees."""

    column: str
    words: str
    unit: str
    slack: float


JUDGED = (
    Judged("skate_cm_s", "foot skate", "cm/s", 0.5),
    Judged("path_cm", "distance from the path", "cm", 1.0),
    Judged("jerk_m_s3", "jerk", "m/s³", 10.0),
)


def shares(values: dict[str, float]) -> dict[str, float]:
    """What each learned stage adds, by its letter; the sum is what all three have more than none.

    values by letters of learned stages, all eight of them. A stage adds the mean, over the orders in which
    the three may be learned one after the other, of the change when it is its turn (Shapley's value).
    """
    out, orders = dict.fromkeys(LETTERS, 0.0), list(permutations(LETTERS))
    for order in orders:
        for turn, letter in enumerate(order):
            before, after = ("".join(sorted(order[:end], key=LETTERS.index)) for end in (turn, turn + 1))
            out[letter] += (values[after] - values[before]) / len(orders)
    return out


def told(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A sentence a column of `JUDGED` on which all eight mixtures have a number; none of those that broke."""
    by_letters = {str(row["system"]).removesuffix("-free").removeprefix("mm").removeprefix("lmm-"): row
                  for row in rows if not row.get("broke")}  # fmt: skip
    sentences = []
    for judged in JUDGED:
        values = {letters: row.get(judged.column) for letters, row in by_letters.items()}
        known = {letters: float(v) for letters, v in values.items() if v is not None and math.isfinite(v)}
        if len(known) == 2 ** len(LETTERS):
            sentences.append(_sentence(judged, known))
    return sentences


def _sentence(judged: Judged, values: dict[str, float]) -> str:
    more, added = values[LETTERS] - values[""], shares(values)
    worst = max(added, key=added.__getitem__)
    alone = values[worst] - values[""]
    comes = f"{NETWORKS[worst]} ({added[worst]:+.2g}; alone, as lmm-{worst}, {alone:+.2g})"
    seen = max(LITTLE * abs(values[""]), judged.slack)
    if more > seen:
        much = "most of it" if added[worst] > more / 2 else "the largest part of it"
        return (
            f"All three networks together have {more:.2g} {judged.unit} more {judged.words} than motion "
            f"matching; {much} comes with the {comes}."
        )
    same = f"All three networks together have no more {judged.words} than motion matching"
    if added[worst] > seen:
        return f"{same}; what adds to it is the {comes}, which the others make up for."
    return f"{same}, and none of them adds to it."
