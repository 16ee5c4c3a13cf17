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
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-4:
        # sin(a/2)/a = 1/2 - a^2/48 + ..., cos(a/2) = 1 - a^2/8 + ...
        s = 0.5 - angle * angle / 48
        return 1 - angle * angle / 8, s * x, s * y, s * z
    s = math.sin(angle / 2) / angle
    return math.cos(angle / 2), s * x, s * y, s * z


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
    """Shortest rotation from direction u to direction v, neither need be unit; opposite ones: identity axis x."""
    x, y, z = cross(u, v)
    w = math.sqrt(dot(u, u) * dot(v, v)) + dot(u, v)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length < 1e-12:
        return 0.0, 1.0, 0.0, 0.0
    return w / length, x / length, y / length, z / length
