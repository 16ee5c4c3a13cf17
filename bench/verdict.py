"""The answer of a comparison in words: a pure function from its tables to sentences.

Quality is held against motion matching with exact search. A system keeps it where no metric of `QUALITY` is
above motion matching's by more than a quarter (or by what nobody sees, where that is more), and where it does
not break. All that is said of differences follows `bench.intervals`: where no test finds one, it says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from .intervals import differences

REFERENCES = ("mm-exact", "mm-exact-free")  # the first of them that is there, or any that searches exactly
EXACT = ("mm-brute", "mm-aabb", "mm-kdtree", "mm-faiss-flat")
SHARE = 0.25  # by which a metric may be above the reference's
COST, MEMORY = "frame_mean_us", "memory_mb"
NAMED = 4  # systems that are named one by one where many are meant


class Metric(NamedTuple):
    """A column where less is better, in words, its unit, and how much more of it nobody sees.

    of_all : whether every system has it; who lacks it is not known to be good.
    """

    column: str
    words: str
    unit: str
    slack: float
    of_all: bool = True


QUALITY = (
    Metric("skate_cm_s", "foot skate", "cm/s", 1.0),
    Metric("path_cm", "distance from the path", "cm", 2.0),
    Metric("heading_deg", "error of the facing", "°", 2.0),
    Metric("speed_response_s", "time to answer a speed", "s", 0.1),
    Metric("heading_response_s", "time to answer a turn", "s", 0.1),
    Metric("jerk_m_s3", "jerk", "m/s³", 20.0),
    Metric("real_cm", "distance from real poses", "cm", 0.5),
    Metric("pose_cm", "error of decoded poses", "cm", 1.0, of_all=False),
)
BEST = ("skate_cm_s", "path_cm", "real_cm")  # of these the best are named


class Limit(NamedTuple):
    """What is a break: on a run the column is beyond most, and twice as bad as the reference's there."""

    column: str
    most: float
    words: str


BREAKS = (
    Limit("stall_s", 2.0, "stands still for {:.2g} s when asked to go"),
    Limit("path_max_cm", 150.0, "is {:.3g} cm off the path"),
)
WAY = 0.75  # of the way that is asked for, and of what the reference goes of it; less is a break


