"""The frame rate, judged by how long steps take and how fast bodies fall.

Two clocks tick in a moving body. The swinging leg is a pendulum (S. Mochon and T. A. McMahon, Ballistic
walking, 1980): how long a foot takes from behind the other to before it lies within narrow bounds in units of
sqrt(leg / g), whatever the speed. And in flight the body falls with g. A clip whose header states an n times
too low rate has steps n times too slow, and falls with g / n².
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import units
from ..roles import SIDES
from .body import GRAVITY, MASS, Body
from .finding import spans

# Of a step, by the distance of the feet along the body's facing, the middle 80 %: no half step, no waiting.
STEP, MIDDLE = 0.6, 0.1  # legs; share of the step that is left out at either end
FEWEST = 3  # steps
SLOWEST, QUICKEST = 1.95, 0.45  # sqrt(leg / g); of 430 clips of people all lie in 0.50 to 1.77
WALKS, RUNS = 1.2, 0.82  # sqrt(leg / g), what is usual

LEAPS = 0.085  # legs by which all soles leave the ground in runs, but not in walks
CLEAR = 0.05  # legs by which all soles must be above where they are when they stand
SAG = 0.02  # legs by which the body must rise and fall in a flight; below it noise decides
ROUGH = 0.06  # how far a flight may be from a parabola, root mean square over its height
FEWEST_FLIGHTS = 2
SLOW_FALL, FAST_FALL = 4.5, 20.0  # m/s², about half of g and twice g


@dataclass(frozen=True)
class Verdict:
    """A rate that cannot be right: what says so, in a line, and the likely rate."""

    what: str
    likely: float


def judge(body: Body) -> Verdict | None:
    """Whether the clip's rate cannot be right; None if it can, or if nothing in the clip tells."""
    unit = np.sqrt(body.leg / GRAVITY)
    times = step_times(body) / unit
    falls = falls_of_flights(body)
    fall = float(np.median(falls)) if len(falls) >= FEWEST_FLIGHTS else None
    steps = len(times) >= FEWEST
    slow = (steps and np.percentile(times, 25) > SLOWEST) or (fall is not None and fall < SLOW_FALL)
    fast = (steps and np.percentile(times, 75) < QUICKEST) or (fall is not None and fall > FAST_FALL)
    if slow == fast:
        return None
    reasons = []
    if steps:
        reasons.append(f"a step takes {np.median(times) * unit:.2f} s (median of {len(times)})")
    if fall is not None:
        reasons.append(f"the body falls with {fall:.1f} m/s² (median of {len(falls)})")
    usual = RUNS if clearance(body).max(initial=0) > LEAPS * body.leg else WALKS
    factor = np.sqrt(GRAVITY / fall) if fall is not None else float(np.median(times)) / usual
    likely = _likely(body.fps, factor, slow)
    pace = "slower" if slow else "faster"
    what = f"{pace} than bodies move: {', '.join(reasons)}; {likely:.3g} fps rather than {body.fps:.3g}?"
    return Verdict(what, likely)


def _likely(fps: float, factor: float, slow: bool) -> float:
    """The stated rate times or over 2, 4 or 8, as headers go wrong, by how many times too slow all is."""
    power = max(1, round(abs(np.log2(max(factor, 1e-6)))))
    return float(fps * 2.0 ** (power if slow else -power))


def step_times(body: Body) -> NDArray[np.float64]:
    """Seconds [N] that the middle of each step takes: one foot from behind the other to before it."""
    feet = body.joints(f"{side}_foot" for side in SIDES)
    if not feet or body.forward is None:
        return np.zeros(0)
    apart = ((body.world[:, feet[0]] - body.world[:, feet[1]]) * body.forward).sum(axis=-1)
    found = []
    turns = turning_points(apart, STEP * body.leg)
    for (start, before), (stop, after) in itertools.pairwise(turns):
        share = (apart[start : stop + 1] - before) / (after - before)
        found.append(_crossing(share, 1 - MIDDLE) - _crossing(share, MIDDLE))
    return np.array(found) / body.fps


def _crossing(share: NDArray, level: float) -> float:
    """Where share, which goes from 0 to 1, first exceeds level, between frames."""
    after = int(np.argmax(share > level))
    before = share[after - 1]
    return after - 1 + (level - before) / (share[after] - before)


def turning_points(values: NDArray, least: float) -> list[tuple[int, float]]:
    """Frames and values where values [T] turn from rising to falling or back, by least or more.

    The first and the last are not known to be turns (the clip may begin and end anywhere); they are left out.
    """
    found: list[tuple[int, float]] = []
    high = low = (0, float(values[0])) if len(values) else (0, 0.0)
    rising: bool | None = None
    for frame, value in enumerate(values.tolist()):
        if value > high[1]:
            high = (frame, value)
        if value < low[1]:
            low = (frame, value)
        if rising is not False and high[1] - value > least:
            found.append(high)
            rising, low = False, (frame, value)
        elif rising is not True and value - low[1] > least:
            found.append(low)
            rising, high = True, (frame, value)
    return found


def falls_of_flights(body: Body) -> NDArray[np.float64]:
    """Accelerations downwards [N], m/s², of the centre of mass in flights: both feet off the ground.

    For people only: the front legs of animals carry them, too, and their masses are not those of the table.
    """
    if body.on_all_fours or not body.soles.size or not body.joints(MASS):
        return np.zeros(0)
    clear = clearance(body)
    found = []
    for start, stop in spans(clear > CLEAR * body.leg):
        if stop - start < 4 or clear[start:stop].max() > 0.4 * units.LEG * body.scale:
            continue
        times = (np.arange(stop - start) - (stop - start - 1) / 2) / body.fps
        height = body.centre[start:stop, 1]
        curve = np.polyfit(times, height, 2)
        sag = -curve[0] * times[-1] ** 2
        rough = np.std(height - np.polyval(curve, times))
        if sag > SAG * body.leg and rough < ROUGH * sag:
            found.append(-2 * curve[0])
    return np.array(found)


def clearance(body: Body) -> NDArray[np.float64]:
    """How far the soles are above where they are when they stand [T], the lowest of them, metres."""
    soles = body.soles[..., 1]
    if not soles.size:
        return np.zeros(len(body))
    return (soles - np.percentile(soles, 3, axis=0)).min(axis=1)
