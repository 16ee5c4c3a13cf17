"""Quaternions of the Euler angles of many joints, each with axes of its own."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from . import quat


def unrolled(
    values: NDArray[np.float64], columns: NDArray[np.int64], axes: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Quaternions [T, J, 4], unrolled over time, of angles in a table of degrees.

    Parameters
    ----------
    values : [T, C] degrees.
    columns : [J, 3] the columns of each joint's angles, R = R_first R_second R_third; -1 behind the last.
    axes : [J, 3] the axes they turn about, 0 to 2 for x to z.
    """
    out = np.empty((len(values), len(columns), 4))
    _unrolled(values, columns, axes, out)
    return out


def unrolled_plain(
    values: NDArray[np.float64], columns: NDArray[np.int64], axes: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The obvious twin of `unrolled`."""
    out = quat.identity(len(values), len(columns))
    for j, (of_joint, about) in enumerate(zip(columns.tolist(), axes.tolist(), strict=True)):
        order = "".join("xyz"[axis] for axis, column in zip(about, of_joint, strict=True) if column >= 0)
        if order:
            out[:, j] = quat.from_euler(np.radians(values[:, of_joint[: len(order)]]), order)
    return np.asarray(quat.unroll(out), np.float64)


@numba.njit(cache=True, nogil=True)
def _unrolled(values, columns, axes, out):
    to_half = math.pi / 360
    for t in range(len(values)):
        for j in range(len(columns)):
            w, x, y, z = 1.0, 0.0, 0.0, 0.0
            for k in range(3):
                if columns[j, k] < 0:
                    break
                half = values[t, columns[j, k]] * to_half
                c, s = math.cos(half), math.sin(half)
                if axes[j, k] == 0:
                    w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
                elif axes[j, k] == 1:
                    w, x, y, z = w * c - y * s, x * c - z * s, y * c + w * s, z * c + x * s
                else:
                    w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
            sign = 1.0
            if t > 0:
                p = out[t - 1, j]
                if p[0] * w + p[1] * x + p[2] * y + p[3] * z < 0:
                    sign = -1.0
            out[t, j, 0], out[t, j, 1], out[t, j, 2], out[t, j, 3] = sign * w, sign * x, sign * y, sign * z
