"""Anatomical frames: the same on every skeleton, however its joints' axes lie."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic

from motion import kinematics, quat, sources
from motion.anatomy import anatomies, anatomy, stands
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton


def twisted(clip: Clip, seed: int = 0) -> tuple[Clip, np.ndarray]:
    """The same motion on a skeleton of joints with other axes, and the local rotations that stand there."""
    old, rng = clip.skeleton, np.random.default_rng(seed)
    own = quat.normalize(rng.normal(size=(len(old), 4)))
    above = own[np.maximum(old.parents, 0)].copy()
    above[0] = quat.identity()
    offsets = quat.rotate(quat.inv(above), old.offsets)
    ends = {j: quat.rotate(quat.inv(own[j]), end) for j, end in old.end_sites.items()}
    skeleton = Skeleton(old.names, old.parents, offsets, old.roles, ends)
    stance = quat.mul(quat.inv(above), own)
    positions = quat.rotate(quat.inv(above), clip.positions)
    rotations = quat.mul(quat.inv(above), quat.mul(clip.rotations, own))
    return clip.replace(skeleton=skeleton, positions=positions, rotations=rotations), stance


def body_axes(clip: Clip, frames: np.ndarray) -> np.ndarray:
    """World matrices [T, J, 3, 3] of the anatomical frames."""
    _, turned = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    return quat.to_matrix(quat.mul(turned, frames))


def test_a_skeleton_that_stands_is_told_from_one_that_does_not(walker):
    rest = quat.identity(len(walker.skeleton))
    other, stance = twisted(walker)
    assert stands(walker.skeleton, walker.skeleton.offsets, rest)
    assert not stands(other.skeleton, other.skeleton.offsets, rest)
    assert stands(other.skeleton, other.skeleton.offsets, stance)
    flat = quat.mul(quat.from_axis_angle([1.0, 0.0, 0.0], np.pi / 2), rest[0])
    assert not stands(walker.skeleton, walker.skeleton.offsets, np.concatenate([flat[None], rest[1:]]))


def test_frames_point_where_the_body_does(walker):
    body = anatomy(walker.skeleton)
    axes = quat.to_matrix(body.frames)
    roles = walker.skeleton.roles
    for side in ("left", "right"):
        np.testing.assert_allclose(axes[roles[f"{side}_up_leg"], :, 0], [0, -1, 0], atol=1e-12)
        np.testing.assert_allclose(axes[roles[f"{side}_up_leg"], :, 1], [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(axes[roles[f"{side}_forearm"], :, 1], [0, 0, 1], atol=1e-12)
        # A flat foot: its first axis is up however its bone slopes.
        np.testing.assert_allclose(axes[roles[f"{side}_foot"], :, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(axes[roles["hips"], :, :2], [[0, 1], [1, 0], [0, 0]], atol=1e-12)
    assert body.known[list(roles.values())].all()
    assert not body.on_all_fours


def test_a_stance_gives_twisted_joints_the_same_frames(walker):
    other, stance = twisted(walker)
    expected = body_axes(walker, anatomy(walker.skeleton).frames)
    found = body_axes(other, anatomy(other.skeleton, stance=stance).frames)
    known = anatomy(walker.skeleton).known
    np.testing.assert_allclose(found[:, known], expected[:, known], atol=1e-9)


def test_a_first_frame_in_t_pose_is_a_stance(walker):
    other, stance = twisted(walker)
    rotations = np.concatenate([stance[None], other.rotations])
    positions = np.concatenate([other.positions[:1], other.positions])
    told = anatomy(other.skeleton, stance=stance)
    seen = anatomy(other.skeleton, [other.replace(positions=positions, rotations=rotations)])
    np.testing.assert_allclose(np.abs(np.sum(told.frames * seen.frames, axis=-1))[told.known], 1, atol=1e-9)


def test_motion_alone_shows_frames_within_a_few_degrees(walker_clips):
    clips = [twisted(clip)[0] for clip in walker_clips]
    expected = body_axes(walker_clips[0], anatomy(walker_clips[0].skeleton).frames)
    found = body_axes(clips[0], anatomy(clips[0].skeleton, clips).frames)
    roles = clips[0].skeleton.roles
    for role, joint in roles.items():
        cosines = np.sum(expected[:, joint] * found[:, joint], axis=-2).min(axis=0)
        # The swinging arms' hands and the leaning trunk are no T-pose on average.
        least = np.cos(np.radians(2 if role.endswith("leg") else 12))
        assert cosines.min() > least, role


def test_where_feet_rest_is_the_sole(walker):
    body = anatomy(walker.skeleton, [walker])
    assert body.sole == pytest.approx(synthetic.ANKLE - 0.07, abs=2e-3)
    assert np.isnan(anatomy(walker.skeleton).sole)


def test_clips_of_one_body_share_an_anatomy(walker_clips):
    larger = walker_clips[0].skeleton
    larger = Skeleton(larger.names, larger.parents, larger.offsets * 1.2, larger.roles)
    other = walker_clips[0].replace(skeleton=larger, positions=walker_clips[0].positions * 1.2)
    found = anatomies([*walker_clips, other])
    assert all(body is found[0] for body in found[:-1])
    assert found[-1] is not found[0]


def test_what_cannot_be_told_is_refused(walker):
    other, _ = twisted(walker)
    with pytest.raises(UserError, match="no standing pose; give a clip"):
        anatomy(other.skeleton)
    roles = {role: j for role, j in walker.skeleton.roles.items() if role not in ("hips", "left_foot")}
    with pytest.raises(UserError, match="roles hips, left_foot; name them in a roles file"):
        anatomy(walker.skeleton.with_roles(roles))
    swapped = walker.skeleton.roles | {"left_foot": walker.skeleton.roles["right_foot"]}
    with pytest.raises(UserError, match="'RightFoot' is not below 'LeftUpLeg'"):
        anatomy(walker.skeleton.with_roles(swapped))


@pytest.mark.parametrize(
    ("file", "up", "bends"),
    [
        ("lafan1/original_30fps/obstacles1_subject2.bvh", "x", "-y"),
        ("bandai/dataset-1/dataset-1_walk_normal_002.bvh", "x", "-z"),
    ],
)
def test_rigs_that_fold_all_bones_along_one_axis_are_read_from_their_motion(data, file, up, bends):
    clip = sources.load(data / file)
    clip = clip.replace(positions=clip.positions[:600], rotations=clip.rotations[:600])
    body = anatomy(clip.skeleton, [clip])
    axes = quat.to_matrix(body.frames)
    roles = clip.skeleton.roles
    axis = {a: s * np.eye(3)["xyz".index(a[-1])] for a in (up, bends) for s in (1 - 2 * a.startswith("-"),)}
    np.testing.assert_allclose(axes[roles["hips"], :, 0], axis[up], atol=1e-5)
    np.testing.assert_allclose(axes[roles["head"], :, 0], axis[up], atol=1e-5)
    # A left thigh faces against where the knee bends.
    np.testing.assert_allclose(axes[roles["left_up_leg"], :, 1], -axis[bends], atol=1e-5)