@dataclass(frozen=True)
class Verdict:
    """paragraph : the answer. systems : of each system what it has more and less of than the reference, in a
    sentence. reference : the system that others are held against, None where there is none. keeps : systems
    that keep its quality. breaks : of systems that break, how."""

    paragraph: str = ""
    systems: dict[str, str] = field(default_factory=dict)
    reference: str | None = None
    keeps: tuple[str, ...] = ()
    breaks: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Measured:
    """What a verdict follows from: tables of `bench.comparison.Comparison`, the summary without the clips."""

    summary: pd.DataFrame
    runs: pd.DataFrame
    crowd: pd.DataFrame = field(default_factory=pd.DataFrame)

    @cached_property
    def names(self) -> list[str]:
        return [str(name) for name in self.summary["system"]] if len(self.summary) else []

    @cached_property
    def reference(self) -> str | None:
        every = (*REFERENCES, *EXACT, *(f"{name}-free" for name in EXACT))
        return next((name for name in every if name in self.names), None)

    @cached_property
    def metrics(self) -> list[Metric]:
        """Those of `QUALITY` that were measured."""
        return [m for m in QUALITY if m.column in self.runs and self.runs[m.column].notna().any()]

    @cached_property
    def differences(self) -> pd.DataFrame:
        """Of all quality metrics and of the cost of a frame against the reference."""
        columns = [m.column for m in self.metrics] + [COST] * (COST in self.runs)
        if self.reference is None:
            return differences(self.runs, "", [], [])
        return differences(self.runs, self.reference, columns, self.names)

    def of(self, system: str, column: str) -> float:
        """A number of a system's row in the summary; NaN where it has none."""
        if column not in self.summary:
            return math.nan
        return float(self.summary.loc[self.summary["system"] == system, column].iloc[0])

    @cached_property
    def breaks(self) -> dict[str, str]:
        """How each system that breaks does, on which course: the worst of each kind."""
        found = {name: self._broken(name) for name in self.names}
        return {name: how for name, how in found.items() if how}

    def _broken(self, name: str) -> str:
        index = ["course", "seed"]
        runs = self.runs[self.runs["system"] == name].set_index(index)
        other = self.runs[self.runs["system"] == self.reference].set_index(index)
        told = []
        if "broke" in runs and (runs["broke"] == 1).any():
            told.append(f"shows poses that are no numbers on {_course(runs['broke'].idxmax())}")
        for limit in BREAKS:
            if limit.column in runs:
                values = runs[limit.column].astype(float)
                bad = values > limit.most
                if name != self.reference and len(other):
                    bad &= ~(values <= 2 * other[limit.column].astype(float).reindex(values.index))
                if bad.any():
                    worst = values[bad].idxmax()
                    told.append(f"{limit.words.format(values[worst])} on {_course(worst)}")
        if "speed_ratio" in runs:
            values = runs["speed_ratio"].astype(float)
            bad = values < WAY
            if name != self.reference and len(other):
                bad &= ~(values >= WAY * other["speed_ratio"].astype(float).reindex(values.index))
            if bad.any():
                worst = values[bad].idxmin()
                told.append(
                    f"goes {100 * values[worst]:.0f} % of the way that it is asked on {_course(worst)}"
                )
        return _listed(told)

    @cached_property
    def keeps(self) -> list[str]:
        """Systems that keep the reference's quality, the reference among them unless it breaks."""
        return [name for name in self.names if name not in self.breaks and not self.lost(name)]

    def lost(self, system: str) -> list[Metric]:
        """Metrics of which a system has too much more than the reference, or no number where that has one."""
        if self.reference is None or system == self.reference:
            return []
        return [m for m, more, _, most in self._judged(system) if not more <= most]

    def surely_keeps(self, system: str) -> bool:
        """Whether all of each interval is within what is allowed."""
        if self.reference is None or system == self.reference:
            return True
        return all(more + half <= most for _, more, half, most in self._judged(system))

    def _judged(self, system: str) -> Iterator[tuple[Metric, float, float, float]]:
        """Metrics, how much more a system has than the reference, half the interval, and what is allowed."""
        assert self.reference is not None
        rows = self.differences[self.differences["system"] == system].set_index("metric")
        for metric in self.metrics:
            own, row = self.of(self.reference, metric.column), rows.loc[metric.column]
            if math.isfinite(own) and (metric.of_all or math.isfinite(row["difference"])):
                yield metric, row["difference"], row["ci95"], max(SHARE * own, metric.slack)

    def least(self, column: str, among: Iterable[str]) -> list[str]:
        """The system that has least of a column, and those of which no test says that they have more.

        Where nothing can be tested, for there is one run of each, the least alone.
        """
        values = {name: value for name in among if math.isfinite(value := self.of(name, column))}
        if not values:
            return []
        first = min(values, key=values.__getitem__)
        rows = differences(self.runs, first, [column], values)
        tested = rows["units"] > 1
        return [first, *rows.loc[(tested & ~rows["significant"]) | rows["same"], "system"]]


def of(measured: Measured) -> Verdict:
    """The verdict on what was measured."""
    if not measured.names:
        return Verdict("No system was measured.")
    lines = [
        _scope(measured),
        *_reference(measured),
        *_budgets(measured),
        *_cheapest(measured),
        *_crowds(measured),
        *_best(measured),
        *_broken(measured),
    ]
    return Verdict(
        " ".join(lines),
        {name: _beside(measured, name) for name in measured.names if name != measured.reference},
        measured.reference,
        tuple(measured.keeps),
        measured.breaks,
    )


def _scope(measured: Measured) -> str:
    runs = measured.runs
    courses, each = runs["course"].nunique(), int(runs.groupby("system").size().max())
    what = (
        f"{_count(len(measured.names), 'system')} on {_count(courses, 'course')}, {_count(each, 'run')} each"
    )
    if each < 2:
        return f"{what}: of one run no difference can be tested, so none is more than what these numbers say."
    of = "courses" if courses > 1 else "seeds of the one course"
    few = ", so few that only large ones are found" if (courses if courses > 1 else each) < 5 else ""
    return f"{what}; what is called a difference is significant over the {of}{few}."


