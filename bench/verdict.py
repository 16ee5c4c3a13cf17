"""The answer of a comparison in words: a pure function from its tables to sentences.

Quality is held against motion matching with exact search. A system keeps it where no metric of `QUALITY` is
above motion matching's by more than a quarter (or by what nobody sees, where that is more), and where it
fails on no course. All that is said of differences follows `bench.intervals`: where no test finds one, it
says so.
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
FEW = 5  # courses, fewer of which show only large differences
DOUBTS = 2  # metrics of which it is told how much worse a system may be
NAMED = 4  # systems that are named one by one where many are meant


class Metric(NamedTuple):
    """A column where less is better, in words, its unit, and how much more of it nobody sees.

    of_all : whether every system has it; who lacks it is not known to be good. times : by which its numbers
    are multiplied to be in its unit. sampled : whether it is of runs; else it is of the system, and no run
    can have another one.
    """

    column: str
    words: str
    unit: str
    slack: float
    of_all: bool = True
    times: float = 1.0
    sampled: bool = True

    def told(self, value: float, *, unit: bool = True) -> str:
        """A number of the column in the metric's unit."""
        space = "" if self.unit == "°" else " "
        return _number(self.times * value) + f"{space}{self.unit}" * unit


QUALITY = (
    Metric("skate_cm_s", "foot skate", "cm/s", 1.0),
    Metric("path_cm", "distance from the path", "cm", 2.0),
    Metric("heading_deg", "error of the facing", "°", 2.0),
    Metric("speed_response_s", "time to answer a speed", "s", 0.1),
    Metric("heading_response_s", "time to answer a turn", "s", 0.1),
    Metric("unanswered_share", "commands left unanswered", "%", 0.1, times=100.0),
    Metric("jerk_m_s3", "jerk", "m/s³", 20.0),
    Metric("real_cm", "distance from real poses", "cm", 0.5),
    Metric("pose_cm", "error of decoded poses", "cm", 1.0, of_all=False, sampled=False),
)
BEST = ("skate_cm_s", "path_cm", "jerk_m_s3", "real_cm")  # it is told who has less than the reference


class Limit(NamedTuple):
    """What is a failure: on a run the column is beyond most, and twice as bad as the reference's there."""

    column: str
    most: float
    words: str


BREAKS = (
    Limit("stall_s", 2.0, "stands still for {:.2g} s when asked to go"),
    Limit("path_max_cm", 150.0, "is {:.3g} cm off the path"),
)
WAY = 0.75  # of the way that is asked for, and of what the reference goes of it; less is a failure


