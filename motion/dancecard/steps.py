"""Footsteps: which foot stands where, and when, so that the body can go its way.

A foot comes down where the body will be in the middle of its stance, moved against the acceleration as an
inverted pendulum needs it: the centre of pressure lies h a / g behind a body of height h that accelerates by
a. So runners lean into curves and walkers lean back to stop without further rules. Someone who stands steps
only when the way leads off, or when a foot is out of place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from . import gait
from .path import GRAVITY, Path
from .style import Style

Array = NDArray[np.float64]

LEFT, RIGHT = 0, 1
SIDE = (1.0, -1.0)
PENDULUM = 0.9 / GRAVITY  # s^2, height of the body's middle over g
BEHIND = -0.03  # metres that ankles stand behind the hips
MIDDLE = 0.45, 0.37  # share of a stance at which the body is above the foot, in a walk and in a run
AHEAD, TRAILING = 0.46, 0.56  # metres from under the body at which a foot can come down, and must leave
PLACE, YAW = 0.09, math.radians(18)  # how far out of place a foot may stand
LEAVES, TURNS = 0.045, math.radians(10)  # what a standing body does before the first foot leaves the ground
ROLL = 0.065  # share of a stride between the ball's first motion and the last touch of the toes


@dataclass
class Stances:
    """The stances of one foot in order; the first began and the last ends beyond the clip.

    Attributes (a list each, later arrays [S])
    ----------
    on, off : seconds at which the foot comes down and leaves.
    flat, rise : seconds from and until which the whole sole rests.
    x, z, yaw : where the ankle stands over the ground (metres), and the foot's heading (radians).
    strike, leave : pitch when it comes down and leaves, radians, toes up positive: a positive strike is on
        the heel, a negative one on the ball; a negative leave is off the toes, a positive one off the heel.
    """

    on: list[float] = field(default_factory=list)
    off: list[float] = field(default_factory=list)
    flat: list[float] = field(default_factory=list)
    rise: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    z: list[float] = field(default_factory=list)
    yaw: list[float] = field(default_factory=list)
    strike: list[float] = field(default_factory=list)
    leave: list[float] = field(default_factory=list)

    def array(self, name: str) -> Array:
        """One of the lists as an array."""
        return np.array(getattr(self, name), np.float64)


@dataclass(frozen=True, eq=False)
class Tempo:
    """What the steps at each frame of a path are like: lists [T] of floats, for a loop to look up."""

    period: list[float]
    duty: list[float]
    width: list[float]


def tempo(path: Path, style: Style) -> Tempo:
    """Stride period (s), duty factor and distance of the feet's lines (m) that the path asks for."""
    speed, run, crouch = path.speed, path.running, path.crouching
    aside = np.divide(path.left**2, speed**2, out=np.zeros_like(speed), where=speed > 0.05)
    backward = np.clip(-path.ahead / np.maximum(speed, 0.3), 0, 1)
    walk = gait.walking_frequency(speed) * (1 + 0.25 * backward) * (1 + 0.06 * crouch)
    step = (1 - aside) * walk + aside * gait.sidestep_frequency(speed)
    spins = np.clip(np.abs(path.turning) / 0.5, 0, 1)
    step = np.maximum(step, gait.turning_frequency(path.turning) * np.clip(1.4 - speed, 0, 1) * spins)
    frequency = style.cadence * ((1 - run) * step + run * gait.running_frequency(speed))
    walking = np.maximum(gait.walking_duty(speed) - ROLL, 0.545) + 0.03 * crouch - 0.02 * backward
    duty = (1 - run) * walking + run * gait.running_duty(speed)
    # Feet do not cross in side steps: so they stand apart by half of a stride's way to the side.
    width = style.width * (1 - 0.55 * run * np.clip((speed - 1) / 2, 0, 1)) + 0.05 * crouch + 0.08 * aside
    width = width + (0.5 - 0.42 * run) * np.abs(path.left) / frequency + 0.04 * np.clip(1 - speed / 0.6, 0, 1)
    return Tempo((1 / frequency).tolist(), duty.tolist(), width.tolist())


def walk(path: Path, style: Style, rng: np.random.Generator) -> tuple[Stances, Stances]:
    """The stances of the left and the right foot along a path."""
    return _Walker(path, style, rng).walk()


