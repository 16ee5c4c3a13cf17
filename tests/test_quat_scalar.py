"""Scalar quaternions against the array ones and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import quat, quat_scalar

rng = np.random.default_rng(0)
A, B = (quat.normalize(rng.normal(size=(50, 4))) for _ in range(2))
V = rng.normal(size=(50, 3))


def each(function, *arrays):
    return np.array([function(*(tuple(row) for row in rows)) for rows in zip(*arrays, strict=True)])


@pytest.mark.parametrize(
    ("scalar", "array", "arguments"),
    [
        (quat_scalar.mul, quat.mul, (A, B)),
        (quat_scalar.inv, quat.inv, (A,)),
        (quat_scalar.rotate, quat.rotate, (A, V)),
        (quat_scalar.cross, np.cross, (V, V[::-1])),
        (quat_scalar.normalize, quat.normalize, (3 * A,)),
        (quat_scalar.between, quat.between, (V, V[::-1])),
    ],
)
def test_scalar_equals_array(scalar, array, arguments):
    np.testing.assert_allclose(each(scalar, *arguments), array(*arguments), atol=1e-14)


@pytest.mark.parametrize("angle", [0, 1e-9, 1e-3, 1, 3, 3.1622, 3.1623, 4, 6, 9])
def test_exp_equals_scipy(angle):
    axes = V / np.linalg.norm(V, axis=-1, keepdims=True) * angle
    expected = Rotation.from_rotvec(axes).as_quat(scalar_first=True)
    found = each(quat_scalar.exp, axes)
    np.testing.assert_allclose(
        found * np.sign(np.sum(found * expected, -1, keepdims=True)), expected, atol=1e-13
    )


def test_log_is_the_inverse_of_exp():
    short = V / np.linalg.norm(V, axis=-1, keepdims=True) * rng.uniform(0, np.pi - 1e-3, (50, 1))
    np.testing.assert_allclose(
        each(quat_scalar.log_shortest, each(quat_scalar.exp, short)), short, atol=1e-12
    )
    np.testing.assert_allclose(
        each(quat_scalar.log_shortest, -each(quat_scalar.exp, short)), short, atol=1e-12
    )


@pytest.mark.parametrize("u", np.eye(3))
def test_opposite_directions_turn_by_half(u):
    q = quat_scalar.between(tuple(u), tuple(-2 * u))
    np.testing.assert_allclose(quat_scalar.rotate(q, tuple(u)), -u, atol=1e-12)