@dataclass(frozen=True)
class Verdict:
    """paragraph : the answer. rule : what it means to keep the quality. systems : of each system what it has
    more and less of than the reference, in a sentence. reference : the system that others are held against,
    None where there is none. keeps : systems that keep its quality. budgets : those of them to take, from the
    smallest to the fastest, each with the least memory for its time. breaks : of systems that fail, how."""

    paragraph: str = ""
    rule: str = ""
    systems: dict[str, str] = field(default_factory=dict)
    reference: str | None = None
    keeps: tuple[str, ...] = ()
    budgets: tuple[str, ...] = ()
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
        """Of all quality metrics and of the cost of a frame against the reference.

        What is of systems and not of runs needs no test: its rows have 0 units, and p is 0 or 1.
        """
        if self.reference is None:
            return differences(self.runs, "", [], [])
        columns = [m.column for m in self.metrics if m.sampled] + [COST] * (COST in self.runs)
        tested = differences(self.runs, self.reference, columns, self.names)
        rows = []
        for column in (m.column for m in self.metrics if not m.sampled):
            for name in (name for name in self.names if name != self.reference):
                more = self.of(name, column) - self.of(self.reference, column)
                facts = {"metric": column, "system": name, "reference": self.reference, "difference": more}
                known = {"ci95": 0 * more, "units": 0, "p": float(more == 0) + 0 * more}
                rows.append(facts | known | {"significant": abs(more) > 0, "same": more == 0})
        return pd.concat([tested, pd.DataFrame(rows)], ignore_index=True) if rows else tested

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

    def _runs_of(self, name: str | None) -> pd.DataFrame:
        return self.runs[self.runs["system"] == name].set_index(["course", "seed"])

    def _broken(self, name: str) -> str:
        runs, other = self._runs_of(name), self._runs_of(self.reference)
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
        """Systems that keep the reference's quality, itself among them."""
        return [name for name in self.names if self.sound(name) and not self.lost(name)]

    def sound(self, system: str) -> bool:
        """Whether a system fails nowhere; the reference is what it is, as long as it shows poses at all."""
        if system == self.reference:
            return "broke" not in self.runs or not (self._runs_of(system)["broke"] == 1).any()
        return system not in self.breaks

    def lost(self, system: str) -> list[Metric]:
        """Metrics of which a system has too much more than the reference, or no number where that has one."""
        if self.reference is None or system == self.reference:
            return []
        return [m for m, more, _, most in self._judged(system) if not more <= most]

    def doubted(self, system: str) -> list[tuple[Metric, float, float]]:
        """Metrics of one that keeps the quality whose interval reaches beyond what is allowed, how far above
        the reference it reaches, and how far it may."""
        if self.reference is None or system == self.reference:
            return []
        judged = self._judged(system)
        return [(metric, more + half, most) for metric, more, half, most in judged if more + half > most]

    @cached_property
    def budgets(self) -> list[str]:
        """Of the systems that keep the quality those that none as small is shown to be faster than."""
        keeping = [name for name in self.keeps if math.isfinite(self.of(name, MEMORY))]
        keeping.sort(key=lambda name: (self.of(name, MEMORY), self.cost(name)))
        front = keeping[:1]
        for name in keeping[1:]:
            if self.least(COST, [front[-1], name]) == [name]:
                front.append(name)
        return front

    def cost(self, system: str) -> float:
        """Microseconds of a frame; infinite where they are not known."""
        value = self.of(system, COST)
        return value if math.isfinite(value) else math.inf

    def _judged(self, system: str) -> Iterator[tuple[Metric, float, float, float]]:
        """Metrics, how much more a system has than the reference, half the interval, and what is allowed."""
        assert self.reference is not None
        rows = self.differences[self.differences["system"] == system].set_index("metric")
        for metric in self.metrics:
            own, row = self.of(self.reference, metric.column), rows.loc[metric.column]
            if math.isfinite(own) and (metric.of_all or math.isfinite(row["difference"])):
                yield metric, row["difference"], row["ci95"], max(SHARE * own, metric.slack)

    def tested(self, column: str) -> bool:
        """Whether differences of a column can be told from chance at all."""
        rows = self.differences[self.differences["metric"] == column]
        return bool((rows["units"] > 1).any())

    def least(self, column: str, among: Iterable[str]) -> list[str]:
        """The system that has least of a column, and those of which no test says that they have more.

        Where nothing can be tested, for there is one run of each, the least alone.
        """
        first, rows = self.beside_least(column, among)
        tested = rows["units"] > 1
        return [first, *rows.loc[(tested & ~rows["significant"]) | rows["same"], "system"]] if first else []

    def beside_least(self, column: str, among: Iterable[str]) -> tuple[str, pd.DataFrame]:
        """The system that has least of a column, and how much more others have (`differences`)."""
        values = {name: value for name in among if math.isfinite(value := self.of(name, column))}
        first = min(values, key=values.__getitem__, default="")
        return first, differences(self.runs, first, [column] if first else [], values)


def of(measured: Measured) -> Verdict:
    """The verdict on what was measured."""
    if not measured.names:
        return Verdict("No system was measured.")
    lines = [
        _scope(measured),
        *_reference(measured),
        *_budgets(measured),
        *_beyond(measured),
        *_crowds(measured),
        *_better(measured),
        *_failing(measured),
    ]
    return Verdict(
        " ".join(lines),
        _rule(measured),
        {name: _beside(measured, name) for name in measured.names if name != measured.reference},
        measured.reference,
        tuple(measured.keeps),
        tuple(measured.budgets),
        measured.breaks,
    )


def _scope(measured: Measured) -> str:
    runs = measured.runs
    courses, each = runs["course"].nunique(), int(runs.groupby("system").size().max())
    what = (
        f"{_count(len(measured.names), 'system')} on {_count(courses, 'course')}, {_count(each, 'run')} each"
    )
    if len(measured.names) < 2:
        return f"{what}."
    if each < 2:
        return f"{what}: of one run no difference can be tested, so these numbers stand for that run alone."
    of = "courses" if courses > 1 else "seeds of the one course"
    few = "; with so few it finds only large ones" if courses < FEW else ""
    return f"{what}. A difference is only called one where a paired test over the {of} finds it{few}."


