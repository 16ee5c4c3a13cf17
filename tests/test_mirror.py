"""Mirroring against files that others mirrored, and against reflection itself."""

import dataclasses

import numpy as np
import pytest

from motion import kinematics, mirror, quat, root, sources
from motion.errors import UserError
from motion.skeleton import Skeleton

REAL = [
    "bandai/dataset-1/dataset-1_run_normal_001.bvh",
    "cmu/daz_bvh/02/02_01.bvh",
    "cmu/asfamc/02/02_01.amc",
    "pfnn/animations/NewCaptures10_000.bvh",
    "lafan1/original_30fps/obstacles1_subject2.bvh",
    "lafan1/mirror_oracle/walk1_subject1_walk2_mirror_filtered.bvh",
    "dog_mann/D1_010_KAN01_002.bvh",
]
FLIP = np.array([-1.0, 1.0, 1.0])
HALF_TURN = quat.from_yaw(np.pi)


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def check_reflection(clip):
    mirrored = mirror.mirror(clip)
    twins = mirror.pairs(clip.skeleton)
    np.testing.assert_array_equal(twins[twins], np.arange(len(twins)))
    np.testing.assert_allclose(world(mirrored)[0], world(clip)[0][:, twins] * FLIP, atol=1e-9)
    again = mirror.mirror(mirrored)
    np.testing.assert_allclose(again.positions, clip.positions, atol=1e-9)
    assert quat.angle_between(again.rotations, clip.rotations).max() < 1e-7
    assert np.all(np.sum(mirrored.rotations[1:] * mirrored.rotations[:-1], axis=-1) > -1e-9)
    return mirrored


@pytest.mark.parametrize("name", REAL)
def test_real_rigs_are_reflected(data, name):
    clip = sources.load(data / name)
    check_reflection(clip)
    grounded = root.ground(clip)
    mirrored = check_reflection(grounded)
    # Grounding and mirroring commute: the root is mirrored, not put elsewhere.
    other = root.ground(mirror.mirror(clip))
    np.testing.assert_allclose(other.positions[:, 0], mirrored.positions[:, 0], atol=1e-6)
    assert quat.angle_between(other.rotations[:, 0], mirrored.rotations[:, 0]).max() < 1e-4


def test_equals_the_mirrored_twin_of_another_tool(data):
    """The oracle negated z where we negate x: half a turn about Y lies between. Frames must agree as well."""
    clip = sources.load(data / "lafan1/locomotion_60fps/walk1_subject1_walk2_filtered.bvh")
    twin = sources.load(data / "lafan1/mirror_oracle/walk1_subject1_walk2_mirror_filtered.bvh")
    positions, rotations = world(mirror.mirror(clip))
    twin_positions, twin_rotations = world(twin)
    np.testing.assert_allclose(positions * [-1, 1, -1], twin_positions, atol=1e-5)
    assert quat.angle_between(quat.mul(HALF_TURN, rotations), twin_rotations).max() < 1e-4


def test_resembles_the_mirrored_twin_of_an_asymmetric_person(data):
    folder = data / "pfnn/animations"
    ours = world(mirror.mirror(sources.load(folder / "LocomotionFlat09_000.bvh")))[0]
    theirs = world(sources.load(folder / "LocomotionFlat09_000_mirror.bvh"))[0]
    distance = np.linalg.norm(ours - theirs, axis=-1)
    assert distance.mean() < 0.006 and distance.max() < 0.03


def difference(clips, mirrored):
    """Angle [J] (degrees) between the mean local rotations of clips and of their mirrored copies."""
    means = []
    for group in (clips, mirrored):
        moment = sum(np.einsum("tji,tjk->jik", clip.rotations, clip.rotations) for clip in group)
        means.append(np.linalg.eigh(moment)[1][:, :, -1])
    return np.degrees(quat.angle_between(*means))


COLLECTIONS = {
    "bandai/dataset-1": 8,
    "bandai/dataset-2": 8,
    "dog_mann": 8,
    "lafan1/locomotion_60fps": 6,
    "cmu/asfamc": 6,
    "cmu/daz_bvh": 6,
}


