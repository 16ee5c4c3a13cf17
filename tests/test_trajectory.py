"""Ground-plane frames: round trips, and agreement with quaternions."""

from __future__ import annotations

import numpy as np

from features import trajectory
from motion import quat

RANDOM = np.random.default_rng(5)
POINTS, ROOTS, YAWS = RANDOM.normal(size=(6, 4, 2)), RANDOM.normal(size=(6, 2)), RANDOM.uniform(-9, 9, 6)


def test_agrees_with_quaternions():
    there = np.insert(POINTS - ROOTS[:, None], 1, 0, axis=-1)
    inverse = np.broadcast_to(quat.inv(quat.from_yaw(YAWS))[:, None], (6, 4, 4))
    expected = quat.rotate(inverse, there)[..., ::2]
    np.testing.assert_allclose(trajectory.points_to_local(POINTS, ROOTS, YAWS), expected, atol=1e-12)


def test_world_and_local_are_inverse():
    local = trajectory.points_to_local(POINTS, ROOTS, YAWS)
    np.testing.assert_allclose(trajectory.points_to_world(local, ROOTS, YAWS), POINTS, atol=1e-12)
    local = trajectory.directions_to_local(POINTS, YAWS)
    np.testing.assert_allclose(trajectory.directions_to_world(local, YAWS), POINTS, atol=1e-12)


def test_a_root_faces_its_own_forward():
    ahead = trajectory.directions_to_local(trajectory.facing(YAWS)[:, None], YAWS)
    np.testing.assert_allclose(ahead[:, 0], np.tile([0, 1], (6, 1)), atol=1e-12)
    np.testing.assert_allclose(trajectory.facing(np.pi / 2), [1, 0], atol=1e-12)