class _Walker:
    def __init__(self, path: Path, style: Style, rng: np.random.Generator) -> None:
        self.path, self.style, self.rng = path, style, rng
        self.tempo = tempo(path, style)
        self.last = len(path.time) - 1
        self.feet = (Stances(), Stances())
        lean = 0.8 - 0.25 * path.running
        aim = path.position - lean[:, None] * PENDULUM * _limited(path.acceleration, 3.5)
        self.aim, self.way = aim.tolist(), path.position.tolist()
        self.heading = path.heading.tolist()
        self.ahead, self.left = path.ahead.tolist(), path.left.tolist()
        self.running, self.crouching = path.running.tolist(), path.crouching.tolist()
        self.turning = path.turning.tolist()

    def frame(self, time: float) -> int:
        return min(max(int(time * self.path.fps + 0.5), 0), self.last)

    def walk(self) -> tuple[Stances, Stances]:
        """Steps from one strike to the next until the path ends."""
        end = self.path.time[-1] + 1.0
        for foot in (LEFT, RIGHT):
            self.strike(foot, -1.0)
        foot, now = RIGHT, 0.0
        while now < end:
            after = self.next_step(foot, now, first=now == 0.0)
            if after is None:
                break
            foot, now = after
        for stances in self.feet:
            stances.off.append(end + 10)
            stances.rise.append(end + 9)
            stances.leave.append(-0.5)
        return self.feet

    def next_step(self, foot: int, now: float, *, first: bool) -> tuple[int, float] | None:
        """After a foot has come down, let the next one go and come down; None when there is no more to do."""
        swinging, begin, standing = 1 - foot, now, first
        if not self.moves(now, now + 0.5 * self.tempo.period[self.frame(now + 0.2)]):
            standing = True
            wrong = self.misplaced(now + 0.6)
            if wrong is not None and self.feet[wrong].on[-1] < now - 0.05:
                swinging, begin = wrong, now + 0.15
            else:
                departure = self.departure(now)
                if departure is None:
                    return None
                swinging, begin = self.leading(swinging, departure), departure
        f = self.frame(begin + 0.25)
        period, duty = self.tempo.period[f], self.tempo.duty[f]
        swing = (1 - duty) * period
        if standing:
            on = begin + swing
        else:
            on = begin + 0.5 * period * (1 + 0.015 * self.rng.standard_normal())
        off = max(self.in_reach(swinging, on - swing), self.feet[swinging].on[-1] + 0.12)
        self.leave(swinging, off, standing)
        self.strike(swinging, on)
        return swinging, on

    def moves(self, start: float, stop: float) -> bool:
        """Whether the path asks for steps between two times."""
        for time in (start, (start + stop) / 2, stop):
            f = self.frame(time)
            if np.hypot(self.ahead[f], self.left[f]) > 0.12 or abs(self.turning[f]) > 0.35:
                return True
        return False

    def misplaced(self, time: float) -> int | None:
        """The foot that stands most out of place, if one does."""
        f = self.frame(time)
        worst, found = 1.0, None
        for foot in (LEFT, RIGHT):
            x, z, yaw = self.place(foot, f, quiet=True)
            stance = self.feet[foot]
            far = np.hypot(x - stance.x[-1], z - stance.z[-1]) / PLACE
            far = max(far, abs(yaw - stance.yaw[-1]) / YAW)
            if far > worst:
                worst, found = far, foot
        return found

    def departure(self, now: float) -> float | None:
        """When a standing body has left so far that a foot must go; None if it never does."""
        first = self.frame(now)
        away = self.path.position[first:] - self.path.position[first]
        turned = np.abs(self.path.heading[first:] - self.heading[first])
        gone = (np.hypot(away[:, 0], away[:, 1]) > LEAVES) | (turned > TURNS)
        at = int(gone.argmax())
        return self.path.time[first + at] if gone[at] else None

    def leading(self, usual: int, time: float) -> int:
        """The foot to begin with: that of the side to which the body goes or turns."""
        f = self.frame(time + 0.4)
        aside = self.left[f] + 0.25 * self.turning[f]
        if abs(aside) > 0.15 and abs(aside) > 0.5 * abs(self.ahead[f]):
            return LEFT if aside > 0 else RIGHT
        return usual if self.rng.random() < 0.7 else 1 - usual

    def place(self, foot: int, f: int, quiet: bool = False) -> tuple[float, float, float]:
        """Where a foot belongs whose stance has its middle at a frame: x, z, yaw."""
        noise = np.zeros(3) if quiet else self.rng.standard_normal(3)
        heading = self.heading[f]
        out = SIDE[foot] * (0.5 * self.tempo.width[f] + 0.006 * noise[0])
        along = BEHIND + 0.01 * noise[1]
        x, z = self.aim[f]
        s, c = np.sin(heading), np.cos(heading)
        toe_out = math.radians(self.style.toe_out) * (1 - 0.5 * self.running[f])
        yaw = heading + SIDE[foot] * toe_out + 0.03 * noise[2]
        return x + out * c + along * s, z - out * s + along * c, yaw

    def strike(self, foot: int, on: float) -> None:
        """Let a foot come down."""
        f = self.frame(on)
        stance = self.tempo.duty[f] * self.tempo.period[f]
        forward = min(max(self.ahead[f], -1.0), 1.0)
        middle = 0.5 + forward * (MIDDLE[0] + self.running[f] * (MIDDLE[1] - MIDDLE[0]) - 0.5)
        x, z, yaw = self.place(foot, self.frame(on + middle * stance))
        x, z = self.within(x, z, f, AHEAD)
        feet = self.feet[foot]
        pitch = _strike_pitch(self.ahead[f], self.left[f], self.running[f], self.crouching[f])
        feet.on.append(on)
        feet.x.append(x)
        feet.z.append(z)
        feet.yaw.append(yaw)
        feet.strike.append(pitch)
        feet.flat.append(on + min((0.14 if pitch >= 0 else 0.3) * stance, 0.12))

    def within(self, x: float, z: float, f: int, most: float) -> tuple[float, float]:
        """A place brought within reach of where the body is at a frame."""
        bx, bz = self.way[f]
        far = float(np.hypot(x - bx, z - bz))
        share = min(1.0, most / max(far, 1e-6))
        return bx + share * (x - bx), bz + share * (z - bz)

    def in_reach(self, foot: int, off: float) -> float:
        """The time to leave, earlier where the body would go out of reach of the foot."""
        feet = self.feet[foot]
        x, z, f = feet.x[-1], feet.z[-1], self.frame(off)
        first = self.frame(feet.on[-1] + 0.12)
        while f > first and np.hypot(self.way[f][0] - x, self.way[f][1] - z) > TRAILING:
            f -= 1
            off -= 1 / self.path.fps
        return off

    def leave(self, foot: int, off: float, standing: bool) -> None:
        """Let a foot go, slowly at first when it has been standing."""
        feet = self.feet[foot]
        f = self.frame(off)
        pitch = _leave_pitch(self.ahead[f], self.left[f], self.running[f], self.crouching[f])
        begin = max(feet.flat[-1] + 0.01, off - (0.5 if standing else 1.0))
        share = 0.45 if standing else 0.85 if pitch > 0 else 0.58 - 0.1 * self.running[f]
        feet.off.append(off)
        feet.leave.append(pitch)
        feet.rise.append(begin + share * (off - begin))


