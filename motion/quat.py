"""Quaternion maths on arrays ``[..., 4]``, components (w, x, y, z), unit length unless said otherwise.

All functions broadcast over leading axes and keep the floating type of their input.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]  # float32 or float64

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def identity(*shape: int, dtype: type = np.float64) -> Array:
    """Identity rotations ``[*shape, 4]``."""
    q: Array = np.zeros((*shape, 4), dtype)
    q[..., 0] = 1
    return q


def normalize(q: Array) -> Array:
    """Scale to unit length; a zero quaternion becomes the identity."""
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(length > 0, q / np.where(length > 0, length, 1), identity(dtype=q.dtype.type))


def inv(q: Array) -> Array:
    """Inverse of unit quaternions (the conjugate)."""
    return q * np.array([1, -1, -1, -1], q.dtype)


def mul(a: Array, b: Array) -> Array:
    """Hamilton product: rotate by b, then by a."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    w = aw * bw - ax * bx - ay * by - az * bz
    out: Array = np.empty((*np.shape(w), 4), w.dtype)  # np.stack takes as long as the products
    out[..., 0] = w
    out[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    out[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    out[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def rotate(q: Array, v: Array) -> Array:
    """Rotate vectors v ``[..., 3]`` by q ``[..., 4]``: v + 2 u x (u x v + w v), u the vector part."""
    w, u = q[..., :1], q[..., 1:]
    t = 2 * _cross(u, v)
    return v + w * t + _cross(u, t)


def _cross(a: Array, b: Array) -> Array:
    # np.cross spends most of its time on generality.
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out: Array = np.empty((*np.shape(x), 3), x.dtype)
    out[..., 0] = x
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out


def shortest(q: Array) -> Array:
    """The representative with w >= 0, whose angle is at most pi."""
    return np.where(q[..., :1] < 0, -q, q)


def towards(q: Array, other: Array) -> Array:
    """The representative that is nearer to another quaternion."""
    return np.where(np.sum(q * other, axis=-1, keepdims=True) < 0, -q, q)


def unroll(q: Array) -> Array:
    """Choose signs along axis 0 (time) so that consecutive quaternions are on one hemisphere."""
    if len(q) < 2:
        return q.copy()
    flips = np.einsum("...i,...i->...", q[1:], q[:-1]) < 0
    if not flips.any():
        return q.copy()
    signs = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1, 1).astype(q.dtype)
    out = q.copy()
    out[1:] *= signs[..., None]
    return out


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation by angle (radians) ``[...]`` about a unit axis ``[..., 3]``."""
    half = np.asarray(angle)[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * np.asarray(axis)], axis=-1)


def exp(v: Array) -> Array:
    """Quaternion of a scaled angle axis ``[..., 3]`` (axis times angle, radians)."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    # sin(a/2)/a as sinc, which is smooth through zero.
    return np.concatenate([np.cos(angle / 2), np.sinc(angle / (2 * np.pi)) / 2 * v], axis=-1).astype(
        v.dtype, copy=False
    )


def log(q: Array) -> Array:
    """Scaled angle axis ``[..., 3]`` of unit quaternions; call on `shortest` for angles up to pi."""
    w, u = q[..., :1], q[..., 1:]
    length = np.linalg.norm(u, axis=-1, keepdims=True)
    safe = np.where(length > 1e-12, length, 1)
    return np.where(length > 1e-12, 2 * np.arctan2(length, w) / safe, 2) * u


def from_euler(angles: Array, order: str) -> Array:
    """Quaternions of Euler angles (radians) ``[..., 3]``, intrinsic, applied in the given order.

    order "zxy" means R = Rz Rx Ry, as a BVH line ``Zrotation Xrotation Yrotation`` does.
    """
    half = np.asarray(angles) / 2
    c, s = np.cos(half), np.sin(half)
    q = None
    for i, axis in enumerate(order):
        r = np.zeros((*half.shape[:-1], 4), half.dtype)
        r[..., 0] = c[..., i]
        r[..., 1 + "xyz".index(axis)] = s[..., i]
        q = r if q is None else mul(q, r)
    assert q is not None
    return q


def to_euler(q: Array, order: str) -> Array:
    """Inverse of `from_euler` for three different axes (radians); the middle angle lies in +-pi/2.

    At the singularity the third angle is 0.
    """
    i, j, k = ("xyz".index(a) for a in order)
    parity = 1.0 if (i, j, k) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    m = to_matrix(q)
    sin_b = parity * m[..., i, k]
    locked = np.abs(sin_b) > 1 - 1e-12
    a = np.where(
        locked,
        np.arctan2(parity * m[..., k, j], m[..., j, j]),
        np.arctan2(-parity * m[..., j, k], m[..., k, k]),
    )
    # atan2 keeps its precision near the poles, where asin loses half of the digits.
    b = np.arctan2(sin_b, np.hypot(m[..., i, i], m[..., i, j]))
    c = np.where(locked, 0, np.arctan2(-parity * m[..., i, j], m[..., i, i]))
    return np.stack([a, b, c], axis=-1)


def to_matrix(q: Array) -> Array:
    """Rotation matrices ``[..., 3, 3]``."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)


def from_matrix(m: Array) -> Array:
    """Quaternions of rotation matrices ``[..., 3, 3]`` (Shepperd's choice of the largest component)."""
    d0, d1, d2 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack([1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2], axis=-1)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    e, f, g = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    rows = [
        np.stack([squares[..., 0], a, b, c], axis=-1),
        np.stack([a, squares[..., 1], e, f], axis=-1),
        np.stack([b, e, squares[..., 2], g], axis=-1),
        np.stack([c, f, g, squares[..., 3]], axis=-1),
    ]
    best = np.argmax(squares, axis=-1)[..., None, None]
    return normalize(np.take_along_axis(np.stack(rows, axis=-2), best, axis=-2)[..., 0, :])


def slerp(a: Array, b: Array, t: ArrayLike) -> Array:
    """Spherical interpolation on the short side; t ``[...]`` in [0, 1]."""
    return mul(a, exp(log(shortest(mul(inv(a), b))) * np.asarray(t)[..., None]))


def between(u: Array, v: Array) -> Array:
    """Shortest rotation from direction u to direction v ``[..., 3]`` (neither need be unit).

    Opposite directions turn by pi about an arbitrary perpendicular axis.
    """
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    u, v = np.broadcast_arrays(u, v)
    w = 1 + np.sum(u * v, axis=-1, keepdims=True)
    other = np.where(np.abs(u[..., :1]) < 0.9, _AXES["x"], _AXES["y"])
    q = np.where(
        w > 1e-9,
        np.concatenate([w, _cross(u, v)], axis=-1),
        np.concatenate([np.zeros_like(w), _cross(u, other)], axis=-1),
    )
    return normalize(q)


def from_yaw(angle: ArrayLike) -> Array:
    """Rotation about +Y by angle ``[...]``: 0 faces +Z, pi/2 faces +X (the left)."""
    return from_axis_angle(_AXES["y"], angle)


def yaw(q: Array) -> Array:
    """Heading angle ``[...]`` of the rotated +Z axis, atan2(x, z)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.arctan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))


def angle_between(a: Array, b: Array) -> Array:
    """Angle (radians) of the rotation between a and b, 2 acos |a . b|, computed without loss near 0."""
    d = mul(inv(a), b)
    return 2 * np.arctan2(np.linalg.norm(d[..., 1:], axis=-1), np.abs(d[..., 0]))
