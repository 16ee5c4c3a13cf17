"""Fewer joints, flat skeletons of roles, and other bone lengths."""

import dataclasses

import numpy as np
import pytest

from motion import contacts, kinematics, quat, root, sources, subset
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def test_world_transforms_of_the_kept_joints_stay(walker):
    kept = ["Hips", "Spine2", "Head", "LeftFoot", "LeftToe", "RightHand"]
    small = subset.subset(walker, kept)
    index = [walker.skeleton.index(name) for name in small.skeleton.names]
    assert sorted(small.skeleton.names) == sorted(kept)
    for ours, theirs in zip(world(small), world(walker), strict=True):
        np.testing.assert_allclose(np.abs(ours), np.abs(theirs[:, index]), atol=1e-9)
    np.testing.assert_allclose(world(small)[0], world(walker)[0][:, index], atol=1e-9)
    toe = small.skeleton.index("LeftToe")
    assert (
        small.skeleton.parents[toe] == small.skeleton.index("LeftFoot") == small.skeleton.roles["left_foot"]
    )
    assert list(small.skeleton.end_sites) == [toe]
    rest = world(walker.replace(positions=walker.skeleton.offsets[None], rotations=quat.identity(1, 22)))[0][
        0
    ]
    small_rest = kinematics.forward(small.skeleton, small.skeleton.offsets, quat.identity(6))[0]
    np.testing.assert_allclose(small_rest, rest[index], atol=1e-9)


def test_joint_0_may_go_if_one_joint_stands_above_the_rest(walker):
    arm = subset.subset(walker, ["LeftArm", "LeftForeArm", "LeftHand"])
    np.testing.assert_allclose(
        world(arm)[0][:, 0], world(walker)[0][:, walker.skeleton.index("LeftArm")], atol=1e-9
    )
    with pytest.raises(UserError, match=r"above LeftFoot and RightFoot.*keep Hips"):
        subset.subset(walker, ["LeftFoot", "RightFoot"])


def test_bad_subsets(walker):
    with pytest.raises(UserError, match=r"no joint 'Paw'.*LeftToe"):
        subset.subset(walker, ["Hips", "Paw"])
    with pytest.raises(UserError, match="no joints to keep"):
        subset.subset(walker, [])


def test_roles_only_is_flat_and_in_root_space(walker):
    grounded = root.ground(walker)
    wanted = ["hips", "left_foot", "right_hand"]
    flat = subset.roles_only(walker, wanted)
    assert flat.skeleton.names == ("root", *wanted)
    assert flat.skeleton.parents.tolist() == [-1, 0, 0, 0]
    np.testing.assert_allclose(flat.positions[:, 0], grounded.positions[:, 0], atol=1e-12)
    for role in wanted:
        ours = world(flat)[0][:, flat.skeleton.roles[role]]
        np.testing.assert_allclose(ours, world(walker)[0][:, walker.skeleton.roles[role]], atol=1e-9)
    np.testing.assert_array_equal(subset.roles_only(grounded, wanted).positions, flat.positions)
    with pytest.raises(UserError, match=r"'left_toe'.*LeftToe"):
        subset.roles_only(
            walker.replace(
                skeleton=walker.skeleton.with_roles({"hips": 0, "left_up_leg": 1, "right_up_leg": 5})
            ),
            ["left_toe"],
        )


def test_roles_only_makes_one_skeleton_of_many_rigs(data):
    names = [
        "cmu/daz_bvh/02/02_01.bvh",
        "lafan1/original_30fps/obstacles1_subject2.bvh",
        "dog_mann/D1_010_KAN01_002.bvh",
    ]
    clips = [
        subset.roles_only(sources.load(data / name), ["hips", "left_foot", "right_foot"]) for name in names
    ]
    assert all(clip.skeleton.same_joints(clips[0].skeleton) for clip in clips)


def directions(clip, names):
    positions, skeleton = world(clip)[0], clip.skeleton
    joints = [skeleton.index(name) for name in names]
    bones = positions[:, joints] - positions[:, skeleton.parents[joints]]
    return bones / np.linalg.norm(bones, axis=-1, keepdims=True), np.linalg.norm(bones, axis=-1)


LIMBS = [f"{side}{part}" for side in ("Left", "Right") for part in ("Leg", "Foot", "Toe", "ForeArm", "Hand")]


def taller(skeleton, factor=1.5):
    longer = np.array([factor if "Leg" in n or "Foot" in n or "Arm" in n else 1.1 for n in skeleton.names])
    return dataclasses.replace(skeleton, offsets=skeleton.offsets * longer[:, None])


def test_fit_keeps_directions_and_takes_lengths(walker):
    target = taller(walker.skeleton)
    fitted = subset.fit(walker, target)
    before, _ = directions(walker, LIMBS)
    after, lengths = directions(fitted, LIMBS)
    np.testing.assert_allclose(after, before, atol=1e-9)
    own = np.linalg.norm(target.offsets[[target.index(n) for n in LIMBS]], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(own, lengths.shape), atol=1e-9)
    travel = fitted.positions[:, 0] - 1.5 * walker.positions[:, 0]
    np.testing.assert_allclose(travel - travel[0], 0, atol=1e-9)
    np.testing.assert_allclose(travel[0, ::2], 0, atol=1e-9)
    assert fitted.skeleton is target


