"""The pelvis: on its way over the ground, swayed to the foot that carries, as high as the legs let it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .. import quat
from . import figure, gait, turns
from .curves import dot, ease, smooth
from .feet import Foot
from .path import GRAVITY, Path
from .rhythm import LEG, Rhythm
from .style import Style

Array = NDArray[np.float64]

TWIST, DROP = np.radians(6.5), np.radians(4.6)  # by the legs' swing; towards the side that swings
KNEE, RUNNING_KNEE = np.radians(10), np.radians(16)  # flexion that a leg keeps at its longest
SURGE = 0.13  # share of the speed by which a walk is faster and slower within a step
SINK = 0.2  # metres of a crouch


def carry(path: Path, left: Foot, right: Foot, rhythm: Rhythm, style: Style) -> tuple[Array, Array]:
    """Position [T, 3] (metres) and rotation [T, 4] of the pelvis in the world."""
    flat = _ground(path, left, right, rhythm, style)
    rotation = _turned(path, left, right, rhythm, style)
    height = _height(path, left, right, flat, rotation, rhythm, style)
    return np.stack([flat[:, 0], height, flat[:, 1]], axis=-1), rotation


def drop(path: Path, rhythm: Rhythm) -> Array:
    """How far the pelvis's left side is up [T], radians: the side of the leg that swings drops."""
    balance = 2 * smooth(rhythm.weight - 0.5, 0.085 * path.fps)
    return DROP * balance * (1 + 0.7 * rhythm.run) * (1 - 0.3 * rhythm.stand)


def nodding(left: Foot, right: Foot, path: Path, rhythm: Rhythm) -> Array:
    """A wave [T] of a period a step: 1 where the body is lowest, -1 where it is highest."""
    low = np.where(left.on & right.on, 1.0, np.where(left.on | right.on, -1.0, 0.0))
    low = np.where(path.running > 0.5, np.where(left.on | right.on, 1.0, -1.0), low)
    return smooth(low, 0.06 * path.fps) * (1 - rhythm.stand)


def _turned(path: Path, left: Foot, right: Foot, rhythm: Rhythm, style: Style) -> Array:
    """Rotation [T, 4] in the world; the hip of the leg that is ahead goes ahead."""
    twist = -TWIST * style.twist * rhythm.swing * (1 + 0.5 * rhythm.run)
    tilt = np.radians(2.0 + 5.0 * rhythm.run + 16.0 * rhythm.crouch) + 0.35 * rhythm.lean_ahead
    tilt = tilt + np.radians(2.6 + 1.4 * rhythm.run) * nodding(left, right, path, rhythm)
    yaw = path.heading + twist + 0.012 * rhythm.idle[:, 3] * rhythm.stand
    roll = turns.z(drop(path, rhythm) - 0.4 * rhythm.lean_left)
    return quat.mul(turns.y(yaw), quat.mul(roll, turns.x(tilt + 0.006 * rhythm.idle[:, 2])))


def _ground(path: Path, left: Foot, right: Foot, rhythm: Rhythm, style: Style) -> Array:
    """Where the pelvis is over the ground [T, 2]."""
    fps, stand = path.fps, rhythm.stand
    on_left = smooth(rhythm.weight, 0.09 * fps)[:, None]
    support = on_left * left.ankle[:, [0, 2]] + (1 - on_left) * right.ankle[:, [0, 2]] - path.position
    across, along = dot(support, rhythm.side), dot(support, rhythm.forward)
    aside = np.clip(np.abs(path.left) / np.maximum(path.speed, 0.3), 0, 1)
    amplitude = 0.6 * gait.lateral_excursion(path.speed) * style.sway
    amplitude = amplitude * (1 - 0.4 * rhythm.run) * (1 - 0.7 * aside) * (1 - stand)
    lateral = smooth(amplitude * (2 * rhythm.weight - 1), 0.085 * fps) + smooth(
        0.8 * stand * across, 0.12 * fps
    )
    ahead = smooth(stand * (along + 0.04), 0.15 * fps) + _surge(path, left, right, rhythm)
    flat = path.position + lateral[:, None] * rhythm.side + ahead[:, None] * rhythm.forward
    return flat + 0.004 * rhythm.idle[:, 0:2] * (0.4 + 0.6 * stand)[:, None]