def _reference(measured: Measured) -> list[str]:
    name = measured.reference
    if name is None:
        return ["There is no exact motion matching among them to hold the quality of others against."]
    facts = _costs(measured, name)
    lines = [f"{name} takes {facts}." if facts else f"{name} is what others are held against."]
    judged = _listed([m.words for m in measured.metrics])
    if judged and len(measured.names) > 1:
        lines.append(
            f"Its quality is kept by who does not break and has at most {100 * SHARE:.0f} % more, or what "
            f"nobody sees more, of {judged}."
        )
    return lines


def _budgets(measured: Measured) -> list[str]:
    """What is the smallest, and what less time costs in memory, among those that keep the quality."""
    out = []
    sized = {n: v for n in measured.names if math.isfinite(v := measured.of(n, MEMORY))}
    if not sized:
        return []
    keeping = sorted((n for n in measured.keeps if n in sized), key=lambda n: (sized[n], _cost(measured, n)))
    smallest = min(sized, key=lambda n: (sized[n], _cost(measured, n)))
    if not keeping:
        out.append("None keeps the quality.")
    elif keeping == [measured.reference]:
        out.append(f"None but {measured.reference} keeps the quality, however much memory there is.")
    else:
        front = [keeping[0]]
        for name in keeping[1:]:
            if measured.least(COST, [front[-1], name]) == [name]:
                front.append(name)
        first = f"{front[0]} is the smallest, with {_costs(measured, front[0], beside=True)}"
        steps = [first + _unsure(measured, front[0])]
        for name in front[1:]:
            frame = f"{name}, {_number(_cost(measured, name))} µs{_unsure(measured, name)}"
            steps.append(f"who has {_number(sized[name])} MB gets a cheaper frame from {frame}")
        kept = f"With the quality of {measured.reference} kept, " if measured.reference else ""
        out.append(kept + "; ".join(steps) + ".")
    if smallest not in keeping:
        lost = f"it has too much {_listed([m.words for m in measured.lost(smallest)])}"
        why = f"it {measured.breaks[smallest]}" if smallest in measured.breaks else lost
        out.append(f"Smaller without that is {smallest}, with {_number(sized[smallest])} MB: {why}.")
    return out


def _unsure(measured: Measured, name: str) -> str:
    return "" if measured.surely_keeps(name) else " (kept in the mean; its intervals reach further)"


def _cheapest(measured: Measured) -> list[str]:
    among = measured.keeps or measured.names
    best = measured.least(COST, among)
    if not best:
        return []
    these = " among these" if measured.keeps else ""
    out = [f"The cheapest frame of one character{these} is {_ties(measured, best, COST, 'µs')}."]
    every = measured.least(COST, measured.names)
    if every[0] not in among and every[0] not in best:
        out.append(f"{every[0]} takes {_number(measured.of(every[0], COST))} µs, without that quality.")
    return out


def _crowds(measured: Measured) -> list[str]:
    crowd = measured.crowd
    if not len(crowd) or not np.isfinite(crowd["us"]).any():
        return []
    crowd = crowd[np.isfinite(crowd["us"])]
    count = int(crowd["characters"].max())
    rows = crowd[crowd["characters"] == count].sort_values("us", kind="stable")
    first = rows.iloc[0]
    if len(rows) == 1:
        return [f"In a crowd of {count:,} {first['system']} takes {_number(first['us'])} µs a character."]
    ties = rows.iloc[1:]
    ties = ties[ties["least_us"] <= first["most_us"]]
    told = (
        f"Of crowds of {count:,}, {first['system']}'s is the cheapest, {_number(first['us'])} µs a character"
    )
    if len(ties):
        told += f", but {_some(list(ties['system']))} did as well in some of the repeats"
    last = rows.iloc[-1]
    told += f"; {last['system']} takes {_number(last['us'])} µs"
    without = [n for n in (first["system"],) if measured.keeps and n not in measured.keeps]
    return [told + (" (the cheapest does not keep the quality)." if without else ".")]


