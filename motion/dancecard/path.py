"""The way of the body: from a list of moves to where it is, faces and how it goes, at every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .curves import dot, ease, smooth

Array = NDArray[np.float64]

GRAVITY = 9.81


@dataclass(frozen=True)
class Move:
    """What the dancer does for a while.

    Attributes
    ----------
    seconds : how long, the change from the move before included.
    ahead, left : velocity along and across the facing, m/s.
    turn : degrees turned altogether, to the left, spread over the move (in `change` seconds with a pivot).
    gait : "walk", "run" or "crouch".
    change : seconds that the change of velocity takes.
    pivot : whether the turn is done within the change.
    swerve : whether the body goes on as it went while it turns, and is brought round by and by: its velocity
        changes in the world and not against the facing.
    """

    seconds: float
    ahead: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    gait: str = "walk"
    change: float = 1.0
    pivot: bool = False
    swerve: bool = False


@dataclass(frozen=True, eq=False)
class Path:
    """The way at T frames.

    Attributes
    ----------
    fps : frames a second.
    time : [T] seconds.
    position : [T, 2] x and z of the body over the ground, metres.
    velocity, acceleration : [T, 2] of it, m/s and m/s^2.
    heading, turning : [T] facing (radians, 0 is +Z, left positive) and its rate (rad/s).
    ahead, left : [T] velocity along and across the facing, m/s.
    running, crouching : [T] share of the gait, 0 to 1.
    """

    fps: float
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    heading: Array
    turning: Array
    ahead: Array
    left: Array
    running: Array
    crouching: Array

    @property
    def speed(self) -> Array:
        """[T] m/s."""
        return np.hypot(self.ahead, self.left)


def length(moves: Sequence[Move], fps: float) -> int:
    """Frames that moves take."""
    return max(2, round(sum(move.seconds for move in moves) * fps))


def plan(moves: Sequence[Move], fps: float) -> Path:
    """The way that follows moves one after the other, beginning at the origin, standing, facing +Z."""
    time = np.arange(length(moves, fps)) / fps
    begins = np.cumsum([0.0, *(move.seconds for move in moves)])[:-1]
    heading = _headings(moves, begins, time)
    ahead, left, running, crouching = (np.zeros_like(time) for _ in range(4))
    before = Move(0.0)
    for begin, move in zip(begins, moves, strict=True):
        first = max(0, int((begin - 0.01) * fps))
        share = ease((time[first:] - begin) / move.change)
        ahead[first:] += (move.ahead - before.ahead) * share
        left[first:] += (move.left - before.left) * share
        if move.swerve:
            end = min(len(time), first + int(move.change * fps) + 1)
            turned = _swerve(before, move, share[: end - first], heading[first:end])
            ahead[first:end] += turned[0]
            left[first:end] += turned[1]
        for channel, gait in ((running, "run"), (crouching, "crouch")):
            step = float(move.gait == gait) - float(before.gait == gait)
            if step:
                channel[first:] += step * ease((time[first:] - begin) / max(move.change, 0.8))
        before = move
    forward = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    side = np.stack([np.cos(heading), -np.sin(heading)], axis=-1)
    velocity = smooth(ahead[:, None] * forward + left[:, None] * side, 0.05 * fps)
    return Path(
        fps,
        time,
        np.stack([_integral(v, fps) for v in velocity.T], axis=-1),
        velocity,
        np.gradient(velocity, 1 / fps, axis=0),
        heading,
        np.gradient(heading, 1 / fps),
        dot(velocity, forward),
        dot(velocity, side),
        np.clip(running, 0, 1),
        np.clip(crouching, 0, 1),
    )


def _headings(moves: Sequence[Move], begins: Array, time: Array) -> Array:
    """Facing [T] of moves that begin at times, radians."""
    heading, rate = np.zeros_like(time), np.zeros_like(time)
    rate_before = 0.0
    for begin, move in zip(begins, moves, strict=True):
        rate_now = 0.0
        if move.pivot:
            heading += np.radians(move.turn) * ease((time - begin) / move.change)
        elif move.turn:
            rate_now = np.radians(move.turn) / max(move.seconds - 0.2, 0.3)
        if rate_now != rate_before:
            rate += (rate_now - rate_before) * ease((time - begin) / min(0.7, move.seconds / 2))
        rate_before = rate_now
    return heading + _integral(rate, 1 / (time[1] - time[0]))


def _swerve(before: Move, move: Move, share: Array, heading: Array) -> tuple[Array, Array]:
    """What a velocity that changes in the world has, ahead and left, beyond one that does so in the body."""
    old = complex(before.ahead, before.left) * np.exp(1j * (heading[0] - heading))
    new = complex(move.ahead, move.left) * np.exp(1j * (heading[-1] - heading))
    inside = (1 - share) * complex(before.ahead, before.left) + share * complex(move.ahead, move.left)
    extra = (1 - share) * old + share * new - inside
    return extra.real, extra.imag


def _integral(rate: Array, fps: float) -> Array:
    """Trapezoidal integral over time from the first frame."""
    return np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1]) / (2 * fps)])
