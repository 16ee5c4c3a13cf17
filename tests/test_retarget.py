"""Retargeting against what must come out: the same motion, a scaled one, the same bones in the world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic
from test_anatomy import twisted

from motion import contacts, kinematics, leadin, quat, rig, root, sources
from motion.anatomy import anatomy
from motion.clip import Clip
from motion.errors import UserError
from motion.retarget import plan, retarget
from motion.skeleton import Skeleton

BONES = (("up_leg", "leg"), ("leg", "foot"), ("arm", "forearm"), ("forearm", "hand"))


def world(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def directions(clip: Clip) -> dict[str, np.ndarray]:
    """World directions [T, 3] of the limbs' bones and of the trunk, by role."""
    positions, roles = world(clip)[0], clip.skeleton.roles
    pairs = [(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in BONES]
    bones = {a: positions[:, roles[b]] - positions[:, roles[a]] for a, b in [*pairs, ("hips", "chest")]}
    return {name: bone / np.linalg.norm(bone, axis=-1, keepdims=True) for name, bone in bones.items()}


def degrees_apart(a: Clip, b: Clip) -> dict[str, float]:
    """Mean angle between the same bones."""
    ours, theirs = directions(a), directions(b)
    cosines = {name: np.sum(ours[name] * theirs[name], axis=-1) for name in ours}
    return {name: float(np.degrees(np.arccos(np.clip(c, -1, 1))).mean()) for name, c in cosines.items()}


def slides(clip: Clip, resting: np.ndarray) -> np.ndarray:
    """Metres from frame to frame of what touches the ground, where a foot rests before and after."""
    roles = contacts.contact_roles(clip.skeleton)
    touch = contacts.place_points(*world(clip), *contacts.touching_points(clip.skeleton, roles))
    moved = np.linalg.norm(np.diff(touch, axis=0), axis=-1)
    return moved[(resting[1:] != 0) & (resting[:-1] != 0)]


def stocky() -> Skeleton:
    """The synthetic humanoid with short legs of other proportions, wide hips, long arms and large feet."""
    skeleton = synthetic.skeleton()
    factors = {"leg": 0.8, "foot": 0.65, "toe": 1.15, "forearm": 1.3, "hand": 1.2, "up_leg": 1.4}
    offsets = skeleton.offsets.copy()
    for side in ("left", "right"):
        for part, factor in factors.items():
            offsets[skeleton.roles[f"{side}_{part}"]] *= factor
    return replace(skeleton, offsets=offsets)


def other_joints() -> Skeleton:
    """A humanoid of other joints: one for the spine, two necks, no collar bones, twists, one above all."""
    rows = [
        ("reference", "", (0, 0, 0), ""),
        ("pelvis", "reference", (0, 1.0, 0), "hips"),
        ("belly", "pelvis", (0, 0.25, 0), "chest"),
        ("neck_lower", "belly", (0, 0.3, 0), "neck"),
        ("neck_upper", "neck_lower", (0, 0.05, 0.01), ""),
        ("skull", "neck_upper", (0, 0.05, 0.01), "head"),
        ("jaw", "skull", (0, 0.02, 0.08), ""),
    ]
    for side, s in (("left", 1), ("right", -1)):
        rows += [
            (f"{side}_thigh", "pelvis", (0.1 * s, -0.02, 0), f"{side}_up_leg"),
            (f"{side}_thigh_twist", f"{side}_thigh", (0, -0.2, 0), ""),
            (f"{side}_shin", f"{side}_thigh_twist", (0.02 * s, -0.25, 0.01), f"{side}_leg"),
            (f"{side}_ankle", f"{side}_shin", (0, -0.4, -0.02), f"{side}_foot"),
            (f"{side}_ball", f"{side}_ankle", (0.01 * s, -0.08, 0.15), f"{side}_toe"),
            (f"{side}_upperarm", "belly", (0.2 * s, 0.2, 0), f"{side}_arm"),
            (f"{side}_elbow", f"{side}_upperarm", (0.3 * s, 0, 0), f"{side}_forearm"),
            (f"{side}_wrist", f"{side}_elbow", (0.27 * s, 0, 0), f"{side}_hand"),
            (f"{side}_finger", f"{side}_wrist", (0.1 * s, 0, 0), ""),
        ]
    names = [name for name, _, _, _ in rows]
    parents = [names.index(parent) if parent else -1 for _, parent, _, _ in rows]
    roles = {role: j for j, (_, _, _, role) in enumerate(rows) if role}
    return Skeleton(tuple(names), np.array(parents), np.array([o for _, _, o, _ in rows], float), roles)


def test_its_own_skeleton_gives_the_clip_back(walker):
    same = retarget(walker, walker.skeleton, feet=False)
    np.testing.assert_allclose(same.positions, walker.positions, atol=1e-12)
    np.testing.assert_allclose(world(same)[0], world(walker)[0], atol=1e-12)
    assert quat.angle_between(same.rotations, walker.rotations).max() < 1e-7


def test_exact_feet_stay_as_they_are(walker_clips):
    for clip in walker_clips:
        same = retarget(clip, clip.skeleton)
        # A foot counts as resting for the centimetre more by which it has left the ground slowly.
        assert np.abs(world(same)[0] - world(clip)[0]).max() < 0.02, clip.name


@pytest.mark.parametrize("feet", [False, True])
def test_a_skeleton_twice_as_large_makes_the_same_motion_twice_as_large(walker, feet):
    large = Skeleton(
        walker.skeleton.names,
        walker.skeleton.parents,
        2 * walker.skeleton.offsets,
        walker.skeleton.roles,
        {j: 2 * end for j, end in walker.skeleton.end_sites.items()},
    )
    small, big = retarget(walker, walker.skeleton, feet=feet), retarget(walker, large, feet=feet)
    np.testing.assert_allclose(world(big)[0], 2 * world(small)[0], atol=1e-6)


def test_other_names_and_axes_of_joints_make_the_same_motion_in_the_world(walker):
    other, stance = twisted(walker)
    names = tuple(f"j{j}" for j in range(len(walker.skeleton)))
    renamed = replace(other.skeleton, names=names)
    moved = retarget(walker, anatomy(renamed, stance=stance), feet=False)
    np.testing.assert_allclose(world(moved)[0], world(walker)[0], atol=1e-9)
    assert quat.angle_between(world(moved)[1], world(other)[1]).max() < 1e-6
    back = retarget(moved, walker.skeleton, source=anatomy(renamed, stance=stance), feet=False)
    assert quat.angle_between(back.rotations, walker.rotations).max() < 1e-6


def test_bones_point_where_they_did_and_keep_their_length(walker):
    moved = retarget(walker, stocky(), feet=False)
    assert max(degrees_apart(moved, walker).values()) < 1e-5
    np.testing.assert_allclose(moved.positions[:, 1:], np.tile(stocky().offsets[1:], (len(moved), 1, 1)))
    there = retarget(walker, other_joints(), feet=False)
    apart = degrees_apart(there, walker)
    assert apart.pop("hips") < 3  # its one bone stands for three that bend
    assert max(apart.values()) < 1e-5


def test_there_and_back_is_the_same_motion(walker):
    back = retarget(retarget(walker, stocky(), feet=False), walker.skeleton, feet=False)
    # But for the sole, which the motion between shows to a millimetre.
    np.testing.assert_allclose(world(back)[0], world(walker)[0], atol=1e-3)
    back = retarget(retarget(walker, other_joints(), feet=False), walker.skeleton, feet=False)
    apart = degrees_apart(back, walker)
    assert apart.pop("hips") < 3
    assert max(apart.values()) < 1e-5


def test_height_and_travel_go_with_the_legs(walker):
    moved = retarget(walker, stocky())
    mapping = plan(anatomy(walker.skeleton, [walker]), anatomy(stocky()))
    assert mapping.scale == pytest.approx((0.8 + 0.65) / 2, rel=1e-6)
    before, after = (world(clip)[0][:, 0] for clip in (walker, moved))
    travel = [np.linalg.norm(np.diff(p[:, [0, 2]], axis=0), axis=-1).sum() for p in (before, after)]
    assert travel[1] == pytest.approx(mapping.scale * travel[0], rel=1e-6)


def test_joints_without_a_source_follow_their_parents_rigidly(walker):
    large = rig.enlarge(stocky(), 191)
    moved = retarget(walker, large, feet=False)
    plain = retarget(walker, stocky(), feet=False)
    own = [large.index(name) for name in stocky().names]
    np.testing.assert_allclose(world(moved)[0][:, own], world(plain)[0], atol=1e-9)
    added = np.setdiff1d(np.arange(191), own)
    assert len(added) == 191 - 22
    assert quat.angle_between(moved.rotations[:, added], quat.identity()).max() < 1e-9
    np.testing.assert_array_equal(np.ptp(moved.positions[:, added], axis=0), 0)


@pytest.mark.parametrize("target", [stocky, other_joints])
@pytest.mark.parametrize("which", range(5))
def test_feet_stand_still_where_they_did(walker_clips, target, which):
    clip = walker_clips[which]
    resting = contacts.contacts(clip)
    moved = retarget(clip, target())
    assert slides(moved, resting).max() < 1e-4
    assert slides(moved, resting).max() <= slides(clip, resting).max() + 1e-6
    roles = contacts.contact_roles(moved.skeleton)
    touch = contacts.place_points(*world(moved), *contacts.touching_points(moved.skeleton, roles))
    heights = touch[..., 1][resting != 0]
    assert np.ptp(heights) < 1e-4
    assert touch[..., 1].min() > heights.mean() - 0.01
    # Knees bend no faster than the source's, but for the little that planting adds.
    knees = [[c.skeleton.roles[f"{side}_leg"] for side in ("left", "right")] for c in (clip, moved)]
    fastest = [
        quat.angle_between(c.rotations[1:, k], c.rotations[:-1, k]).max()
        for c, k in zip((clip, moved), knees, strict=True)
    ]
    assert fastest[1] < 1.6 * fastest[0] + np.radians(1)


def test_contacts_can_be_told(walker):
    none = np.zeros((len(walker), 2), np.uint8)
    free = retarget(walker, stocky(), feet=False)
    np.testing.assert_array_equal(retarget(walker, stocky(), planted=none).rotations, free.rotations)
    one = none.copy()
    one[:, 0] = synthetic.planted(walker, "walk")[:, 0]
    moved = retarget(walker, stocky(), planted=one)
    assert slides(moved, one).max() < 1e-4
    right = walker.skeleton.roles["right_toe"]
    after, before = (world(clip)[0][:, right] for clip in (moved, free))
    np.testing.assert_allclose(after[:, [0, 2]], before[:, [0, 2]], atol=5e-3)
    assert after[:, 1].min() > before[:, 1].min() + 0.01  # but no foot is left under the floor
    with pytest.raises(UserError, match=r"give \(300, 2\): left_toe, right_toe"):
        retarget(walker, stocky(), planted=none[:10])


def test_a_target_with_a_ground_root_gets_its_travel(walker):
    grounded = root.ground(walker)
    moved = retarget(walker, grounded.skeleton, feet=False)
    np.testing.assert_allclose(world(moved)[0], world(grounded)[0], atol=1e-9)
    assert quat.angle_between(world(moved)[1][:, 0], world(grounded)[1][:, 0]).max() < 1e-6
    again = retarget(grounded, grounded.skeleton, feet=False)
    np.testing.assert_allclose(world(again)[0], world(grounded)[0], atol=1e-9)
    np.testing.assert_allclose(world(retarget(grounded, walker.skeleton, feet=False))[0], world(walker)[0],
                               atol=1e-9)  # fmt: skip


def test_hips_and_spine_may_hang_side_by_side(walker):
    skeleton = other_joints()
    names = list(skeleton.names)
    parents, offsets = skeleton.parents.copy(), skeleton.offsets.copy()
    # A centre takes the pelvis' place, and the pelvis hangs on it without the spine.
    names[0] = "centre"
    parents[names.index("belly")] = 0
    offsets[names.index("belly")] += offsets[names.index("pelvis")]
    beside = Skeleton(tuple(names), parents, offsets, skeleton.roles)
    moved, plain = retarget(walker, beside, feet=False), retarget(walker, skeleton, feet=False)
    np.testing.assert_allclose(world(moved)[0][:, 1:], world(plain)[0][:, 1:], atol=0.02)


def test_what_has_no_plan_in_common_is_refused(walker):
    with pytest.raises(UserError, match="no joint plays the roles hips"):
        retarget(walker, other_joints().with_roles({}))
    with pytest.raises(UserError, match="no joint plays the roles hips"):
        retarget(walker.replace(skeleton=walker.skeleton.with_roles({})), walker.skeleton)
    other, _ = twisted(walker)
    names = tuple(f"j{j}" for j in range(len(other.skeleton)))
    with pytest.raises(UserError, match="no standing pose; give a clip of it"):
        retarget(walker, replace(other.skeleton, names=names))


def test_clips_of_few_frames_go_too(walker):
    for length in (1, 2, 3):
        short = walker.replace(positions=walker.positions[:length], rotations=walker.rotations[:length])
        moved = retarget(short, stocky())
        assert len(moved) == length and np.isfinite(moved.rotations).all()
    with pytest.raises(UserError, match="has no frames"):
        retarget(walker.replace(positions=walker.positions[:0], rotations=walker.rotations[:0]), stocky())


def test_a_leg_without_length_is_refused(walker):
    offsets = stocky().offsets.copy()
    offsets[stocky().roles["left_leg"]] = 0
    with pytest.raises(UserError, match="the bone to joint 'LeftLeg' has no length"):
        retarget(walker, replace(stocky(), offsets=offsets))


def test_a_dog_does_not_move_as_a_person(data, walker):
    dog = sources.load(data / "dog_mann" / "D1_007_KAN01_001.bvh")
    with pytest.raises(UserError, match="cannot move a biped as a quadruped moves"):
        retarget(dog, walker.skeleton)
    with pytest.raises(UserError, match="cannot move a quadruped as a biped moves"):
        retarget(walker, anatomy(dog.skeleton, [dog]))
    large = Skeleton(
        dog.skeleton.names,
        dog.skeleton.parents,
        1.5 * dog.skeleton.offsets,
        dog.skeleton.roles,
        {j: 1.5 * end for j, end in dog.skeleton.end_sites.items()},
    )
    moved = retarget(dog, large, feet=False)
    np.testing.assert_allclose(world(moved)[0], 1.5 * world(dog)[0], atol=2e-3)


def load(path) -> Clip:
    return leadin.without_lead_in(sources.load(path))


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("lafan1/original_30fps/obstacles1_subject2.bvh", "cmu/asfamc/02/02_01.amc"),
        ("cmu/asfamc/02/02_01.amc", "lafan1/original_30fps/obstacles1_subject2.bvh"),
        ("bandai/dataset-1/dataset-1_walk_normal_002.bvh", "cmu/daz_bvh/02/02_01.bvh"),
        ("pfnn/animations/LocomotionFlat04_000.bvh", "bandai/dataset-1/dataset-1_walk_normal_002.bvh"),
    ],
)
def test_real_skeletons_agree_on_where_bones_point(data, source, target):
    clip, model = load(data / source), load(data / target)
    if len(clip) > 900:
        clip = clip.replace(positions=clip.positions[200:900], rotations=clip.rotations[200:900])
    body = anatomy(model.skeleton, [model])
    free, planted = retarget(clip, body, feet=False), retarget(clip, body)
    apart = degrees_apart(clip, free)
    assert apart.pop("hips") < 15  # a pelvis of another length holds the spine elsewhere
    assert max(apart.values()) < 0.1
    held = degrees_apart(clip, planted)
    held.pop("hips")
    assert max(held.values()) < 8
    resting = contacts.contacts(clip)
    assert slides(planted, resting).max() < 1e-3


