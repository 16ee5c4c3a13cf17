"""Rotations in the formats that files have them in, as unit quaternions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat

Array = NDArray[np.float64]

FORMATS = (
    *("quaternion", "quaternion_wxyz", "wxyz", "quaternion_xyzw", "xyzw"),
    *("axis_angle", "euler", "matrix", "6d", "6d_rows"),
)
_UNIT = 1e-9  # by which a quaternion's length may differ from 1 and stay as it is


def rotations(values: Array, joints: int, form: str, order: str | None, degrees: bool) -> Array:
    """Unit quaternions [T, J, 4] of values in a format of `FORMATS`, or by their shape where it is empty.

    order is that of Euler angles, degrees their unit and that of axis-angles. 6d are the first two columns of
    the matrix (Zhou et al., "On the continuity of rotation representations in neural networks", 2019),
    6d_rows its first two rows. Errors: ValueError for another shape, no order, and numbers that are no
    rotations.
    """
    if values.ndim == 2 and form in ("axis_angle", "euler") and values.shape[1] == 3 * joints:
        values = values.reshape(len(values), joints, 3)
    if values.ndim < 3 or values.shape[1] != joints:
        raise ValueError(f"expected one rotation for each of {joints} joints a frame")
    tail = values.shape[2:]
    form = form or {(4,): "wxyz", (3, 3): "matrix", (6,): "6d"}.get(tail, "")
    if not form:
        raise ValueError("the format of rotations is unknown; name it in rotation_format")
    form = form.removeprefix("quaternion_").replace("quaternion", "wxyz")
    sizes = {"wxyz": (4,), "xyzw": (4,), "axis_angle": (3,), "euler": (3,), "matrix": (3, 3)}
    if tail != sizes.get(form, (6,)):
        raise ValueError(f"expected {list(sizes.get(form, (6,)))} numbers a joint for the format {form}")
    if form in ("axis_angle", "euler") and degrees:
        values = np.radians(values)
    if form == "axis_angle":
        return np.asarray(quat.exp(values), np.float64)
    if form == "euler":
        if order is None or sorted(order.lower()) != ["x", "y", "z"]:
            raise ValueError("Euler angles need a euler_order such as zxy")
        return np.asarray(quat.from_euler(values, order.lower()), np.float64)
    if form == "matrix":
        return _of_matrices(values)
    if form.startswith("6d"):
        return _of_six(values, rows=form == "6d_rows")
    return _of_quaternions(values if form == "wxyz" else np.roll(values, 1, axis=-1))


def _of_quaternions(values: Array) -> Array:
    lengths = np.linalg.norm(values, axis=-1)
    if lengths.size and lengths.min() < 1e-6:
        raise ValueError("a quaternion has no length")
    # Those of unit length but for rounding stay, to the last bit.
    return np.where(np.abs(lengths - 1)[..., None] < _UNIT, values, quat.normalize(values))


def _of_matrices(values: Array) -> Array:
    error = np.abs(values @ np.swapaxes(values, -1, -2) - np.eye(3)).max(initial=0)
    if error > 0.05 or (values.size and np.linalg.det(values).min() < 0):
        raise ValueError("matrices that are no rotations")
    return np.asarray(quat.from_matrix(values), np.float64)


def _of_six(values: Array, *, rows: bool) -> Array:
    """Gram-Schmidt: b1 = a1 / |a1|, b2 = a2 - (b1 . a2) b1 scaled to one, b3 = b1 x b2."""
    first, second = values[..., :3], values[..., 3:]
    first = first / np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-12)
    second = second - np.sum(first * second, axis=-1, keepdims=True) * first
    length = np.linalg.norm(second, axis=-1, keepdims=True)
    if length.size and (length.min() < 1e-6 or np.linalg.norm(first, axis=-1).min() < 0.5):
        raise ValueError("six numbers that span no plane")
    second = second / length
    matrix = np.stack([first, second, np.cross(first, second)], axis=-2 if rows else -1)
    return np.asarray(quat.from_matrix(matrix), np.float64)
