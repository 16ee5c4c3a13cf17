"""The arms: they swing against the legs, hang when walking and are bent when running."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat
from . import turns
from .curves import smooth
from .path import Path
from .rhythm import Rhythm
from .style import Style

Array = NDArray[np.float64]


def swing(path: Path, rhythm: Rhythm, style: Style) -> dict[str, Array]:
    """Local rotations [T, 4] by joint, from the shoulders to the fingers."""
    late = smooth(rhythm.swing, 0.045 * path.fps)
    gain = style.arm_swing * (1 - 0.5 * rhythm.crouch) * (1 - 0.35 * np.clip(-path.ahead, 0, 1))
    joints: dict[str, Array] = {}
    for side, sign, idle in (("Left", 1.0, rhythm.idle[:, 10::2]), ("Right", -1.0, rhythm.idle[:, 11::2])):
        drive = -sign * late * gain * (1 + sign * style.asymmetry)  # forward with the other leg
        arm = _arm(drive, sign, idle, rhythm, style) | _hand(sign, rhythm.run)
        joints |= {side + joint: rotation for joint, rotation in arm.items()}
    return joints


def _arm(drive: Array, sign: float, idle: Array, rhythm: Rhythm, style: Style) -> dict[str, Array]:
    run, crouch = rhythm.run, rhythm.crouch
    walking, running = np.radians(3 + 19 * drive), np.radians(-21 + 25 * drive)
    flexion = walking + run * (running - walking) + np.radians(12 * crouch) + 0.25 * rhythm.lean_ahead
    flexion = flexion + 0.025 * idle[:, 0] + 0.0035 * rhythm.tremble[:, 0 if sign > 0 else 1]
    hanging = np.radians(26 + style.elbow + 15 * drive * (1 - rhythm.stand))
    bent = np.radians(94 + 14 * np.clip(drive, -1.2, 1.2))
    elbow = hanging + run * (bent - hanging) + np.radians(28 * crouch) + 0.02 * idle[:, 1]
    elbow = elbow + 0.006 * rhythm.tremble[:, 2 if sign > 0 else 3]
    out = np.radians(style.arm_out + 2 - 1 * run + 4 * crouch)
    inward = np.radians(10 - 6 * run + 10 * np.maximum(drive, 0) * (1 - run))
    # Out of the T-pose: turned about its length, down beside the body, then forward.
    upper = quat.mul(turns.z(-sign * (np.pi / 2 - out)), turns.x(inward))
    return {
        "Shoulder": quat.mul(turns.y(-sign * 0.08 * flexion), turns.z(sign * np.radians(2 * run - 3))),
        "Arm": quat.mul(turns.x(-flexion), upper),
        "ForeArm": turns.y(-sign * np.maximum(elbow, np.radians(6))),
    }


def _hand(sign: float, run: Array) -> dict[str, Array]:
    """A relaxed hand, half closed in a run."""
    curl = -sign * np.radians(22 + 28 * run)
    return {
        "Hand": np.broadcast_to(_relaxed(10, sign * -6), (len(run), 4)),
        "Index1": turns.z(curl),
        "Index2": turns.z(1.2 * curl),
        "Thumb1": quat.mul(turns.y(np.radians(sign * 12)), turns.z(0.4 * curl)),
        "Thumb2": turns.z(0.4 * curl),
    }


def _relaxed(about_x: float, about_z: float) -> Array:
    """A constant rotation [4] by degrees about two axes."""
    return quat.mul(turns.x(np.radians(about_x)), turns.z(np.radians(about_z)))
