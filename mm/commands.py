"""From what a user's hands do to what characters are asked: pure functions on arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.springs import wrap

from .control import Command
from .speeds import Speeds

Float = NDArray[np.float32]

DEADZONE = 0.2
STILL = 1e-3  # m/s or tilt below which a direction means nothing


def from_stick(
    stick: ArrayLike,
    camera_yaw: ArrayLike,
    *,
    yaw: ArrayLike,
    last_yaw: ArrayLike | None = None,
    camera_rate: ArrayLike = 0.0,
    strafe: ArrayLike = False,
    gait: ArrayLike = 0.0,
    speeds: Speeds | None = None,
    deadzone: float = DEADZONE,
) -> Command:
    """What N characters are asked by N sticks and the cameras behind them.

    The stick's tilt, turned into the world by the camera, is scaled by the speeds forward, sideways and
    backward in the frame of the character's facing, as the public reference does: tilted halfway between two
    of them the velocity lies on the ellipse they span. The facing is the camera's when strafing, else the
    tilt's direction, and stays what it was at rest.

    Parameters
    ----------
    stick : [N, 2] tilt in [-1, 1]: x > 0 is the camera's right (the world's -X when it looks along +Z), z > 0
        away from the camera. Tilts longer than 1 count as 1.
    camera_yaw : [N] direction in which the camera looks, radians; 0 is +Z, pi/2 is +X.
    yaw : [N] where the characters face, radians.
    last_yaw : [N] the facing last asked for, kept at rest; yaw when None.
    camera_rate : [N] rad/s at which the camera turns.
    strafe : [N] bool, face where the camera looks.
    gait : [N] 0 walk to 1 run, speeds in between.
    deadzone : tilt that counts as none; the rest of the way is stretched to [0, 1].
    """
    stick = np.asarray(stick, np.float32).reshape(-1, 2)
    speeds = speeds or Speeds()
    count = len(stick)
    camera = _column(camera_yaw, count)
    yaw = _column(yaw, count)
    share = np.clip(_column(gait, count), 0, 1)

    tilt = np.hypot(stick[:, 0], stick[:, 1])
    reach = np.clip((tilt - deadzone) / (1 - deadzone), 0, 1)
    moving = reach > STILL
    direction = camera + np.arctan2(-stick[:, 0], stick[:, 1])
    # The tilt in the character's frame: ahead and left.
    turn = direction - yaw
    ahead, left = reach * np.cos(turn), reach * np.sin(turn)
    walk, run = np.array(speeds.walk, np.float32), np.array(speeds.run, np.float32)
    forward, side, back = (walk[i] + share * (run[i] - walk[i]) for i in range(3))
    ahead = ahead * np.where(ahead > 0, forward, back)
    left = left * side
    sin, cos = np.sin(yaw), np.cos(yaw)
    velocity = np.stack([ahead * sin + left * cos, ahead * cos - left * sin], axis=-1)

    rest = yaw if last_yaw is None else _column(last_yaw, count)
    facing = np.where(np.broadcast_to(strafe, count), camera, np.where(moving, direction, rest))
    return _command(velocity, facing, _column(camera_rate, count))


def from_velocity(
    velocity: ArrayLike,
    facing: ArrayLike | None = None,
    *,
    last_yaw: ArrayLike = 0.0,
    turn_rate: ArrayLike = 0.0,
    max_speed: float | None = None,
) -> Command:
    """What N characters are asked by target velocities and, to strafe, facings.

    Parameters
    ----------
    velocity : [N, 2] x, z, m/s.
    facing : [N, 2] direction x, z of any length; where it is zero, and when None, the character faces where
        it goes.
    last_yaw : [N] the facing kept by who neither moves nor has a facing, radians.
    turn_rate : [N] rad/s at which velocity and facing are expected to turn.
    max_speed : longer velocities are shortened to it, m/s.
    """
    velocity = np.asarray(velocity, np.float32).reshape(-1, 2)
    count = len(velocity)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    if max_speed is not None:
        velocity = velocity * np.minimum(1, max_speed / np.maximum(speed, 1e-9))[:, None]
    yaw = np.where(speed > STILL, np.arctan2(velocity[:, 0], velocity[:, 1]), _column(last_yaw, count))
    if facing is not None:
        facing = np.broadcast_to(np.asarray(facing, np.float32), (count, 2))
        given = np.hypot(facing[:, 0], facing[:, 1]) > 0
        yaw = np.where(given, np.arctan2(facing[:, 0], facing[:, 1]), yaw)
    return _command(velocity, yaw, _column(turn_rate, count))


def _column(value: ArrayLike, count: int) -> Float:
    return np.broadcast_to(np.asarray(value, np.float32), count)


def _command(velocity: NDArray, yaw: NDArray, turn_rate: NDArray) -> Command:
    # Facings in [-pi, pi): cameras that go on turning would lose digits in float32.
    return Command(
        np.ascontiguousarray(velocity, np.float32),
        np.asarray(wrap(yaw), np.float32),
        np.array(turn_rate, np.float32),
        np.zeros(len(velocity), np.uint32),
        np.zeros(len(velocity), np.uint32),
        np.zeros(len(velocity), np.bool_),
    )