def _reference(measured: Measured) -> list[str]:
    name = measured.reference
    if name is None:
        return ["There is no exact motion matching among them to hold the quality of others against."]
    facts = _costs(measured, name)
    return [f"Motion matching with exact search, {name}, is the yardstick{f': {facts}' if facts else ''}."]


def _rule(measured: Measured) -> str:
    """What it means to keep the quality, and to fail."""
    if measured.reference is None or not measured.metrics or len(measured.names) < 2:
        return ""
    judged = _listed([f"{m.words} ({m.told(m.slack)})" for m in measured.metrics])
    stall, stray = (limit.most for limit in BREAKS)
    own = measured.reference
    return (
        f"A system keeps {own}'s quality if it fails on no course and if, on average over the courses, it "
        f"exceeds {own} by at most {100 * SHARE:.0f} %, or by at most the amount in brackets, in each of "
        f"these: {judged}. It fails on a course if its poses are no numbers; if it stands still for more "
        f"than {stall:g} s when asked to go, or is more than {stray:g} cm off the path, and that is more "
        f"than twice what {own} does there; or if it goes less than {100 * WAY:.0f} % of the way asked for, "
        f"and of the way that {own} goes."
    )


def _budgets(measured: Measured) -> list[str]:
    """What is the smallest, and what less time costs in memory, among those that keep the quality."""
    reference, front = measured.reference, measured.budgets
    what = f"keeps {reference}'s quality" if reference else "fails on no course"
    if len(measured.names) < 2:
        return []
    if not measured.keeps:
        return [f"No system {what}."]
    if measured.keeps == [reference]:
        return [f"No other system {what}, whatever memory and time it takes."]
    if not front:
        return []
    facts = _costs(measured, front[0], beside=True)
    out = [f"The smallest that {what} is {front[0]}: {facts}."]
    if doubts := _doubts(measured, front[0]):
        out.append(f"That holds on average: {doubts}.")
    steps = [
        f"{name} ({_number(measured.cost(name))} µs, {_number(measured.of(name, MEMORY))} MB"
        f"{'; on average' if measured.doubted(name) else ''})"
        for name in front[1:]
    ]
    if steps:
        out.append(f"Faster, for more memory: {_listed(steps, last='then')}.")
    elif len(measured.keeps) > 1 and math.isfinite(measured.cost(front[0])):
        out.append("None that takes more memory is shown to be faster.")
    return out


def _doubts(measured: Measured, name: str) -> str:
    """By how much a system that keeps the quality may yet be worse than allowed; nothing where it is sure."""
    doubted = sorted(measured.doubted(name), key=lambda doubt: doubt[1] / doubt[2], reverse=True)
    worst = [
        f"{metric.told(more)} more {metric.words} ({metric.told(most, unit=False)} is allowed)"
        for metric, more, most in doubted[:DOUBTS]
    ]
    rest = [metric.words for metric, *_ in doubted[DOUBTS:]]
    if rest:
        worst.append(f"more than is allowed of {_listed(rest)}")
    if not worst:
        return ""
    unit = "course" if measured.runs["course"].nunique() > 1 else "seed"
    count = measured.runs[unit].nunique()
    return f"{_count(count, unit)} cannot rule out that it has up to {_listed(worst)}"


def _beyond(measured: Measured) -> list[str]:
    """Who is smaller, or faster, than all that keep the quality, and what that costs."""
    told: dict[str, list[str]] = {}
    for column, word in ((MEMORY, "smaller"), (COST, "faster")):
        known = [name for name in measured.names if math.isfinite(measured.of(name, column))]
        known.sort(key=lambda name: measured.of(name, column))
        keeping = [name for name in known if name in measured.keeps]
        if not keeping or measured.of(known[0], column) == measured.of(keeping[0], column):
            continue
        if column == MEMORY or measured.least(COST, [known[0], keeping[0]]) == [known[0]]:
            told.setdefault(known[0], []).append(word)
    return [
        f"{_sentence(_listed(words))} still is {name}, {_costs(measured, name)}, but it "
        f"{_why_not(measured, name)}."
        for name, words in told.items()
    ]


def _why_not(measured: Measured, name: str) -> str:
    """Why a system does not keep the quality, after "it"."""
    if name in measured.breaks:
        return measured.breaks[name]
    lost = {metric: _apart(measured, metric, name) for metric in measured.lost(name)}
    more = [f"{metric.words} ({apart})" for metric, apart in lost.items() if apart]
    without = [metric.words for metric, apart in lost.items() if not apart]
    told = [f"has more {_listed(more)}"] * bool(more)
    return _listed(told + [f"has no {_listed(without)} to judge by"] * bool(without))


