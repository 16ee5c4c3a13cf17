"""Rigs of any size: complete, deterministic, and with the roles where they were."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic

from motion import bvh, contacts, rig, sources
from motion.clip import Clip
from motion.errors import UserError


@pytest.mark.parametrize("joints", [22, 23, 60, 191, 400])
def test_it_has_as_many_joints_as_asked_for(joints):
    small = synthetic.skeleton()
    large = rig.enlarge(small, joints)
    assert len(large) == len(set(large.names)) == joints
    assert {role: large.names[j] for role, j in large.roles.items()} == {
        role: small.names[j] for role, j in small.roles.items()
    }
    for j, name in enumerate(small.names):
        k = large.index(name)
        np.testing.assert_array_equal(large.offsets[k], small.offsets[j])
        if j:
            assert large.names[large.parents[k]] == small.names[small.parents[j]]
    assert np.linalg.norm(large.offsets, axis=-1)[1:].max() < 0.5
    again = rig.enlarge(small, joints)
    assert again.names == large.names
    np.testing.assert_array_equal(again.offsets, large.offsets)


def test_it_has_what_rigs_of_games_have():
    names = rig.enlarge(synthetic.skeleton()).names
    for word in ("Index3", "Pinky1", "Jaw", "Eyelid", "Twist", "Corrective", "IkTarget", "IkPole", "Muscle"):
        assert any(word in name for name in names), word
    sides = [sum(name.startswith(side) for name in names) for side in ("Left", "Right")]
    assert abs(sides[0] - sides[1]) <= 1


def test_what_touches_the_ground_stays(walker):
    small = walker.skeleton
    large = rig.enlarge(small)
    roles = contacts.contact_roles(small)
    (a, p), (b, q) = contacts.touching_points(small, roles), contacts.touching_points(large, roles)
    assert [small.names[j] for j in a] == [large.names[j] for j in b]
    np.testing.assert_array_equal(p, q)


def test_a_file_of_it_has_the_same_roles(tmp_path):
    large = rig.enlarge(synthetic.skeleton())
    still = np.zeros((2, len(large), 4))
    still[..., 0] = 1
    bvh.write(tmp_path / "rig.bvh", Clip("rig", large, 60.0, np.tile(large.offsets, (2, 1, 1)), still))
    read = sources.load(tmp_path / "rig.bvh").skeleton
    assert read.names == large.names
    assert dict(read.roles) == dict(large.roles)


@pytest.mark.parametrize(
    "file",
    [
        "pfnn/animations/LocomotionFlat04_000.bvh",
        "cmu/daz_bvh/02/02_01.bvh",
        "dog_mann/D1_007_KAN01_001.bvh",
    ],
)
def test_real_skeletons_keep_their_feet_and_paws(data, file):
    small = sources.load(data / file).skeleton
    large = rig.enlarge(small)
    assert len(large) == 191
    for role in ("left_foot", "right_hand", "left_toe"):
        if role in small.roles:
            (a,), p = contacts.touching_points(small, [role])
            (b,), q = contacts.touching_points(large, [role])
            assert small.names[a] == large.names[b]
            np.testing.assert_array_equal(p, q)


def test_a_rig_smaller_than_the_skeleton_is_refused():
    with pytest.raises(UserError, match="ask for 22 or more"):
        rig.enlarge(synthetic.skeleton(), 10)
