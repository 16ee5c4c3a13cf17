"""Other axes and units: against what a character's left, up and forward become."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion import axes, kinematics, quat
from motion.axes import Convention
from motion.errors import UserError
from motion.pose import Poses

CHOICES = [
    (u, f, h) for u, f in itertools.product(axes.AXES, repeat=2) if u[-1] != f[-1] for h in axes.HANDEDNESS
]


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def vector(name):
    return np.array([("xyz"[i] == name[-1]) * (-1.0 if name[0] == "-" else 1.0) for i in range(3)])


@pytest.mark.parametrize(("up", "forward", "handedness"), CHOICES)
def test_world_positions_in_every_system(walker, up, forward, handedness):
    out = axes.convert(walker, up=up, forward=forward, handedness=handedness, scale=100.0)
    ours, theirs = world(walker)[::30], world(out)[::30]
    np.testing.assert_allclose(theirs @ vector(up), 100 * ours[..., 1], atol=1e-9)
    np.testing.assert_allclose(theirs @ vector(forward), 100 * ours[..., 2], atol=1e-9)
    left = np.cross(vector(up), vector(forward)) * (1 if handedness == "right" else -1)
    np.testing.assert_allclose(theirs @ left, 100 * ours[..., 0], atol=1e-9)
    back = axes.convert(out, up=up, forward=forward, handedness=handedness, scale=100.0, inverse=True)
    np.testing.assert_allclose(back.positions, walker.positions, atol=1e-12)
    np.testing.assert_allclose(back.rotations, walker.rotations, atol=1e-12)
    np.testing.assert_allclose(back.skeleton.offsets, walker.skeleton.offsets, atol=1e-12)
    for joint, end in walker.skeleton.end_sites.items():
        np.testing.assert_allclose(back.skeleton.end_sites[joint], end, atol=1e-12)


def test_our_own_axes_change_nothing(walker):
    same = axes.convert(walker)
    np.testing.assert_array_equal(same.positions, walker.positions)
    np.testing.assert_allclose(same.rotations, walker.rotations, atol=1e-15)


def test_systems_in_use(walker):
    """Unreal: left-handed, Z up, +X forward, right is +Y; Blender: Z up, -Y forward, left is +X."""
    np.testing.assert_array_equal(axes.basis("z", "x", "left")[:, 0], [0, -1, 0])
    np.testing.assert_array_equal(axes.basis("z", "-y", "right")[:, 0], [1, 0, 0])
    np.testing.assert_array_equal(axes.basis("+y", "+z", "right"), np.eye(3))


@given(st.sampled_from(CHOICES))
def test_bases_are_orthonormal(choice):
    matrix = axes.basis(*choice)
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    assert np.linalg.det(matrix) == (1 if choice[2] == "right" else -1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"up": "w"}, "unknown axis 'w'.*x, y, z"),
        ({"up": "z"}, "lie along one axis"),
        ({"up": "z", "forward": "-z"}, "lie along one axis"),
        ({"handedness": "both"}, "right or left"),
    ],
)
def test_bad_axes(walker, change, message):
    with pytest.raises(UserError, match=message):
        axes.convert(walker, **change)


CONVENTIONS = {
    "ours": Convention(),
    "Blender": Convention(up="z", forward="-y"),
    "Unity": Convention(handedness="left"),
    "Unreal": Convention(up="z", forward="x", handedness="left", scale=100.0),
    "odd": Convention(up="-x", forward="z", handedness="left", scale=0.5),
}


@pytest.fixture(params=CONVENTIONS.values(), ids=CONVENTIONS.keys())
def convention(request):
    return request.param


def test_poses_and_their_rates_transform_as_matrices_say(walker, convention):
    poses = Poses.of_clip(walker)
    out = convention.poses_to(poses)
    b, scale = axes.basis(convention.up, convention.forward, convention.handedness), convention.scale
    sign = np.linalg.det(b)
    assert sign == pytest.approx(1 if convention.handedness == "right" else -1)
    local = quat.to_matrix(poses.rotations.astype(np.float64))
    np.testing.assert_allclose(quat.to_matrix(out.rotations.astype(np.float64)), b @ local @ b.T, atol=1e-6)
    np.testing.assert_allclose(out.positions, scale * poses.positions @ b.T, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(out.velocities, scale * poses.velocities @ b.T, rtol=1e-5, atol=1e-4)
    # dR/dt = [w]x R holds there too, which is what an angular velocity is.
    clip = convention.clip_to(walker)
    rates = kinematics.angular_velocities(clip.rotations, clip.fps)
    np.testing.assert_allclose(out.angular_velocities, rates, atol=1e-3)
    world = kinematics.forward(clip.skeleton, out.positions, out.rotations)[0]
    ours = kinematics.forward(walker.skeleton, walker.positions, walker.rotations)[0]
    np.testing.assert_allclose(world, scale * ours @ b.T, rtol=1e-4, atol=1e-4 * scale)


def test_poses_come_back_and_may_change_in_place(walker, convention):
    poses = Poses.of_clip(walker)
    there = convention.poses_to(poses)
    back = convention.poses_from(there)
    for name, array in poses.arrays().items():
        np.testing.assert_allclose(back.arrays()[name], array, rtol=1e-5, atol=1e-5)
        assert there.arrays()[name].dtype == np.float32
    same = poses.copy()
    assert convention.poses_to(same, same) is same
    np.testing.assert_array_equal(same.rotations, there.rotations)


def test_commands_come_in_as_the_consumer_sees_them(convention):
    b = axes.basis(convention.up, convention.forward, convention.handedness)
    yaw = np.linspace(-3, 3, 13)
    facing = np.stack([np.sin(yaw), 0 * yaw, np.cos(yaw)], axis=-1)  # ours: 0 faces +Z, pi/2 the left
    theirs = convention.ground_to(facing[:, [0, 2]])
    np.testing.assert_allclose(theirs, convention.scale * facing @ b.T, atol=1e-12)
    np.testing.assert_allclose(convention.ground_from(theirs), facing[:, [0, 2]], atol=1e-12)
    heights = theirs + 3 * convention.ground_to([0.0, 0.0]) + b[:, 1]
    np.testing.assert_allclose(convention.ground_from(heights), facing[:, [0, 2]], atol=1e-12)
    # Their yaw turns their forward axis about their up axis by the formula that every handedness shares.
    about, turned = b[:, 1], convention.yaw_to(yaw)[:, None]
    rotated = b[:, 2] * np.cos(turned) + np.cross(about, b[:, 2]) * np.sin(turned)
    np.testing.assert_allclose(rotated * convention.scale, theirs, atol=1e-12)
    np.testing.assert_allclose(convention.yaw_from(convention.yaw_to(yaw)), yaw)


def test_left_handed_axes_turn_right_for_positive_angles():
    assert CONVENTIONS["Unity"].yaw_to(0.5) == -0.5
    assert CONVENTIONS["Blender"].yaw_to(0.5) == 0.5
    # In Unity's axes the right is +x, in Unreal's +y.
    np.testing.assert_allclose(CONVENTIONS["Unity"].ground_to([-1.0, 0.0]), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(CONVENTIONS["Unreal"].ground_to([-1.0, 0.0]), [0, 100, 0], atol=1e-12)


def test_a_convention_without_sense_is_refused():
    with pytest.raises(UserError, match="lie along one axis"):
        Convention(up="z", forward="-z")
    with pytest.raises(UserError, match="scale of 0"):
        Convention(scale=0)
