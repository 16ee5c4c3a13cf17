"""The phase of a gait on two feet: where between two footfalls a body is.

The right foot comes down at 0, the left one at pi, the right one again at 2 pi (REFERENCE 4.2). Who stands
still goes on slowly. Between all these the phase follows a monotone cubic curve, so that its rate is always
positive and changes without jumps (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEFT, RIGHT = 0, 1
TURN = 2 * np.pi
AT = (np.pi, 0.0)  # phase at which each foot comes down
# A tenth of the cadence of a walk (a stride a second), as the published runtime slows down a standing body.
STANDING_RATE = 0.1 * TURN
# Stands that are too short for whole turns still go on, this share of that fast.
SHORT_STAND = 0.2
# The weight shifts this long before the first foot leaves the ground (gait initiation: about half a second).
LEAD = 0.5
SHORTEST_STEP = 0.2  # seconds: the fastest sprinters take 5 steps a second
# What it costs to leave a footfall out, to have missed one, and that a step is shorter, for each share of it.
LEFT_OUT, MISSED, HURRIED = 1.0, 0.6, 4.0
MOST_LEFT_OUT = 4
STANCE = 0.2  # seconds: a shorter one is that much cheaper to leave out
STEP = 0.5  # seconds of a step where none is known: a walk
INSTANT = 1e-3  # seconds: what is shorter is no stretch of time


@dataclass(frozen=True)
class Footfall:
    """A foot comes down at a time (seconds): which (LEFT or RIGHT), and how long it stands then."""

    time: float
    foot: int
    seconds: float


def phase(time: Array, left: Array, right: Array) -> Array:
    """Phase [T] in 0 to 2 pi at times [T], seconds, ascending.

    left, right [S, 2] are the stances of each foot in order: seconds at which it comes down and leaves, also
    beyond the last time where they are known. One that began by the first time tells of no footfall. A
    ValueError where no foot comes down, unless both stand all the time.
    """
    first, last = float(time[0]), float(time[-1])
    falls = footfalls(time, left, right)
    if not falls:
        if _stands_until(first, left, right) < last:
            raise ValueError("no foot comes down, and they do not both stand either")
        return np.mod(STANDING_RATE * (time - first), TURN)
    knots, values = [falls[0].time], [AT[falls[0].foot]]
    for before, fall in itertools.pairwise(falls):
        way = np.pi if fall.foot != before.foot else TURN
        start = min(_stands_until(before.time, left, right) - LEAD, fall.time - STEP / 2)
        stood = start - before.time
        if stood > INSTANT:
            turns = round(STANDING_RATE * stood / TURN)
            slow = TURN * turns or SHORT_STAND * STANDING_RATE * stood
            way += TURN * turns - slow
            knots.append(start)
            values.append(values[-1] + slow)
        knots.append(fall.time)
        values.append(values[-1] + way)
    _begin(knots, values, first, _stands_until(first, left, right) - LEAD)
    _end(knots, values, last, _stands_until(falls[-1].time, left, right))
    turned = np.mod(monotone(np.array(knots), np.array(values), time), TURN)
    return np.where(turned < TURN, turned, 0.0)  # a hair below 0 is rounded to a whole turn


def footfalls(time: Array, left: Array, right: Array) -> list[Footfall]:
    """When feet come down after the first of times [T], in order: those of them that make the best gait.

    Feet alternate, and not faster than sprinters' do; what disagrees with that least is kept, since contacts
    that were missed or seen where there is none disagree with it (the cheapest way through all of them).
    """
    found = [
        Footfall(float(on), foot, float(off - on))
        for foot, stances in ((LEFT, left), (RIGHT, right))
        for on, off in stances
        if on > time[0]
    ]
    found.sort(key=lambda fall: fall.time)
    gone = [0.0, *np.cumsum([LEFT_OUT * min(1.0, max(0.3, f.seconds / STANCE)) for f in found]).tolist()]
    costs: list[float] = []
    origins: list[int] = []
    for j, fall in enumerate(found):
        best, origin = gone[j], -1
        for i in range(max(0, j - 1 - MOST_LEFT_OUT), j):
            cost = costs[i] + gone[j] - gone[i + 1] + _disagreement(found[i], fall)
            if cost < best:
                best, origin = cost, i
        costs.append(best)
        origins.append(origin)
    ends = [cost + gone[-1] - gone[i + 1] for i, cost in enumerate(costs)]
    kept, at = [], int(np.argmin(ends)) if ends else -1
    while at >= 0:
        kept.append(found[at])
        at = origins[at]
    return kept[::-1]


def _disagreement(before: Footfall, fall: Footfall) -> float:
    """What it costs that one footfall is the next after another one."""
    steps = 1 if fall.foot != before.foot else 2
    hurry = steps * SHORTEST_STEP / max(fall.time - before.time, 1e-6)
    return (MISSED if steps == 2 else 0.0) + max(hurry - 1, 0.0) * HURRIED


def _stands_until(time: float, left: Array, right: Array) -> float:
    """When the first of both feet leaves that stand at a time; the time itself where they do not."""
    leaves = [off for s in (left, right) for on, off in s[(s[:, 0] <= time) & (s[:, 1] > time)]]
    return float(min(leaves)) if len(leaves) == 2 else time


def _begin(knots: list[float], values: list[float], first: float, start: float) -> None:
    """Go back from the first footfall to the first instant: the step, which begins at start, and a stand."""
    start = min(max(first, start), knots[0] - STEP / 2)
    pace = np.pi / (knots[0] - start) if start > first else _pace(knots[:3], values[:3])
    for instant, rate in ((start, pace), (first, STANDING_RATE)):
        if knots[0] - instant > INSTANT:
            values.insert(0, values[0] - rate * (knots[0] - instant))
            knots.insert(0, instant)


def _end(knots: list[float], values: list[float], last: float, leave: float) -> None:
    """Go on from the last footfall to the last instant: a stand, until a foot leaves, and the step after."""
    pace = _pace(knots[-3:], values[-3:])
    cut = last - knots[-1] < LEAD  # too soon to tell that it is a stand
    stop = knots[-1] if cut else max(knots[-1], min(leave - LEAD, last))
    for instant, rate in ((stop, STANDING_RATE), (last, pace)):
        if instant - knots[-1] > INSTANT:
            values.append(values[-1] + rate * (instant - knots[-1]))
            knots.append(instant)


def _pace(knots: Sequence[float], values: Sequence[float]) -> float:
    """Rate of the steps among a few stretches: of those that go at least half as fast as the fastest."""
    if len(knots) < 2:
        return np.pi / STEP
    spans, ways = np.diff(knots), np.diff(values)
    steps = ways / spans >= 0.5 * np.max(ways / spans)
    return float(ways[steps].sum() / spans[steps].sum())


def monotone(knots: Array, values: Array, at: Array) -> Array:
    """The monotone cubic curve through knots [K] ascending, values [K] ascending, at instants [T].

    Straight on beyond the ends. The rate at a knot is the weighted harmonic mean of those beside it.
    """
    if len(knots) == 1:
        return values[0] + np.pi / STEP * (at - knots[0])
    span = np.diff(knots)
    slope = np.diff(values) / span
    rates = np.concatenate([slope[:1], slope[-1:]]) if len(knots) == 2 else np.empty(len(knots))
    if len(knots) > 2:
        a, b = 2 * span[1:] + span[:-1], span[1:] + 2 * span[:-1]
        rates[1:-1] = (a + b) / (a / slope[:-1] + b / slope[1:])
        rates[0], rates[-1] = slope[0], slope[-1]
    i = np.clip(np.searchsorted(knots, at, "right") - 1, 0, len(span) - 1)
    x = (at - knots[i]) / span[i]
    inside = np.clip(x, 0.0, 1.0)
    beyond = (x - inside) * span[i] * np.where(x < 0, rates[0], rates[-1])
    x = inside
    return (
        values[i]
        + (values[i + 1] - values[i]) * x * x * (3 - 2 * x)
        + span[i] * x * (1 - x) * (rates[i] * (1 - x) - rates[i + 1] * x)
        + beyond
    )