@pytest.mark.parametrize("folder", COLLECTIONS)
def test_mirrored_joints_turn_about_where_they_did(data, folder):
    """Blends between clips and mirrored copies do not turn joints over."""
    files = sources.find(data / folder)
    clips = [root.ground(sources.load(file)) for file in files[:: len(files) // COLLECTIONS[folder]]]
    plans = mirror.plans(clips)
    assert all(plan is plans[0] for plan in plans)
    apart = difference(clips, [mirror.mirror(*pair) for pair in zip(clips, plans, strict=True)])[1:]
    assert apart.max() < 45, clips[0].skeleton.names[1 + int(apart.argmax())]
    for clip in clips:  # a plan of its own, of few frames, turns no joint over either
        assert difference([clip], [mirror.mirror(clip)])[1:].max() < 100


def test_clips_of_the_same_joints_share_a_plan(walker, walker_clips):
    bare = walker.replace(skeleton=walker.skeleton.with_roles({"hips": 0}))
    taller = walker.replace(
        skeleton=dataclasses.replace(walker.skeleton, offsets=1.1 * walker.skeleton.offsets)
    )
    plans = mirror.plans([walker, bare, walker_clips[0], taller])
    assert plans[0] is plans[2] is plans[3] and plans[0] is not plans[1]
    assert mirror.plans([]) == []


def test_a_stub_of_an_end_site_does_not_turn_a_joint_over(walker):
    skeleton = walker.skeleton
    hands = [skeleton.index(f"{side}Hand") for side in ("Left", "Right")]
    ends = {**skeleton.end_sites, **dict.fromkeys(hands, np.array([0.01, 0.0, 0.0]))}
    clip = walker.replace(skeleton=dataclasses.replace(skeleton, end_sites=ends))
    assert difference([clip], [mirror.mirror(clip)])[hands].max() < 1


def test_the_walker(walker):
    mirrored = check_reflection(walker)
    assert mirrored.skeleton is walker.skeleton
    left, right = (walker.skeleton.roles[f"{side}_leg"] for side in ("left", "right"))
    np.testing.assert_allclose(mirrored.rotations[:, left], walker.rotations[:, right], atol=1e-12)


def rebased(clip, frames):
    """The same motion on a rig whose joints' local frames are turned by constant rotations [J, 4]."""
    skeleton = clip.skeleton
    positions, rotations = world(clip)
    local = kinematics.local(skeleton, positions, quat.mul(rotations, frames))
    offsets = quat.rotate(quat.inv(frames[np.maximum(skeleton.parents, 0)]), skeleton.offsets)
    offsets[0] = skeleton.offsets[0]
    ends = {j: quat.rotate(quat.inv(frames[j]), end) for j, end in skeleton.end_sites.items()}
    rig = dataclasses.replace(skeleton, offsets=offsets, end_sites=ends)
    return clip.replace(skeleton=rig, positions=local[0], rotations=quat.unroll(local[1]))


def test_rigs_whose_frames_are_no_mirror_images(walker):
    skeleton = walker.skeleton
    turns = {
        "all alike": np.tile(
            quat.from_euler(np.array([0.0, np.pi / 2, np.pi / 2]), "xyz"), (len(skeleton), 1)
        ),
        "right side turned over": quat.identity(len(skeleton)),
        "anyhow": quat.normalize(np.random.default_rng(5).normal(size=(len(skeleton), 4))),
    }
    for j, name in enumerate(skeleton.names):
        if name.startswith("Right"):
            turns["right side turned over"][j] = [0, 0, 0, 1]
    for frames in turns.values():
        clip = rebased(walker, frames)
        np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-9)
        twins = mirror.pairs(clip.skeleton)
        mirrored = mirror.mirror(clip)
        np.testing.assert_allclose(world(mirrored)[0], world(clip)[0][:, twins] * FLIP, atol=1e-6)
        inner = np.isin(np.arange(len(skeleton)), skeleton.parents)
        apart = difference([root.ground(clip)], [mirror.mirror(root.ground(clip))])[1:]
        assert apart[inner].max() < 10
        again = mirror.mirror(mirrored)
        assert quat.angle_between(again.rotations, clip.rotations).max() < 1e-6


def test_a_joint_without_twin_keeps_its_place_in_its_parent(walker):
    skeleton = walker.skeleton
    hand = skeleton.index("RightHand")
    rig = Skeleton(
        (*skeleton.names, "Sword"),
        np.append(skeleton.parents, hand),
        np.concatenate([skeleton.offsets, [[0.0, -0.1, 0.0]]]),
        skeleton.roles,
    )
    sword = np.broadcast_to([[[0.0, -0.1, 0.0]]], (len(walker), 1, 3))
    turn = np.broadcast_to(quat.from_yaw(0.3), (len(walker), 1, 4))
    clip = walker.replace(
        skeleton=rig,
        positions=np.concatenate([walker.positions, sword], axis=1),
        rotations=np.concatenate([walker.rotations, turn], axis=1),
    )
    mirrored = mirror.mirror(clip)
    np.testing.assert_array_equal(mirrored.positions[:, -1], sword[:, 0])
    np.testing.assert_array_equal(mirrored.rotations[:, -1], turn[:, 0])


def test_joints_pair_by_place_where_names_and_roles_are_silent(walker):
    skeleton = walker.skeleton
    names = tuple(f"b{i}" for i in range(len(skeleton)))
    roles = {
        r: j
        for r, j in skeleton.roles.items()
        if r in ("hips", "left_up_leg", "right_up_leg", "left_arm", "right_arm")
    }
    twins = mirror.pairs(dataclasses.replace(skeleton, names=names, roles=roles))
    for left, right in (("LeftToe", "RightToe"), ("LeftHand", "RightHand")):
        assert twins[skeleton.index(left)] == skeleton.index(right)


def test_a_skeleton_without_sides_cannot_be_mirrored(walker):
    chain = Skeleton(("a", "b"), np.array([-1, 0]), np.ones((2, 3)))
    clip = walker.replace(
        skeleton=chain, positions=walker.positions[:, :2], rotations=walker.rotations[:, :2]
    )
    with pytest.raises(UserError, match=r"no joint has a twin.*a, b"):
        mirror.mirror(clip)