def _surge(path: Path, left: Foot, right: Foot, rhythm: Rhythm) -> Array:
    """How far the body is ahead of an even walk [T], metres: it is faster in double support."""
    rate = SURGE * path.ahead * (1 - 0.8 * rhythm.run) * nodding(left, right, path, rhythm)
    way = np.cumsum(rate) / path.fps
    return way - smooth(way, 0.35 * path.fps)


def _height(
    path: Path, left: Foot, right: Foot, flat: Array, rotation: Array, rhythm: Rhythm, style: Style
) -> Array:
    """Height [T]: as high as the legs let it, lowest in double support, a bounce in the run."""
    fps, run = path.fps, rhythm.run
    most = np.minimum(
        *(_reach(foot, sign, flat, rotation, run) for foot, sign in ((left, 1.0), (right, -1.0)))
    )
    base = smooth(ndimage.minimum_filter1d(most, round(0.62 * fps), mode="nearest"), 0.13 * fps)
    rise = 0.85 * gait.vertical_excursion(path.speed) * style.bounce * (1 - run) * (1 - rhythm.stand)
    single = smooth(np.where(left.on & right.on, 0.0, 1.0), 0.09 * fps)
    level = base - SINK * rhythm.crouch + rise * single * (1 - 0.5 * rhythm.crouch)
    level = level + 1.15 * run * style.bounce * _bounce(left, right, fps)
    return level - _cover(level - most, 0.04 * fps)


def _reach(foot: Foot, sign: float, flat: Array, rotation: Array, run: Array) -> Array:
    """Height [T] at which a leg is as long as it gets; a leg in mid-swing hardly binds."""
    hip = quat.rotate(rotation, np.broadcast_to(figure.HIP * [sign, 1, 1], (len(flat), 3)))
    gap = foot.ankle[:, [0, 2]] - flat - hip[:, [0, 2]]
    knee = KNEE + (RUNNING_KNEE - KNEE) * run * foot.on
    longest = LEG**2 - 2 * figure.THIGH * figure.SHANK * (1 - np.cos(knee))
    high = foot.ankle[:, 1] - hip[:, 1] + np.sqrt(np.maximum(longest - dot(gap, gap), 0.01))
    loose = ease(np.minimum((foot.swing - 0.05) / 0.15, (0.9 - foot.swing) / 0.25))
    return high + 0.1 * np.where(foot.on, 0.0, loose)


def _cover(values: Array, frames: float) -> Array:
    """A smooth curve that is nowhere below values, nor below 0: the mean of what is greatest around."""
    width = 2 * round(3 * frames) + 1  # as wide as the Gaussian that follows reaches
    return smooth(ndimage.maximum_filter1d(np.maximum(values, 0), width, mode="nearest"), frames)


def _bounce(left: Foot, right: Foot, fps: float) -> Array:
    """Height [T] in a run against that at touch-down: a spring in stance, a throw in flight.

    A flight of f seconds rises by g f^2 / 8 and leaves with g f / 2, which a stance of c seconds turns round
    in a half sine of depth g f c / (2 pi).
    """
    out = np.zeros(len(left.since))
    air = ~(left.on | right.on)
    bounds = [0, *(np.flatnonzero(np.diff(air.astype(np.int8))) + 1).tolist(), len(air)]
    flight = 0.0
    for start, stop in pairwise(bounds):
        seconds = (stop - start) / fps
        x = (np.arange(start, stop) - start + 0.5) / (stop - start)
        if air[start]:
            flight = min(seconds, 0.2)
            out[start:stop] = GRAVITY * flight**2 / 2 * x * (1 - x)
        elif seconds < 0.5:
            depth = min(GRAVITY * max(flight, 0.06) * seconds / (2 * np.pi), 0.08)
            out[start:stop] = -depth * np.sin(np.pi * x)
    return smooth(out, 0.018 * fps)
