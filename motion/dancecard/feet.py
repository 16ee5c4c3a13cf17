"""The feet between and during their stances: where ankle and toes are at every frame.

A foot turns about a pin: the heel's edge after the heel strikes, the ball (toe joint) until the toes leave.
Both rest while the sole is flat, so the pin may pass from one to the other without moving the foot. In a
swing the pin travels from the old place to the new one, at rest at both ends, so that feet never slide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import figure
from .curves import dot, ease, hermite, travel
from .steps import Stances

Array = NDArray[np.float64]

_SOLE_TO_ANKLE = np.array([0.0, figure.ANKLE, 0.0])
TO_ANKLE = (_SOLE_TO_ANKLE - figure.BALL, _SOLE_TO_ANKLE - figure.HEEL)  # from the ball; from the heel
# Relative speed of a swing: the foot comes down still following the body, or the leg would have to reach.
WALKED = ((0.0, 0.0), (0.34, 1.0), (0.6, 1.0), (0.92, 0.55), (1.0, 0.0))
PUT = ((0.0, 0.0), (0.2, 1.0), (0.5, 1.0), (0.88, 0.2), (1.0, 0.0))
RUN = ((0.0, 0.0), (0.2, 0.9), (0.55, 1.0), (0.92, 0.5), (1.0, 0.0))
CLEARANCE = 0.13  # metres between the ankles when one foot passes the other


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot over time.

    Attributes
    ----------
    ankle : [T, 3] world position, metres.
    yaw, pitch : [T] heading of the foot, and its pitch (toes up positive), radians.
    bend : [T] extension of the toes against the foot, radians.
    on, swing : [T] whether the foot has contact (bool), and share of the swing gone, 0 in a stance.
    heel, toe : [T] bool, whether the heel and the ball rest on the ground.
    since, left : [T] seconds since the last strike, and until the next leave (negative in a swing).
    """

    ankle: Array
    yaw: Array
    pitch: Array
    bend: Array
    on: NDArray[np.bool_]
    swing: Array
    heel: NDArray[np.bool_]
    toe: NDArray[np.bool_]
    since: Array
    left: Array


@dataclass(frozen=True, eq=False)
class _Rolls:
    """The events of each stance as arrays [S] (see `steps.Stances`), and the share of running at its end."""

    on: Array
    flat: Array
    rise: Array
    off: Array
    strike: Array
    leave: Array
    run: Array

    @property
    def swing(self) -> Array:
        """Seconds of the swing after each stance."""
        return np.concatenate([self.on[1:] - self.off[:-1], [1.0]])

    @property
    def next_strike(self) -> Array:
        """Pitch at the strike after each stance."""
        return np.concatenate([self.strike[1:], [0.0]])

    @property
    def leave_rate(self) -> Array:
        """Rate of the pitch when the foot leaves, rad/s: it has been growing since the sole began to rise."""
        return 1.9 * self.leave / np.maximum(self.off - self.rise, 0.05)

    @property
    def down_rate(self) -> Array:
        """Rate of the pitch at the strike, rad/s, which is to be gone when the sole is flat."""
        return -self.strike / np.maximum(self.flat - self.on, 0.02)


def track(stances: Stances, other: Stances, time: Array, running: Array, lift: float) -> Foot:
    """A foot at times [T]; other are the other foot's stances, running [T] the share of running."""
    names = ("on", "flat", "rise", "off", "strike", "leave")
    events = {name: stances.array(name) for name in names}
    rolls = _Rolls(**events, run=np.interp(events["off"], time, running))
    on, off, flat, rise, run = rolls.on, rolls.off, rolls.flat, rolls.rise, rolls.run
    yaw = stances.array("yaw")
    place = np.stack([stances.array("x"), np.zeros(len(on)), stances.array("z")], axis=-1)
    last = len(on) - 1
    i = np.clip(np.searchsorted(on, time, "right") - 1, 0, last)
    j = np.minimum(i + 1, last)
    standing = time < off[i]
    span = np.maximum(on[j] - off[i], 1e-3)
    s = np.where(standing, 0.0, (time - off[i]) / span)
    heading = hermite(_woven(on, off), np.repeat(yaw, 2), np.zeros(2 * len(on)), time)
    pitch, bend, pin = _pitch(rolls, time), _bend(rolls, time), _pin(rolls, time)

    # Where the pin lies when the old and the new stance's sole is flat.
    old, new = place[i], place[j]
    vector = TO_ANKLE[0] + pin[:, None] * (TO_ANKLE[1] - TO_ANKLE[0])
    start = old + _SOLE_TO_ANKLE - _turned(vector, yaw[i], 0.0)
    goal = new + _SOLE_TO_ANKLE - _turned(vector, yaw[j], 0.0)
    # A sole that comes down flat is put down from above; a heel may come on.
    level = np.clip(1 - rolls.next_strike / np.radians(12), 0, 1) * (1 - run)
    walked = travel(s, WALKED) * (1 - level[i]) + travel(s, PUT) * level[i]
    share = walked * (1 - run[i]) + travel(s, RUN) * run[i]
    swung = share[:, None] * (goal - start) + _aside(place, other, rolls)[i] * _bell(s)[:, None]
    swung[:, 1] += lift * _height(s, np.hypot(*(new - old)[:, [0, 2]].T), run[i], level[i])
    ankle = start + np.where(standing[:, None], 0.0, swung) + _turned(vector, heading, pitch)
    on_heel, off_heel = rolls.strike[i] >= 0, rolls.leave[i] > 0
    return Foot(
        ankle=ankle,
        yaw=heading,
        pitch=pitch,
        bend=bend,
        on=standing,
        swing=s,
        heel=standing & (on_heel | (time >= flat[i])) & (off_heel | (time <= rise[i])),
        toe=standing & (~on_heel | (time >= flat[i])) & (~off_heel | (time <= rise[i])),
        since=time - on[i],
        left=off[i] - time,
    )


