"""Rotations about a joint's axes by angles [T] (radians) as quaternions [T, 4], and parts of rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat

Array = NDArray[np.float64]


def x(angle: Array) -> Array:
    """About the left: positive angles bend forward what points up."""
    return _about(1, angle)


def y(angle: Array) -> Array:
    """About the vertical: positive angles turn to the left."""
    return _about(2, angle)


def z(angle: Array) -> Array:
    """About the forward axis: positive angles lift what is on the left."""
    return _about(3, angle)


def part(rotation: Array, share: float) -> Array:
    """A share of each rotation."""
    return quat.exp(share * quat.log(quat.shortest(rotation)))


def _about(axis: int, angle: Array) -> Array:
    q = np.zeros((*np.shape(angle), 4))
    q[..., 0], q[..., axis] = np.cos(angle / 2), np.sin(angle / 2)
    return q
