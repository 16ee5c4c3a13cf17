"""Where a character has been and is going: the trajectory's window, its past and its blended future.

The published demo keeps 120 frames, of which every tenth is a sample that the network sees (REFERENCE 4.2).
Between samples its future is straight, and its past is only read at samples: so a ring of past frames and
the future's six samples hold the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .window import FUTURE, GAITS, INTERVAL, PRESENT, SAMPLES

PAST = 4 + len(GAITS)  # x, z, direction x, z in the world, and the gait, of a past frame


def character(*more: tuple[str, type], future: int = 4) -> np.dtype:
    """One character, with more numbers by name; future numbers are kept of each sample that is predicted.

    Yaws are radians, 0 faces +Z; what is local is in the root's space.
    """
    return np.dtype(
        [
            ("root", np.float32, 3),  # x, z, yaw of the frame to come
            ("height", np.float32),  # of the ground under it, smoothed along the trajectory
            ("gait", np.float32, len(GAITS)),
            ("target_velocity", np.float32, 2),  # asked, as far as taken in; the world's x, z, m/s
            ("target_yaw", np.float32),
            ("crouch", np.float32),
            ("future", np.float32, (FUTURE, future)),  # x, z and direction x, z, .. that are predicted, local
            ("velocity", np.float32, 2),  # of the root over the last frame, the world's x, z, m/s
            ("shown", np.float32, 3),  # root x, z, yaw of the last frame
            ("shown_height", np.float32),
            *more,
        ],
        align=True,
    )


def interval(fps: float) -> int:
    """Frames from one sample to the next."""
    return max(1, round(INTERVAL * fps))


def blend(spacing: int, position_bias: float, direction_bias: float) -> tuple[NDArray, NDArray]:
    """How much what is asked counts in the future, by sample.

    Returns [5], the sum over the frames between two samples of 1 - (1 - t)^position_bias, by which the
    increments of the way are mixed, and [5], 1 - (1 - t)^direction_bias at the later one (REFERENCE 4.2).
    """
    frames = FUTURE * spacing
    t = np.arange(1, (FUTURE - 1) * spacing + 1) / frames
    sums = (1 - (1 - t) ** position_bias).reshape(-1, spacing).sum(axis=1)
    turns = 1 - (1 - t[spacing - 1 :: spacing]) ** direction_bias
    return sums.astype(np.float32), turns.astype(np.float32)


def ring(count: int, spacing: int, width: int = PAST) -> NDArray[np.float32]:
    """Room for the past frames that samples are taken of, [N, H, 10 or more]."""
    return np.zeros((count, PRESENT * spacing, width), np.float32)


def world(roots: NDArray, x: NDArray, path: int) -> NDArray[np.float32]:
    """The trajectory [N, 12, 3] (x, z, yaw in the world) that inputs x [N, I] hold from column path on.

    roots [N, 3] are x, z, yaw of the roots that it is seen from.
    """
    px, pz, dx, dz = np.moveaxis(x[:, path : path + 4 * SAMPLES].reshape(len(x), 4, SAMPLES), 1, 0)
    yaw = roots[:, 2, None]
    c, s = np.cos(yaw), np.sin(yaw)
    out = np.stack([c * px + s * pz, c * pz - s * px, np.arctan2(c * dx + s * dz, c * dz - s * dx)], axis=-1)
    out[..., :2] += roots[:, None, :2]
    return out