@pytest.mark.parametrize("name", ["02/02_01", "05/05_01", "35/35_01"])
def test_one_performance_on_two_skeletons(data, name):
    """CMU's AMC against the Daz-friendly BVH of it, which another program made."""
    own, theirs = (
        sources.load(data / "cmu/asfamc" / f"{name}.amc"),
        load(data / "cmu/daz_bvh" / f"{name}.bvh"),
    )
    moved = retarget(own, anatomy(theirs.skeleton, [theirs]))
    length = min(len(moved), len(theirs)) - 5
    last = [
        c.replace(positions=c.positions[-length:], rotations=c.rotations[-length:]) for c in (moved, theirs)
    ]
    apart = degrees_apart(*last)
    assert apart["hips"] < 2
    assert max(apart[f"{side}_arm"] for side in ("left", "right")) < 8
    assert max(apart[f"{side}_{part}"] for side in ("left", "right") for part in ("up_leg", "leg")) < 9
    # That program kept angles to the rest pose, in which Daz's forearms point 17 degrees ahead.
    assert max(apart[f"{side}_forearm"] for side in ("left", "right")) < 22


@pytest.mark.parametrize(("keep", "lost"), [("head", "neck"), ("hips", "chest"), ("chest", "neck")])
def test_a_joint_may_play_two_roles_of_the_torso(keep, lost):
    """Rigs without a head, a spine or a neck: the first of the two tells how the joint turns."""
    whole = synthetic.skeleton()
    poor = whole.with_roles({**whole.roles, lost: whole.roles[keep]})
    clip = synthetic.walk()
    for source, target in ((whole, poor), (poor, whole), (poor, poor)):
        moved = retarget(clip.replace(skeleton=source), target, feet=False)
        _, before = kinematics.forward(whole, clip.positions, clip.rotations)
        _, after = kinematics.forward(whole, moved.positions, moved.rotations)
        joint = whole.roles[keep]
        np.testing.assert_allclose(np.abs(np.sum(before[:, joint] * after[:, joint], axis=-1)), 1, atol=1e-9)
