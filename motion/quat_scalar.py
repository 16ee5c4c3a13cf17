"""Quaternion maths on plain numbers, for compiled kernels; `motion.quat` is the same on arrays.

Quaternions are four arguments or a tuple (w, x, y, z), vectors three or (x, y, z).
"""

from __future__ import annotations

import math

import numba


@numba.njit(inline="always", cache=True)
def mul(a, b):
    """Hamilton product."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@numba.njit(inline="always", cache=True)
def inv(q):
    """Inverse of a unit quaternion."""
    w, x, y, z = q
    return w, -x, -y, -z


@numba.njit(inline="always", cache=True)
def cross(a, b):
    """Cross product."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@numba.njit(inline="always", cache=True)
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(inline="always", cache=True)
def rotate(q, v):
    """Rotate a vector: v + 2 u x (u x v + w v)."""
    w, ux, uy, uz = q
    x, y, z = v
    tx, ty, tz = 2 * (uy * z - uz * y), 2 * (uz * x - ux * z), 2 * (ux * y - uy * x)
    return (
        x + w * tx + uy * tz - uz * ty,
        y + w * ty + uz * tx - ux * tz,
        z + w * tz + ux * ty - uy * tx,
    )


@numba.njit(inline="always", cache=True)
def exp(v):
    """Quaternion of a scaled angle axis."""
    x, y, z = v
    h = (x * x + y * y + z * z) / 4
    if h < 2.5:
        # Angles up to pi: the series of cos(a/2) and sin(a/2)/a in h = (a/2)^2 end below 1e-13, and need
        # neither a root nor a branch at zero.
        c = 1 - h * (1 / 2 - h * (1 / 24 - h * (1 / 720 - h * (1 / 40320 - h * (1 / 3628800 - h * (
            1 / 479001600 - h * (1 / 87178291200 - h / 20922789888000)))))))  # fmt: skip
        s = 1 - h * (1 / 6 - h * (1 / 120 - h * (1 / 5040 - h * (1 / 362880 - h * (1 / 39916800 - h * (
            1 / 6227020800 - h * (1 / 1307674368000 - h / 355687428096000)))))))  # fmt: skip
        s = s / 2
    else:
        half = math.sqrt(h)
        c, s = math.cos(half), math.sin(half) / (2 * half)
    return c, s * x, s * y, s * z


@numba.njit(inline="always", cache=True)
def log_shortest(q):
    """Scaled angle axis, angle at most pi, of a unit quaternion."""
    w, x, y, z = q
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    length = math.sqrt(x * x + y * y + z * z)
    s = 2.0 if length < 1e-7 else 2 * math.atan2(length, w) / length
    return s * x, s * y, s * z


@numba.njit(inline="always", cache=True)
def normalize(q):
    """Scale to unit length."""
    w, x, y, z = q
    s = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    return s * w, s * x, s * y, s * z


@numba.njit(inline="always", cache=True)
def between(u, v):
    """Shortest rotation from direction u to direction v, neither need be unit.

    Opposite directions turn by pi about some perpendicular axis.
    """
    x, y, z = cross(u, v)
    w = math.sqrt(dot(u, u) * dot(v, v)) + dot(u, v)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length < 1e-9 * dot(u, u):
        w = 0.0
        x, y, z = (
            cross(u, (1.0, 0.0, 0.0)) if abs(u[0]) < abs(u[1]) + abs(u[2]) else cross(u, (0.0, 1.0, 0.0))
        )
        length = math.sqrt(x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length
