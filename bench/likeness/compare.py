"""Two sources cut into the same moves, and a row of numbers for each move and measure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mm import metrics
from motion import sources
from motion.errors import UserError

from . import measures, moves
from .body import Body
from .measures import Gauge
from .moves import Passage

Array = NDArray[np.floating]

ENOUGH = 4  # passages from which a spread means something
SPREAD = (10, 90)  # percentiles
NEAR = 0.05  # share of b's median by which a may lie off in any case
LEAST = {"°": 1.0, "% leg": 0.3, "%": 1.0, "steps/min": 2.0, "m": 0.02, "cm": 0.2}  # what nobody sees
LESS = ("jerk", "15-30 Hz", "skate", "moves", "p95", "below its rest", "below y = 0")  # the less, the better
TYPICAL = (
    *("cadence", "knee range", "hip range", "ankle range", "pelvis_height range", "trunk_lean mean"),
    *("shoulder range", "elbow mean", "step width", "turn"),
)


@dataclass(eq=False)
class Side:
    """One of the two sources: its passages by move, with gauges and numbers.

    numbers holds for each move a frame with a row a passage, columns the measures.
    """

    name: str
    clips: int = 0
    seconds: float = 0.0
    legs: list[float] = field(default_factory=list)
    passages: dict[str, list[Passage]] = field(default_factory=dict)
    gauges: dict[Body, Gauge] = field(default_factory=dict)
    numbers: dict[str, pd.DataFrame] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    def add(self, body: Body) -> None:
        self.clips += 1
        self.seconds += body.clip.seconds
        self.legs.append(body.leg)
        self.gauges[body] = Gauge.of(body)
        for passage in moves.passages(body):
            self.passages.setdefault(passage.move, []).append(passage)

    def measure(self) -> None:
        for move, passages in self.passages.items():
            rows = []
            for passage in passages:
                found = measures.measure(self.gauges[passage.body], passage)
                self.units |= {name: unit for name, (_, unit) in found.items()}
                rows.append({name: value for name, (value, _) in found.items()})
            self.numbers[move] = pd.DataFrame(rows)

    def typical(self, move: str, like: Passage | None = None) -> Passage:
        """The passage in the middle of what this source does there; near to the speed and side of another."""
        table, passages = self.numbers[move], self.passages[move]
        speed = like.speed if like else float(table["speed"].median())
        far = (15 if like else 3) * np.abs(table["speed"].to_numpy() - speed) / max(0.05, 0.1 * speed)
        if like:
            far = far + np.abs(np.array([p.turn for p in passages]) - like.turn) / 10
            far = far + np.abs(metrics.wrap(np.radians([p.angle - like.angle for p in passages]))) / 0.3
        for name in TYPICAL:
            if name in table and table[name].notna().any():
                values = table[name]
                spread = max(float(values.std(ddof=0)), 1e-3)
                far = far + np.abs(values.fillna(values.median()).to_numpy() - values.median()) / spread
        # Strips begin at the left foot's strike.
        lefts = np.array([p.side != "right" for p in passages])
        return passages[int(np.argmin(np.where(lefts, far, np.inf) if lefts.any() else far))]


@dataclass(eq=False)
class Likeness:
    """What two sources have in common, and how far they are apart.

    table has a row a move and measure: a, a_low, a_high, b, b_low, b_high (medians, and percentiles 10 and
    90), inside (whether a lies in b's spread; None where b has too few passages to have one) and off, by how
    many half-spreads a lies from b.
    """

    a: Side
    b: Side
    moves: list[str]
    table: pd.DataFrame
    notes: list[str]

    def summary(self) -> list[dict[str, Any]]:
        """A row a move that either has."""
        rows = []
        for move in sorted({*self.a.passages, *self.b.passages}, key=moves.order):
            part = self.table[(self.table["move"] == move) & self.table["inside"].notna()]
            sides = {name: side.numbers.get(move) for name, side in (("A", self.a), ("B", self.b))}
            row: dict[str, Any] = {"move": move}
            for name, numbers in sides.items():
                row[f"passages {name}"] = 0 if numbers is None else len(numbers)
            for name, numbers in sides.items():
                row[f"speed {name}"] = None if numbers is None else float(numbers["speed"].median())
            row["measures"] = len(part) or None
            row["inside"] = float(part["inside"].astype(float).mean()) if len(part) else None
            row["median off"] = float(part["off"].abs().median()) if len(part) else None
            rows.append(row)
        return rows

    def by_measure(self, count: int | None = None) -> list[dict[str, Any]]:
        """A row a measure that is outside in some move, over all moves; the most often outside first."""
        known = self.table[self.table["inside"].notna()]
        rows = [
            {
                "measure": name,
                "unit": part["unit"].iloc[0],
                "moves": len(part),
                "inside": float(part["inside"].astype(float).mean()),
                "median off": float(part["off"].median()),
                "A": float(part["a"].median()),
                "B": float(part["b"].median()),
            }
            for name, part in known.groupby("measure", sort=False)
        ]
        rows.sort(key=lambda row: (row["inside"], -abs(row["median off"])))
        return [row for row in rows if row["inside"] < 1][:count]

    def worst(self, count: int) -> pd.DataFrame:
        """The rows farthest outside of b's spread."""
        outside = self.table[self.table["inside"] == False]  # noqa: E712
        return outside.loc[outside["off"].abs().sort_values(ascending=False).index].head(count)


def compare(
    a: Sequence[Path | str],
    b: Sequence[Path | str],
    *,
    exclude: Sequence[str] = (),
    only: Sequence[str] | None = None,
    note: Callable[[str], None] | None = None,
    progress: Callable[..., Iterator[Any]] | None = None,
) -> Likeness:
    """Put the motion of sources a beside that of b (files and folders).

    exclude are shell patterns of clips to leave out of either; only, moves (or their first words) to look at.
    Clips that cannot be judged are left out with a note; a source without a single clip, and sources without
    a move in common, are UserErrors.
    """
    notes: list[str] = []
    for pattern in exclude:
        if not any(_matches(paths, pattern) for paths in (a, b)):
            sources.find([*a, *b], exclude=[pattern])  # says which clips there are
    sides = [_read(paths, exclude, notes, progress) for paths in (a, b)]
    for name in only or ():
        if not any(name in (move, move.split()[0]) for side in sides for move in side.passages):
            there = sorted({move for side in sides for move in side.passages}, key=moves.order)
            raise UserError(
                f"no move {name!r}", remedy=f"the two have {', '.join(there) or 'none with a name'}"
            )
    for side in sides:
        if only:
            side.passages = {
                move: found
                for move, found in side.passages.items()
                if move in only or move.split()[0] in only
            }
        side.measure()
    one, two = sides
    common = sorted(one.passages.keys() & two.passages.keys(), key=moves.order)
    if not common:
        has = [", ".join(sorted(s.passages, key=moves.order)) or "no move that has a name" for s in sides]
        raise UserError(
            f"the two have no move in common: {one.name} has {has[0]}; {two.name} has {has[1]}",
            remedy="give longer clips, or leave --only out",
        )
    rows = [row for move in common for row in _rows(move, one, two)]
    for line in notes:
        if note is not None:
            note(line)
    return Likeness(one, two, common, pd.DataFrame(rows), notes)


def _read(
    paths: Sequence[Path | str], exclude: Sequence[str], notes: list[str], progress: Callable | None
) -> Side:
    side = Side(", ".join(map(str, paths)))
    everything = sources.find(paths)
    # A pattern may be meant for the other source alone.
    patterns = [pattern for pattern in exclude if _matches(paths, pattern)]
    found = sources.find(paths, exclude=patterns) if patterns else everything
    bad: list[UserError] = []
    for file in progress(found, label=f"read {side.name}") if progress else found:
        try:
            side.add(Body.of(sources.load(file)))
        except UserError as error:
            bad.append(error)
    if side.clips == 0:
        raise UserError(f"no clip of {len(found)} can be judged; the first: {bad[0]}")
    notes += [f"left out: {error}" for error in bad]
    return side


def _matches(paths: Sequence[Path | str], pattern: str) -> bool:
    try:
        sources.find(paths, exclude=[pattern])
    except UserError as error:
        return "no clip to exclude" not in error.what
    return True


def _rows(move: str, one: Side, two: Side) -> Iterator[dict[str, Any]]:
    a, b = one.numbers[move], two.numbers[move]
    for name in a.columns:
        if name not in b or b[name].notna().sum() == 0 or a[name].notna().sum() == 0:
            continue
        unit = one.units[name]
        yield {
            "move": move,
            "measure": name,
            "unit": unit,
            **judge(a[name], b[name], LEAST.get(unit, 0.0), less=name.endswith(LESS)),
        }


def judge(a: Any, b: Any, least: float = 0.0, *, less: bool = False) -> dict[str, Any]:
    """Medians and spreads of values a and b, NaN left out, and whether a's median lies in b's spread.

    The spread is widened to least, and to 5 % of b's median, on both sides of that: a difference that nobody
    sees. less: what lies below it counts as inside (jerk, skate: noise of a capture is nothing to aim for).
    """
    a, b = (np.asarray(v, np.float64)[np.isfinite(np.asarray(v, np.float64))] for v in (a, b))
    a_low, a_mid, a_high = np.percentile(a, (SPREAD[0], 50, SPREAD[1]))
    b_low, b_mid, b_high = np.percentile(b, (SPREAD[0], 50, SPREAD[1]))
    least = max(least, NEAR * abs(b_mid), 1e-9)
    low, high = min(b_low, b_mid - least), max(b_high, b_mid + least)
    half = high - b_mid if a_mid > b_mid else b_mid - low
    known = len(b) >= ENOUGH
    return {
        "a": a_mid,
        "a_low": a_low,
        "a_high": a_high,
        "b": b_mid,
        "b_low": b_low,
        "b_high": b_high,
        "inside": bool((less or low <= a_mid) and a_mid <= high) if known else None,
        "off": float((a_mid - b_mid) / half) if known else float("nan"),
        "ratio_db": float(20 * np.log10(a_mid / b_mid)) if a_mid > 0 and b_mid > 0 else float("nan"),
        "n_a": len(a),
        "n_b": len(b),
    }
