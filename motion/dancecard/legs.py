"""The legs between pelvis and feet: two bones and a hinge that bends forward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat
from . import figure, turns
from .curves import cross, dot, ease
from .feet import Foot

Array = NDArray[np.float64]

LONGEST = figure.THIGH + figure.SHANK - 1e-6
INSTEP = float(np.hypot(figure.ANKLE - figure.BALL[1], figure.BALL[2]))  # from the ankle to the ball
LEVEL = float(np.arctan2(figure.ANKLE - figure.BALL[1], figure.BALL[2]))  # its slope when the sole is flat
TOE_CLEAR = float(figure.BALL[1]) + 0.03  # height below which the toes of a swinging foot are not lowered
TIP_CLEAR = 0.003 - float(figure.TOE[1])  # least height of the toes' tips above the floor
DORSIFLEXION = np.radians(3)  # of a foot in the air, beyond which it gives way


def bend(position: Array, rotation: Array, foot: Foot, sign: float) -> dict[str, Array]:
    """Local rotations [T, 4] by joint of the leg that puts a foot where it belongs.

    position [T, 3] and rotation [T, 4] are the pelvis's; sign is 1 for the left and -1 for the right leg.
    """
    hip = position + quat.rotate(rotation, np.broadcast_to(figure.HIP * [sign, 1, 1], position.shape))
    free = ease(np.minimum(foot.swing / 0.12, (0.97 - foot.swing) / 0.2))
    way = foot.ankle - hip
    distance = np.sqrt(dot(way, way))
    down = way / distance[:, None]
    # A swinging leg does not reach out to the last: it stays a little bent, and is there when it lands.
    held = distance + free * (_yielding(distance, LONGEST - 0.004, 0.025) - distance)
    reach = np.minimum(held, LONGEST)
    hinge, thigh = _knee(down, reach, quat.yaw(rotation), foot.yaw)
    shank = (reach[:, None] * down - figure.THIGH * thigh) / figure.SHANK
    back = quat.inv(rotation)
    upper = _frame(quat.rotate(back, hinge), quat.rotate(back, thigh))
    knee = turns.x(np.arctan2(dot(cross(thigh, shank), hinge), dot(thigh, shank)))
    pitch = _pitch(foot, shank, free)
    sole = quat.mul(quat.from_yaw(foot.yaw), turns.x(-pitch))
    return {
        "UpLeg": upper,
        "Leg": knee,
        "Foot": quat.mul(quat.inv(quat.mul(rotation, quat.mul(upper, knee))), sole),
        "ToeBase": turns.x(-_bend(foot, pitch)),
    }


def _knee(down: Array, reach: Array, facing: Array, toes: Array) -> tuple[Array, Array]:
    """Axis of the knee and direction of the thigh [T, 3], by the law of cosines.

    The knee points between where the pelvis faces and where the toes do (yaws [T]), a little more to these.
    """
    turned = facing + 0.6 * np.arctan2(np.sin(toes - facing), np.cos(toes - facing))
    hinge = _unit(cross(_ahead(turned), down))
    front = cross(down, hinge)
    a, b = figure.THIGH, figure.SHANK
    cosine = np.clip((a * a + reach * reach - b * b) / (2 * a * reach), -1, 1)[:, None]
    return hinge, cosine * down + np.sqrt(1 - cosine * cosine) * front


def _pitch(foot: Foot, shank: Array, free: Array) -> Array:
    """Pitch [T] of a foot: in the air it bends up no further than an ankle does, if the toes stay clear."""
    calf = np.arctan2(dot(shank, _ahead(foot.yaw)), -shank[:, 1])
    raised = foot.pitch - calf - DORSIFLEXION
    pitch = foot.pitch - free * np.where(raised > 0, raised - 0.1 * np.tanh(raised / 0.1), 0.0)
    lowest = LEVEL + np.arcsin(np.clip((TOE_CLEAR - foot.ankle[:, 1]) / INSTEP, -1, 1))
    return np.minimum(foot.pitch, _at_least(pitch, lowest))


def _bend(foot: Foot, pitch: Array) -> Array:
    """Extension of the toes [T]: no less than keeps their tips above the floor."""
    ball = foot.ankle[:, 1] + INSTEP * np.sin(pitch - LEVEL)
    least = np.arcsin(np.clip((TIP_CLEAR - ball) / figure.TOE[2], -1, 1)) - pitch
    return _at_least(foot.bend, least, 0.04)


def _ahead(yaw: Array) -> Array:
    return np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], axis=-1)


def _at_least(value: Array, least: Array, margin: float = 0.08) -> Array:
    """The greater of two, rounded where they meet."""
    return least + np.logaddexp(0, (value - least) / margin) * margin


def _yielding(distance: Array, most: float, margin: float) -> Array:
    """Distances that approach most and never pass it, unchanged below most - margin."""
    over = np.maximum(distance - (most - margin), 0) / margin
    return np.where(over > 0, most - margin * np.exp(-over), distance)


def _frame(left: Array, down: Array) -> Array:
    """Rotations whose X axis is left and whose Y axis is against down, by less than half a turn."""
    lx, ly, lz = left.T
    ux, uy, uz = -down.T
    fx, fy, fz = ly * uz - lz * uy, lz * ux - lx * uz, lx * uy - ly * ux
    q = np.empty((len(left), 4))
    q[:, 0], q[:, 1], q[:, 2], q[:, 3] = 1 + lx + uy + fz, uz - fy, fx - lz, ly - ux
    return q / np.sqrt(4 * q[:, :1])


def _unit(v: Array) -> Array:
    return v / np.sqrt(dot(v, v))[:, None]
