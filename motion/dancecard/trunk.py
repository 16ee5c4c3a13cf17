"""Spine, neck and head: the chest turns against the pelvis, the head is level and looks ahead on the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat
from . import turns
from .curves import smooth
from .feet import Foot
from .path import Path
from .pelvis import drop, nodding
from .rhythm import Rhythm
from .style import Style

Array = NDArray[np.float64]

COUNTER = np.radians(4.2)  # of the chest against the legs' swing
LAG = 0.07  # seconds by which the chest turns after the legs
FORESIGHT = 0.28  # seconds by which the head turns before the body
GLANCE = 0.9  # radians that the head turns at most


def hold(
    path: Path, left: Foot, right: Foot, rhythm: Rhythm, style: Style, pelvis: Array
) -> dict[str, Array]:
    """Local rotations [T, 4] of spine, neck and head by joint, over a pelvis of rotation [T, 4]."""
    chest, roll = _chest(path, left, right, rhythm, style)
    trunk = turns.part(quat.mul(quat.inv(pelvis), chest), 1 / 3)
    neck = quat.mul(quat.inv(chest), _head(path, left, right, rhythm, roll, style))
    bow = turns.part(neck, 0.3)
    return {
        "Spine": trunk, "Spine1": trunk, "Spine2": trunk,
        "Neck": bow, "Neck1": bow, "Head": turns.part(neck, 0.4),
    }  # fmt: skip


def _chest(path: Path, left: Foot, right: Foot, rhythm: Rhythm, style: Style) -> tuple[Array, Array]:
    """Rotation of the chest in the world [T, 4], and its roll [T]."""
    idle, fps, run = rhythm.idle, path.fps, rhythm.run
    counter = COUNTER * style.twist * smooth(_late(rhythm.swing, LAG * fps), 0.03 * fps) * (1 + 2.2 * run)
    nod = np.radians(2.4 + 1.8 * run) * nodding(left, right, path, rhythm)
    pitch = np.radians(10.5 + style.lean + 8.0 * run + 22.0 * rhythm.crouch) + 0.9 * rhythm.lean_ahead
    pitch = pitch + nod + 0.02 * np.minimum(path.speed, 2) + 0.014 * idle[:, 4]
    pitch = pitch + 0.0012 * rhythm.tremble[:, 4]
    roll = -0.8 * rhythm.lean_left - 0.35 * drop(path, rhythm) + 0.010 * idle[:, 5]
    yaw = (
        path.heading
        + counter
        + 0.02 * idle[:, 6] * (0.3 + 0.7 * rhythm.stand)
        + 0.0015 * rhythm.tremble[:, 5]
    )
    return quat.mul(turns.y(yaw), quat.mul(turns.z(roll), turns.x(pitch))), roll


def _late(values: Array, frames: float) -> Array:
    """Values [T] as they were some frames before."""
    back = min(round(frames), len(values) - 1)
    return np.concatenate([np.repeat(values[:1], back), values[: len(values) - back]])


def _head(path: Path, left: Foot, right: Foot, rhythm: Rhythm, roll: Array, style: Style) -> Array:
    """Rotation of the head in the world [T, 4]."""
    idle, heading = rhythm.idle, path.heading
    early = min(round(FORESIGHT * path.fps), len(heading) - 1)
    gaze = smooth(np.concatenate([heading[early:], np.repeat(heading[-1:], early)]), 0.12 * path.fps)
    yaw = heading + GLANCE * np.tanh((gaze - heading) / GLANCE)
    yaw = yaw + (0.06 * idle[:, 7] + 0.16 * rhythm.stand * rhythm.shift[:, 1]) * style.restless
    pitch = np.radians(3 + style.head + 5 * rhythm.crouch) + 0.1 * rhythm.lean_ahead + 0.02 * idle[:, 9]
    # It looks at one point while the body rises and falls.
    pitch = pitch - np.radians(1.7 + 0.8 * rhythm.run) * nodding(left, right, path, rhythm)
    return quat.mul(turns.y(yaw), quat.mul(turns.z(0.25 * roll + 0.012 * idle[:, 8]), turns.x(pitch)))
