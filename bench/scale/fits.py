"""How something grows with the data: a power of its length, fitted on logarithms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from bench.intervals import LEVEL


@dataclass(frozen=True)
class Fit:
    """y = at_one x^exponent by least squares of the logarithms.

    Attributes
    ----------
    exponent : 0 does not grow, 1 grows as the data does. error : its standard error, half : half the width of
    its 95 % interval, by Student's t of N - 2 degrees of freedom; NaN of two points.
    at_one : y at x = 1. points : how many were fitted; with less than two there is no fit: NaN.
    """

    exponent: float
    error: float
    half: float
    at_one: float
    points: int

    def at(self, x: ArrayLike) -> np.ndarray:
        """What it says of x."""
        return self.at_one * np.asarray(x, np.float64) ** self.exponent


def power(x: ArrayLike, y: ArrayLike) -> Fit:
    """The power that fits positive numbers x [N] and y [N] best; those that are not above 0 are left out.

    The standard error is that of a slope: sqrt(sum of squared rests / (N - 2) / sum of (log x - mean)^2).
    """
    given = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    known = np.logical_and.reduce([np.isfinite(values) & (values > 0) for values in given])
    along, rise = (np.log(values[known]) for values in given)
    count = len(along)
    if len(np.unique(along)) < 2:
        return Fit(np.nan, np.nan, np.nan, np.nan, count)
    across = along - along.mean()
    slope = float((across * rise).sum() / (across**2).sum())
    rest = rise - rise.mean() - slope * across
    at_one = float(np.exp(rise.mean() - slope * along.mean()))
    if count < 3:
        return Fit(slope, np.nan, np.nan, at_one, count)
    error = float(np.sqrt((rest**2).sum() / (count - 2) / (across**2).sum()))
    return Fit(slope, error, error * float(stdtrit(count - 2, (1 + LEVEL) / 2)), at_one, count)
