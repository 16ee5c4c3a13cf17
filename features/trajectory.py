"""Ground-plane trajectories: from the world into a root's frame and back.

Points and directions are (x, z) pairs. A root at position p with yaw a faces (sin a, cos a); its left is
(cos a, -sin a). Leading axes broadcast: points ``[N, K, 2]`` go with positions ``[N, 2]`` and yaws ``[N]``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def directions_to_local(directions: Array, yaws: Array) -> Array:
    """World directions ``[..., K, 2]`` in the frames of roots that face yaws ``[...]`` (radians)."""
    sin, cos = np.sin(yaws)[..., None], np.cos(yaws)[..., None]
    x, z = directions[..., 0], directions[..., 1]
    return np.stack([cos * x - sin * z, sin * x + cos * z], axis=-1)


def directions_to_world(directions: Array, yaws: Array) -> Array:
    """Inverse of `directions_to_local`."""
    return directions_to_local(directions, -np.asarray(yaws))


def points_to_local(points: Array, positions: Array, yaws: Array) -> Array:
    """World points ``[..., K, 2]`` (m) in frames of roots at positions ``[..., 2]`` and yaws ``[...]``."""
    return directions_to_local(points - positions[..., None, :], yaws)


def points_to_world(points: Array, positions: Array, yaws: Array) -> Array:
    """Inverse of `points_to_local`."""
    return directions_to_world(points, yaws) + positions[..., None, :]


def facing(yaws: Array) -> Array:
    """Facing directions (x, z) ``[..., 2]`` of yaws ``[...]`` (radians)."""
    return np.stack([np.sin(yaws), np.cos(yaws)], axis=-1)