def _best(measured: Measured) -> list[str]:
    out, alike = list[str](), list[str]()
    sound = [name for name in measured.names if name not in measured.breaks]
    for metric in measured.metrics:
        if metric.column in BEST and len(sound) > 1:
            best = measured.least(metric.column, sound)
            judged = [name for name in sound if math.isfinite(measured.of(name, metric.column))]
            if len(best) == len(judged) > 1:
                alike.append(metric.words)
            elif best:
                out.append(
                    f"{metric.words} is least with {_ties(measured, best, metric.column, metric.unit)}"
                )
    if alike:
        out.append(f"in {_listed(alike)} none is shown to be ahead of another")
    if not out:
        return []
    text = "; ".join(out)
    return [text[0].upper() + text[1:] + "."]


def _broken(measured: Measured) -> list[str]:
    if not measured.breaks:
        return ["None breaks."] if len(measured.names) > 1 else []
    return [f"{name} {how}." for name, how in measured.breaks.items()]


def _beside(measured: Measured, name: str) -> str:
    """What a system has more and less of than the reference."""
    told = [_costs(measured, name, beside=True)]
    rows = measured.differences[measured.differences["system"] == name].set_index("metric")
    worse, better, open_, same = (list[str]() for _ in range(4))
    for metric in measured.metrics if measured.reference else ():
        row = rows.loc[metric.column]
        if not math.isfinite(row["difference"]):
            continue
        if row["same"]:
            same.append(metric.words)
        elif not row["significant"]:
            open_.append(metric.words)
        else:
            text = f"{metric.words} ({_signed(row['difference'], row['ci95'])} {metric.unit})"
            (worse if row["difference"] > 0 else better).append(text)
    if same and not (worse or better or open_):
        told.append("the same motion")
    else:
        told += [f"more {_listed(worse)}"] * bool(worse) + [f"less {_listed(better)}"] * bool(better)
        told += [f"no significant difference in {_listed(open_)}"] * bool(open_)
        told += [f"the same {_listed(same)}"] * bool(same)
    if name in measured.breaks:
        told.append(f"it {measured.breaks[name]}")
    return "; ".join(filter(None, told)) + "."


def _costs(measured: Measured, name: str, *, beside: bool = False) -> str:
    """Memory and time of a frame, and how they are beside the reference's."""
    out = []
    for column, unit in ((MEMORY, "MB"), (COST, "µs a frame")):
        value = measured.of(name, column)
        if not math.isfinite(value):
            continue
        own = measured.of(measured.reference, column) if beside and measured.reference else math.nan
        more = f" ({_times(value, own)})" if name != measured.reference and own > 0 else ""
        out.append(f"{_number(value)} {unit}{more}")
    return _listed(out)


def _times(value: float, own: float) -> str:
    share = value / own
    if 0.99 <= share <= 1.01:
        return "as much"
    if share >= 2:
        return f"{_number(share)} times as much"
    if share <= 0.5:
        return f"{_number(1 / share)} times less"
    return f"{abs(100 * (share - 1)):.0f} % {'more' if share > 1 else 'less'}"


def _ties(measured: Measured, names: Sequence[str], column: str, unit: str) -> str:
    first, *others = names
    told = f"{first}{'' if column != COST else chr(39) + 's'}, {_number(measured.of(first, column))} {unit}"
    if others:
        values = [measured.of(name, column) for name in others]
        same = [n for n, v in zip(others, values, strict=True) if v == measured.of(first, column)]
        open_ = [n for n in others if n not in same]
        told += f" (the same as {_some(same)})" * bool(same)
        told += f" (not significantly less than {_some(open_)})" * bool(open_)
    return told


def _cost(measured: Measured, name: str) -> float:
    value = measured.of(name, COST)
    return value if math.isfinite(value) else math.inf


def _some(names: Sequence[str]) -> str:
    rest = len(names) - NAMED
    return _listed([*names[:NAMED], f"{rest} others"] if rest > 1 else list(names))


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _signed(value: float, half: float) -> str:
    sign = "+" if value > 0 else "−"
    within = f" ± {_number(half)}" if half > 0 else ""
    return f"{sign}{_number(abs(value))}{within}"


def _course(at: tuple[str, int]) -> str:
    course, seed = at
    return f"{course} (seed {seed})" if seed else str(course)
