"""How sure means over courses and seeds are, and which differences between systems are more than chance.

Runs are a row a system, course and seed. Seeds of one course are no independent witnesses of how a system
does on courses, so the seeds of each course are averaged first and courses are what is counted: a Student's
t interval of the courses' means (the summary measures of Matthews and others, BMJ 300, 1990), which has what
seeds differ by within it. Of one course alone its seeds are counted. Systems are compared by the differences
on the same courses and seeds (a paired t test); where many are compared in one metric, Holm's correction
(Scandinavian Journal of Statistics 6, 1979) keeps the chance that any difference is called one by mistake
below 5 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

LEVEL = 0.95
CI = "_ci95"  # how the column ends that has half the width of a metric's interval


@dataclass(frozen=True)
class Interval:
    """A mean, half the width of its 95 % interval, of how many units it is, and how likely so much is chance.

    half and p, two-sided for a true mean of 0, are NaN of less than two units, and mean is of none; but of
    what is 0 without exception half is 0 and p is 1. Of what is the same without exception, as times counted
    in frames may be, no spread is known: half is 0, and p is that of as many signs alike, 2^(1 - units).
    """

    mean: float
    half: float
    units: int
    p: float

    @property
    def nothing(self) -> bool:
        """Whether it is of what is 0 without exception."""
        return self.mean == 0 and self.half == 0


def of_means(values: NDArray[np.float64]) -> Interval:
    """The t interval of values [n], those that are no numbers left out."""
    from scipy.special import stdtr, stdtrit

    known = values[np.isfinite(values)]
    n = len(known)
    if n and not known.any():
        return Interval(0.0, 0.0, n, 1.0)
    if n < 2:
        return Interval(float(known.mean()) if n else math.nan, math.nan, n, math.nan)
    mean, error = float(known.mean()), float(known.std(ddof=1) / math.sqrt(n))
    if error <= 1e-12 * abs(mean):
        return Interval(mean, 0.0, n, 2.0 ** (1 - n))
    half = float(stdtrit(n - 1, (1 + LEVEL) / 2)) * error
    return Interval(mean, half, n, float(2 * stdtr(n - 1, -abs(mean) / error)))


def over_courses(courses: NDArray[Any], values: NDArray[np.float64]) -> Interval:
    """Of values [n] of runs on courses [n]: of the courses' means, or of one course's own values."""
    known = np.isfinite(values)
    names, which = np.unique(courses[known], return_inverse=True)
    if len(names) == 1:
        return of_means(values)
    sums = np.bincount(which, values[known], len(names))
    return of_means(sums / np.bincount(which, minlength=len(names)))


def of_runs(runs: pd.DataFrame, column: str) -> Interval:
    """Of a column of one system's runs."""
    return over_courses(_courses(runs["course"]), runs[column].to_numpy(float))


def paired(runs: pd.DataFrame, system: str, other: str, column: str) -> Interval:
    """How much more of a column a system has than another on the same courses and seeds."""
    return _pairs(runs, column)(system, other)


def _pairs(runs: pd.DataFrame, column: str) -> Callable[[str, str], Interval]:
    wide = runs.pivot(index=["course", "seed"], columns="system", values=column).astype(float)
    courses = _courses(wide.index.get_level_values("course"))
    return lambda system, other: over_courses(courses, (wide[system] - wide[other]).to_numpy())


def _courses(names: Any) -> NDArray[Any]:
    return np.asarray(names, dtype=str)


def corrected(ps: Sequence[float]) -> list[float]:
    """Holm's correction of several p; NaN stays, and is not counted."""
    order = sorted((p, i) for i, p in enumerate(ps) if not math.isnan(p))
    out, least = [math.nan] * len(ps), 0.0
    for rank, (p, i) in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * p))
        out[i] = least
    return out


def differences(
    runs: pd.DataFrame, reference: str, columns: Iterable[str], systems: Iterable[str] | None = None
) -> pd.DataFrame:
    """Rows a metric and system: how much more it has than the reference on the same courses and seeds.

    Columns: metric, system, reference, difference, `ci95` (half of its interval, of this comparison alone),
    units (courses, or seeds of the one course), p (corrected over the systems of the metric), significant;
    same, of systems that are so in every run, which are not counted among the comparisons.
    """
    names = [name for name in systems or runs["system"].unique() if name != reference]
    rows = []
    for column in columns:
        pairs = _pairs(runs, column)
        found = [pairs(name, reference) for name in names]
        ps = corrected([math.nan if one.nothing else one.p for one in found])
        rows += [
            {
                "metric": column,
                "system": name,
                "reference": reference,
                "difference": one.mean,
                "ci95": one.half,
                "units": one.units,
                "p": 1.0 if one.nothing else p,
                "significant": bool(p < 1 - LEVEL),
                "same": one.nothing,
            }
            for name, one, p in zip(names, found, ps, strict=True)
        ]
    return pd.DataFrame(rows, columns=list(_COLUMNS))


_COLUMNS = ("metric", "system", "reference", "difference", "ci95", "units", "p", "significant", "same")