def _pitch(rolls: _Rolls, time: Array) -> Array:
    """Pitch [T]: flat between the rolls over heel and ball, lowest soon after the toes have left."""
    zero = np.zeros_like(rolls.on)
    first = rolls.off + (0.2 + 0.08 * rolls.run) * rolls.swing
    beyond = 0.42 * rolls.leave_rate * (first - rolls.off)
    most = np.radians(20 + 5 * rolls.run)
    low = rolls.leave + np.clip(beyond, -most, most)
    second = rolls.off + 0.85 * rolls.swing
    high = rolls.next_strike + np.where(rolls.next_strike > 0, np.radians(2.0), 0.0)
    return hermite(
        _woven(rolls.on, rolls.flat, rolls.rise, rolls.off, first, second),
        _woven(rolls.strike, zero, zero, rolls.leave, low, high),
        _woven(rolls.down_rate, zero, zero, rolls.leave_rate, zero, zero),
        time,
    )


def _bend(rolls: _Rolls, time: Array) -> Array:
    """Extension of the toes [T]: about flat while the ball is pinned, and straightened in the swing."""
    zero = np.zeros_like(rolls.on)
    rest = np.where(rolls.next_strike > 0, np.radians(8.0), np.maximum(-rolls.next_strike, 0.1))
    held = np.concatenate(
        [[0.0], np.where(rolls.next_strike > 0, rest, np.maximum(-rolls.next_strike, 0))[:-1]]
    )
    down = np.where(rolls.strike > 0, -held / np.maximum(rolls.flat - rolls.on, 0.02), -rolls.down_rate)
    push = np.minimum(rolls.leave, 0)
    return hermite(
        _woven(
            rolls.on, rolls.flat, rolls.rise, rolls.off, rolls.off + (0.55 + 0.2 * rolls.run) * rolls.swing
        ),
        _woven(held, zero, zero, -0.92 * push, rest),
        _woven(down, zero, zero, (0.6 * rolls.run - 0.92) * np.minimum(rolls.leave_rate, 0), zero),
        time,
    )


def _pin(rolls: _Rolls, time: Array) -> Array:
    """What the foot turns about [T]: 0 the ball, 1 the heel; it changes while the foot is flat or up."""
    begin, end = (rolls.strike >= 0).astype(np.float64), (rolls.leave > 0).astype(np.float64)
    times = _woven(rolls.on, rolls.flat, rolls.rise, rolls.off)
    return hermite(times, _woven(begin, begin, end, end), np.zeros_like(times), time)


def _woven(*knots: Array) -> Array:
    """One array [K S] of K arrays [S], stance by stance."""
    return np.stack(knots, axis=-1).ravel()


def _bell(s: Array) -> Array:
    """A bump over the swing: 0 at the ends with speed and acceleration, 1 in the middle."""
    x = np.clip(s, 0, 1)
    return 64 * (x * (1 - x)) ** 3


def _height(s: Array, length: Array, run: Array, level: Array) -> Array:
    """Height of the pin in a swing, metres; length is the step's, level 1 where the sole comes down flat."""
    x = np.clip(s, 0, 1)
    walk = 0.064 + 0.022 * np.clip(length / 1.3, 0, 1)
    sinks = 0.33 + 0.17 * level
    walk = walk * ease(x / 0.3) * (1 - ease((x - sinks) / (1 - sinks)))
    running = 0.11 + 0.13 * np.clip((length - 1.2) / 2.0, 0, 1)
    running = running * ease(x / 0.28) * (1 - ease((x - 0.25) / 0.75))
    return (1 - run) * walk + run * running


def _aside(place: Array, other: Stances, rolls: _Rolls) -> Array:
    """For each stance, the way around the other foot in the swing that follows, a vector [S, 3]."""
    nexts = np.minimum(np.arange(len(place)) + 1, len(place) - 1)
    middle = (rolls.off + rolls.on[nexts]) / 2
    k = np.clip(np.searchsorted(other.array("on"), middle, "right") - 1, 0, len(other.on) - 1)
    foot = np.stack([other.array("x")[k], np.zeros(len(place)), other.array("z")[k]], axis=-1)
    way = place[nexts] - place
    size = dot(way, way)
    along = np.clip(dot(foot - place, way) / np.maximum(size, 1e-9), 0, 1)
    near = place + along[:, None] * way - foot
    distance = np.sqrt(dot(near, near))
    away = near / np.maximum(distance, 1e-6)[:, None]
    between = np.clip(4 * along * (1 - along), 0, 1) * (size > 1e-4)
    return away * (np.maximum(CLEARANCE - distance, 0) * between)[:, None]


def _turned(vector: Array, yaw: Array | float, pitch: Array | float) -> Array:
    """A vector of the foot's frame in the world: pitched with the toes up, then turned to its heading."""
    s, c = np.sin(pitch), np.cos(pitch)
    x, y, z = vector[..., 0], vector[..., 1] * c + vector[..., 2] * s, vector[..., 2] * c - vector[..., 1] * s
    s, c = np.sin(yaw), np.cos(yaw)
    return np.stack([x * c + z * s, y, z * c - x * s], axis=-1)
