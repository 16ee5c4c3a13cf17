"""Quaternions against SciPy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from motion import quat

RANDOM = np.random.default_rng(1)


def scipy(q):
    return Rotation.from_quat(np.asarray(q)[..., [1, 2, 3, 0]])


def unit(*shape, dtype=np.float64):
    return quat.normalize(RANDOM.normal(size=(*shape, 4)).astype(dtype))


def same(a, b, tolerance=1e-12):
    return np.allclose(np.abs(np.sum(np.asarray(a) * np.asarray(b), axis=-1)), 1, rtol=0, atol=tolerance)


def test_multiplication_rotation_and_inverse():
    a, b, v = unit(50), unit(50), RANDOM.normal(size=(50, 3))
    assert same(quat.mul(a, b), (scipy(a) * scipy(b)).as_quat()[:, [3, 0, 1, 2]])
    np.testing.assert_allclose(quat.rotate(a, v), scipy(a).apply(v), atol=1e-12)
    np.testing.assert_allclose(quat.rotate(quat.inv(a), quat.rotate(a, v)), v, atol=1e-12)


def test_broadcasting_over_leading_axes():
    a, b = unit(7, 1), unit(5)
    assert quat.mul(a, b).shape == (7, 5, 4)
    assert quat.rotate(a, np.ones((5, 3))).shape == (7, 5, 3)
    np.testing.assert_array_equal(quat.mul(a, b)[3, 2], quat.mul(a[3, 0], b[2]))


def test_exponential_and_logarithm():
    v = RANDOM.normal(size=(100, 3))
    v *= (RANDOM.uniform(0, np.pi - 1e-6, 100) / np.linalg.norm(v, axis=-1))[:, None]
    assert same(quat.exp(v), Rotation.from_rotvec(v).as_quat()[:, [3, 0, 1, 2]])
    np.testing.assert_allclose(quat.log(quat.exp(v)), v, atol=1e-9)
    np.testing.assert_allclose(quat.log(quat.shortest(-quat.exp(v))), v, atol=1e-9)
    near = quat.towards(-quat.exp(v), quat.exp(v[::-1]))
    assert (np.sum(near * quat.exp(v[::-1]), axis=-1) >= 0).all() and same(near, quat.exp(v))
    tiny = v * 1e-10
    np.testing.assert_allclose(quat.log(quat.exp(tiny)), tiny, rtol=1e-6, atol=0)
    np.testing.assert_array_equal(quat.exp(np.zeros((1, 3))), quat.identity(1))


@pytest.mark.parametrize("order", ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"])
def test_euler_angles_in_every_order(order):
    angles = RANDOM.uniform(-np.pi, np.pi, (200, 3))
    q = quat.from_euler(angles, order)
    assert same(q, Rotation.from_euler(order.upper(), angles).as_quat()[:, [3, 0, 1, 2]])
    back = quat.to_euler(q, order)
    assert same(quat.from_euler(back, order), q)
    assert np.abs(back[:, 1]).max() <= np.pi / 2 + 1e-9
    locked = np.array([[0.3, np.pi / 2, 0.4], [0.3, -np.pi / 2, 0.4]])
    assert same(
        quat.from_euler(quat.to_euler(quat.from_euler(locked, order), order), order),
        quat.from_euler(locked, order),
        1e-9,
    )


def test_matrices():
    q = unit(100)
    np.testing.assert_allclose(quat.to_matrix(q), scipy(q).as_matrix(), atol=1e-12)
    assert same(quat.from_matrix(scipy(q).as_matrix()), q)
    half_turns = np.stack([np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1])]).astype(
        float
    )
    np.testing.assert_allclose(quat.to_matrix(quat.from_matrix(half_turns)), half_turns, atol=1e-12)


def test_slerp():
    a, b, t = unit(20), unit(20), RANDOM.uniform(0, 1, 20)
    b = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0, -b, b)
    for i in range(20):
        truth = Slerp([0, 1], scipy(np.stack([a[i], b[i]])))(t[i]).as_quat()[[3, 0, 1, 2]]
        assert same(quat.slerp(a[i], b[i], t[i]), truth)
        assert same(quat.slerp(a[i], -b[i], t[i]), truth)


@given(st.floats(-20, 20))
def test_yaw_faces_where_it_says(angle):
    q = quat.from_yaw(angle)
    np.testing.assert_allclose(
        quat.rotate(q, np.array([0.0, 0.0, 1.0])), [np.sin(angle), 0, np.cos(angle)], atol=1e-9
    )
    assert abs((quat.yaw(q) - angle + np.pi) % (2 * np.pi) - np.pi) < 1e-9


def test_between_directions():
    u, v = RANDOM.normal(size=(50, 3)), RANDOM.normal(size=(50, 3))
    u[0], v[0] = [1, 2, 3], [-2, -4, -6]
    u[1], v[1] = [0, 1, 0], [0, 5, 0]
    turned = quat.rotate(quat.between(u, v), u / np.linalg.norm(u, axis=-1, keepdims=True))
    np.testing.assert_allclose(turned, v / np.linalg.norm(v, axis=-1, keepdims=True), atol=1e-7)


def test_angle_between_without_loss_near_zero():
    q = unit(10)
    for angle in (1e-9, 1e-3, 1.0, np.pi):
        other = quat.mul(q, quat.from_axis_angle([0.6, 0.0, 0.8], angle))
        np.testing.assert_allclose(quat.angle_between(q, -other), angle, rtol=1e-6)


def test_unroll_keeps_rotations_and_removes_flips():
    angle = np.linspace(0, 12, 200)
    q = quat.from_axis_angle([0.0, 1.0, 0.0], angle)
    broken = q * np.where(RANDOM.random(200) < 0.5, -1, 1)[:, None]
    broken[0] = q[0]
    np.testing.assert_allclose(quat.unroll(broken), q, atol=1e-12)
    assert len(quat.unroll(q[:1])) == 1 and len(quat.unroll(q[:0])) == 0


def test_zero_becomes_the_identity_and_types_stay():
    np.testing.assert_array_equal(quat.normalize(np.zeros((2, 4))), quat.identity(2))
    q = unit(3, dtype=np.float32)
    v = np.ones((3, 3), np.float32)
    for value in (
        quat.mul(q, q),
        quat.rotate(q, v),
        quat.inv(q),
        quat.log(q),
        quat.exp(v),
        quat.normalize(q),
        quat.unroll(q),
    ):
        assert value.dtype == np.float32