def _strike_pitch(ahead: float, left: float, running: float, crouching: float) -> float:
    """Pitch at contact, radians: heel first (20 degrees at 1.4 m/s, Winter 1991), backward toes first."""
    if ahead < 0:
        return math.radians(-6 + 9 * max(ahead, -1.5))
    walk = min(4 + 12 * ahead, 23) - 14 * min(abs(left), 1) + 3
    degrees = (1 - running) * walk * (1 - 0.4 * crouching) + running * (10 - 1.5 * ahead)
    return math.radians(max(degrees, -8.0))


def _leave_pitch(ahead: float, left: float, running: float, crouching: float) -> float:
    """Pitch when a foot leaves, radians: 60 degrees at 1.4 m/s (Winter 1991), little in side steps.

    Backward the heel leaves last.
    """
    if ahead < -0.25:
        return math.radians(8 - 4 * max(ahead, -1.5))
    walk = -min(17 + 23 * max(ahead, 0.0), 50) + 8 * min(abs(left), 1)
    degrees = (1 - running) * walk * (1 - 0.4 * crouching) + running * (-44 - 2.0 * ahead)
    return math.radians(min(degrees, -12.0))


def _limited(vectors: Array, most: float) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors * np.minimum(1.0, most / np.maximum(length, 1e-9))
