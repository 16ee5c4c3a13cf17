"""What moves the whole body: the weight on the feet, the swing of the legs, the lean, and idle wandering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import figure
from .curves import dot, ease, smooth, smoothstep, wander
from .feet import Foot
from .path import GRAVITY, Path
from .style import Style

Array = NDArray[np.float64]

LEG = figure.THIGH + figure.SHANK
MOST_LEAN = 0.3  # radians


@dataclass(frozen=True, eq=False)
class Rhythm:
    """Curves [T] that pelvis, trunk and arms share.

    Attributes
    ----------
    run, crouch, stand : shares of running, crouching and standing, 0 to 1.
    weight : share of the weight on the left foot.
    swing : how far the left foot is ahead of the right one, in lengths of a leg.
    lean_ahead, lean_left : lean of an inverted pendulum under the body's acceleration, radians.
    idle : [T, 14] restless wandering, about 1 in size.
    tremble : [T, 6] quick small wandering, larger the faster the body goes, about 1 at 1.5 m/s.
    shift : [T, 2] slow wandering of a standing body: of its weight to the left, and of where it looks.
    forward, side : [T, 2] unit vectors of the facing over the ground, and of its left.
    """

    run: Array
    crouch: Array
    stand: Array
    weight: Array
    swing: Array
    lean_ahead: Array
    lean_left: Array
    idle: Array
    tremble: Array
    shift: Array
    forward: Array
    side: Array


def rhythm(path: Path, left: Foot, right: Foot, style: Style, rng: np.random.Generator) -> Rhythm:
    """The rhythm of steps along a path."""
    fps, frames = path.fps, len(path.time)
    stand = smooth(1 - ease(np.maximum(path.speed / 0.35, np.abs(path.turning) / 0.8)), 0.18 * fps)
    idle = style.restless * wander(rng, frames, fps, 14, 9.0, 1.6)
    shift = wander(rng, frames, fps, 2, 16.0, 5.0)
    tremble = wander(rng, frames, fps, 6, 0.35, 0.12) * (0.15 + 0.57 * path.speed)[:, None]
    forward = np.stack([np.sin(path.heading), np.cos(path.heading)], axis=-1)
    side = np.stack([np.cos(path.heading), -np.sin(path.heading)], axis=-1)
    apart = dot((left.ankle - right.ankle)[:, [0, 2]], forward) / LEG
    lean_ahead, lean_left = (
        MOST_LEAN * np.tanh(0.8 * smooth(dot(path.acceleration, axis), 0.08 * fps) / GRAVITY / MOST_LEAN)
        for axis in (forward, side)
    )
    return Rhythm(
        run=smooth(path.running, 0.1 * fps),
        crouch=smooth(path.crouching, 0.1 * fps),
        stand=stand,
        weight=_weight(left, right, 0.55 * stand * np.clip(shift[:, 0], -1.6, 1.6)),
        swing=1.1 * np.tanh(smooth(apart, 0.06 * fps) / 1.1),
        lean_ahead=lean_ahead,
        lean_left=lean_left,
        idle=idle,
        tremble=tremble,
        shift=shift,
        forward=forward,
        side=side,
    )


def _weight(left: Foot, right: Foot, shift: Array) -> Array:
    """Share of the weight on the left foot [T]; shift [T] moves it to the left while both stand."""
    parts = []
    for foot in (left, right):
        # Weight comes and goes within a tenth of a second in a walk, slower out of a stand.
        come = smoothstep(foot.since / 0.16)
        go = smoothstep(foot.left / np.clip(0.14 + 0.15 * (foot.since - 0.7), 0.14, 0.45))
        parts.append(np.where(foot.on, np.minimum(come, go), 0.0))
    a, b = parts[0] * (1 + shift) + 1e-3, parts[1] * (1 - shift) + 1e-3
    return a / (a + b)