def _apart(measured: Measured, metric: Metric, name: str) -> str:
    """How much more of a metric a system has than the reference; nothing where that is not known."""
    rows = measured.differences
    row = rows[(rows["system"] == name) & (rows["metric"] == metric.column)].iloc[0]
    if not math.isfinite(row["difference"]):
        return ""
    return _signed(metric, row["difference"], row["ci95"])


def _crowds(measured: Measured) -> list[str]:
    crowd = measured.crowd
    if not len(crowd) or not np.isfinite(crowd["us"]).any():
        return []
    crowd = crowd[np.isfinite(crowd["us"])]
    count = int(crowd["characters"].max())
    rows = crowd[crowd["characters"] == count].sort_values("us", kind="stable")
    first, last = rows.iloc[0], rows.iloc[-1]
    if len(rows) == 1:
        return [f"In a crowd of {count:,} {first['system']} takes {_number(first['us'])} µs a character."]
    told = f"In a crowd of {count:,} the cheapest is {first['system']}, {_number(first['us'])} µs a character"
    others = rows.iloc[1:]
    ties = others[others["least_us"] <= first["most_us"]]
    if len(ties):
        told += f" (too close to call: {_some(list(ties['system']))})"
    if first["system"] not in measured.keeps and measured.keeps:
        keeping = rows[rows["system"].isin(measured.keeps)]
        told += ", which does not keep the quality"
        if len(keeping):
            best = keeping.iloc[0]
            told += f"; of those that do it is {best['system']}, {_number(best['us'])} µs"
    return [f"{told}; the most expensive is {last['system']}, {_number(last['us'])} µs."]


def _better(measured: Measured) -> list[str]:
    """Who has less of something than the reference, of those that do not fail."""
    reference = measured.reference
    sound = [name for name in measured.names if measured.sound(name)]
    if reference not in sound or len(sound) < 2:
        return []
    ahead, level = list[str](), list[str]()
    for metric in measured.metrics:
        if metric.column in BEST and measured.tested(metric.column):
            best, rows = measured.beside_least(metric.column, sound)
            if rows.loc[rows["system"] == reference, "significant"].any():
                ahead.append(f"{best} in {metric.words} ({_apart(measured, metric, best)})")
            else:
                level.append(metric.words)
    out = [f"Better than {reference}: {_listed(ahead)}."] * bool(ahead)
    if level:
        out.append(f"No system is shown to be better than {reference} in {_listed(level, last='or')}.")
    return out


def _failing(measured: Measured) -> list[str]:
    reference, out = measured.reference, list[str]()
    others = [name for name in measured.breaks if name != reference]
    if reference in measured.breaks:
        out.append(
            f"{reference} itself {measured.breaks[reference]}; others fail there if they do far worse."
        )
    if len(others) > NAMED:
        out.append(f"{_count(len(others), 'system')} fail: {_some(others)}.")
    elif others:
        out += [f"{name} {measured.breaks[name]}." for name in others]
    elif len(measured.names) > 1:
        out.append("No other fails on any course." if out else "None fails on any course.")
    return out


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
            text = f"{metric.words} ({_apart(measured, metric, name)})"
            (worse if row["difference"] > 0 else better).append(text)
    if same and not (worse or better or open_):
        told.append("the same motion")
    else:
        told += [f"more {_listed(worse)}"] * bool(worse) + [f"less {_listed(better)}"] * bool(better)
        told += [f"no significant difference in {_listed(open_)}"] * bool(open_)
        told += [f"no difference at all in {_listed(same)}"] * bool(same)
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


def _some(names: Sequence[str]) -> str:
    rest = len(names) - NAMED
    return _listed([*names[:NAMED], f"{rest} others"] if rest > 1 else list(names))


def _listed(words: Sequence[str], *, last: str = "and") -> str:
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _signed(metric: Metric, value: float, half: float) -> str:
    sign = "+" if value > 0 else "−"
    within = f" ± {metric.told(half)}" if half > 0 else ""
    return f"{sign}{metric.told(abs(value), unit=not within)}{within}"


def _course(at: tuple[str, int]) -> str:
    course, seed = at
    return f"{course} (seed {seed})" if seed else str(course)
