"""Other axes and units: against what a character's left, up and forward become."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion import axes, kinematics
from motion.errors import UserError

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
