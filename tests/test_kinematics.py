"""Forward kinematics against products of 4x4 matrices, the compiled loops against their NumPy twins."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import kinematics, quat
from motion.skeleton import Skeleton

RANDOM = np.random.default_rng(2)


def rig(joints=9):
    parents = np.array([-1, *(int(RANDOM.integers(0, j)) for j in range(1, joints))], np.int32)
    return Skeleton(tuple(f"j{i}" for i in range(joints)), parents, RANDOM.normal(size=(joints, 3)))


def pose(*shape, dtype=np.float64):
    positions = RANDOM.normal(size=(*shape, 3)).astype(dtype)
    return positions, quat.normalize(RANDOM.normal(size=(*shape, 4)).astype(dtype))


def test_forward_is_the_product_of_the_chain():
    skeleton = rig()
    positions, rotations = pose(9)
    world_pos, world_rot = kinematics.forward(skeleton, positions, rotations)
    matrices = np.tile(np.eye(4), (9, 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(rotations[:, [1, 2, 3, 0]]).as_matrix()
    matrices[:, :3, 3] = positions
    for j in range(9):
        world = np.eye(4)
        for i in skeleton.chain(j):
            world = world @ matrices[i]
        np.testing.assert_allclose(world_pos[j], world[:3, 3], atol=1e-12)
        np.testing.assert_allclose(quat.to_matrix(world_rot[j]), world[:3, :3], atol=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9,), (4, 9), (2, 3, 9), (0, 9)])
def test_compiled_loops_equal_numpy(dtype, shape):
    skeleton, tolerance = rig(), 1e-5 if dtype == np.float32 else 1e-12
    positions, rotations = pose(*shape, dtype=dtype)
    rates = RANDOM.normal(size=(2, *shape, 3)).astype(dtype)
    pairs = [
        (kinematics.forward, kinematics.forward_numpy, (positions, rotations)),
        (kinematics.local, kinematics.local_numpy, (positions, rotations)),
        (kinematics.forward_velocities, kinematics.forward_velocities_numpy, (positions, rotations, *rates)),
    ]
    for fast, obvious, arguments in pairs:
        for a, b in zip(fast(skeleton, *arguments), obvious(skeleton, *arguments), strict=True):
            assert a.dtype == dtype and a.shape == b.shape
            np.testing.assert_allclose(a, b, atol=tolerance)


def test_views_that_are_not_contiguous_are_read_right():
    skeleton = rig()
    positions, rotations = pose(6, 9)
    a = kinematics.forward(skeleton, positions[::2], rotations[::2])
    b = kinematics.forward(skeleton, positions, rotations)
    np.testing.assert_array_equal(a[0], b[0][::2])
    np.testing.assert_array_equal(a[1], b[1][::2])


def test_local_inverts_forward():
    skeleton = rig()
    positions, rotations = pose(5, 9)
    back = kinematics.local(skeleton, *kinematics.forward(skeleton, positions, rotations))
    np.testing.assert_allclose(back[0], positions, atol=1e-12)
    assert quat.angle_between(back[1], rotations).max() < 1e-7


def test_world_velocities_are_the_derivatives_of_world_positions():
    skeleton, fps = rig(), 1000.0
    time = np.arange(400)[:, None, None] / fps
    positions = np.sin(time * RANDOM.uniform(0.5, 2, (1, 9, 3)) + RANDOM.normal(size=(1, 9, 3)))
    rotations = quat.exp(np.sin(time * RANDOM.uniform(0.5, 2, (1, 9, 3))))
    velocities = kinematics.velocities(positions, fps)
    angular = kinematics.angular_velocities(rotations, fps)
    pos, rot, vel, ang = kinematics.forward_velocities(skeleton, positions, rotations, velocities, angular)
    np.testing.assert_allclose(vel[1:-1], (pos[2:] - pos[:-2]) * fps / 2, atol=1e-3)
    np.testing.assert_allclose(ang[1:-1], kinematics.angular_velocities(rot, fps)[1:-1], atol=1e-3)


def test_angular_velocity_of_a_steady_turn():
    axis = np.array([0.0, 0.6, 0.8])
    rotations = quat.from_axis_angle(axis, np.arange(30) * 0.1)[:, None]
    rates = kinematics.angular_velocities(rotations, 60.0)
    np.testing.assert_allclose(rates, np.broadcast_to(6.0 * axis, (30, 1, 3)), atol=1e-9)
    np.testing.assert_allclose(kinematics.angular_velocities_numpy(rotations, 60.0), rates, atol=1e-12)
    np.testing.assert_allclose(kinematics.angular_velocities(-rotations, 60.0), rates, atol=1e-9)
    assert kinematics.angular_velocities(rotations[:, 0], 60.0).shape == (30, 3)


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 4, 10])
def test_velocities_of_clips_of_any_length(frames):
    positions = np.arange(frames)[:, None] * np.array([[1.0, -2.0, 0.5]])
    rates = kinematics.velocities(positions, 30.0)
    assert rates.shape == positions.shape
    if frames > 1:
        np.testing.assert_allclose(rates, np.broadcast_to([30.0, -60.0, 15.0], (frames, 3)), atol=1e-9)


def test_velocities_at_the_ends_continue_the_acceleration():
    time = np.arange(10) / 60
    rates = kinematics.velocities((time**2)[:, None], 60.0)[:, 0]
    np.testing.assert_allclose(rates, 2 * time, atol=1e-9)


def test_unroll_is_the_numpy_one():
    _, rotations = pose(50, 9)
    given = rotations.copy()
    np.testing.assert_array_equal(kinematics.unroll(rotations), quat.unroll(rotations))
    np.testing.assert_array_equal(rotations, given)