@pytest.mark.parametrize("factor", [0.85, 1.15])
@pytest.mark.parametrize("put", [lambda clip: clip, root.ground])
def test_toes_stand_as_high_where_only_legs_are_longer(walker, factor, put):
    clip = put(walker)
    skeleton = clip.skeleton
    longer = np.array([factor if name.endswith(("Leg", "tFoot")) else 1.0 for name in skeleton.names])
    fitted = subset.fit(clip, dataclasses.replace(skeleton, offsets=skeleton.offsets * longer[:, None]))
    standing = contacts.contacts(clip) != 0
    toes = [skeleton.roles[f"{side}_toe"] for side in ("left", "right")]
    rise = (world(fitted)[0] - world(clip)[0])[:, toes, 1][standing]
    assert abs(np.median(rise)) < 1e-6 and np.abs(rise).max() < 0.001  # by the legs alone it would be 2 cm
    assert np.std(world(fitted)[0][:, toes, 1][standing]) < 0.01


@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_a_larger_skeleton_makes_a_larger_motion(walker, factor):
    target = dataclasses.replace(walker.skeleton, offsets=factor * walker.skeleton.offsets)
    np.testing.assert_allclose(world(subset.fit(walker, target))[0], factor * world(walker)[0], atol=1e-9)


def test_fit_to_other_rest_directions(walker):
    """A rig in another rest pose (arms out) moves its bones as the walker's."""
    skeleton = walker.skeleton
    turns = quat.identity(len(skeleton))
    for side, angle in (("Left", np.pi / 2), ("Right", -np.pi / 2)):
        for part in ("Arm", "ForeArm", "Hand"):
            turns[skeleton.index(side + part)] = quat.from_axis_angle([0.0, 0.0, 1.0], angle)
    above = np.maximum(skeleton.parents, 0)
    target = dataclasses.replace(skeleton, offsets=quat.rotate(turns[above], skeleton.offsets))
    fitted = subset.fit(walker, target)
    np.testing.assert_allclose(world(fitted)[0], world(walker)[0], atol=1e-9)


def test_fit_to_itself_and_back(walker):
    same = subset.fit(walker, walker.skeleton)
    np.testing.assert_allclose(world(same)[0], world(walker)[0], atol=1e-9)
    back = subset.fit(
        subset.fit(root.ground(walker), root.ground(walker).skeleton), root.ground(walker).skeleton
    )
    np.testing.assert_allclose(world(back)[0][:, 1:], world(walker)[0], atol=1e-9)


def test_fit_of_real_clips_keeps_feet_near_the_ground(data):
    files = sorted((data / "cmu/asfamc").glob("*/*_01.amc"))
    target = root.ground(sources.load(files[0])).skeleton
    for file in files[1:]:
        clip = root.ground(sources.load(file))
        fitted = subset.fit(clip, target)
        feet = [target.roles[f"{side}_foot"] for side in ("left", "right")]
        ratio = subset.leg_length(target, target.offsets) / subset.leg_length(
            clip.skeleton, clip.skeleton.offsets
        )
        low, was = (np.percentile(world(c)[0][:, feet, 1], 5) for c in (fitted, clip))
        assert abs(low - ratio * was) < 0.03
        turned = quat.angle_between(world(fitted)[1], world(clip)[1])
        assert np.degrees(turned.max()) < 60, "no joint is twisted: rest poses differ by less"


def test_bones_in_a_line_are_not_twisted_by_a_fit():
    """A thorax whose three children start at one point, as in CMU's skeletons, turns by its lean alone."""
    names, parents = ("Hips", "Thorax", "Left", "Right", "Neck"), np.array([-1, 0, 1, 1, 1], np.int32)
    offsets = np.array([[0, 1, 0], [0, 0.3, 0], *[[0.003, 0.123, 0.005]] * 3])
    skeleton = Skeleton(names, parents, offsets, {"hips": 0})
    leaning = offsets.copy()
    leaning[2:] = [0.0, 0.113, -0.006]
    rotations = quat.identity(4, 5)
    clip = Clip("a", skeleton, 30.0, np.repeat(leaning[None], 4, axis=0), rotations)
    fitted = subset.fit(clip, skeleton)
    turned = quat.angle_between(quat.identity(4), fitted.rotations[:, 1])
    lean = np.arccos(leaning[2] @ offsets[2] / np.linalg.norm(leaning[2]) / np.linalg.norm(offsets[2]))
    np.testing.assert_allclose(turned, lean, atol=1e-9)


def test_another_skeleton_does_not_fit(walker):
    names = tuple(name.replace("Toe", "Ball") for name in walker.skeleton.names)
    with pytest.raises(UserError, match=r"lacks LeftBall, RightBall and has also LeftToe, RightToe"):
        subset.fit(walker, dataclasses.replace(walker.skeleton, names=names))
    parents = walker.skeleton.parents.copy()
    parents[-1] = 0
    with pytest.raises(UserError, match="another hierarchy"):
        subset.fit(walker, dataclasses.replace(walker.skeleton, parents=parents))
