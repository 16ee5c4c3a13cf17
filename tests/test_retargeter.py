"""Retargeting at run time: the kernel against its twin and against whole clips, and feet that stay."""

from __future__ import annotations

import numpy as np
import pytest
from test_anatomy import twisted
from test_retarget import other_joints, slides, stocky, world

from motion import contacts, kinematics, quat, retarget, retarget_kernels, rig, root, sources
from motion.anatomy import Anatomy, anatomy
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.retargeter import Retargeter
from motion.skeleton import Skeleton

FEET = ("left_toe", "right_toe")


@pytest.fixture(scope="module")
def played(walker) -> tuple[Clip, Anatomy, Poses, np.ndarray]:
    clip = root.ground(walker)
    return clip, anatomy(clip.skeleton, [clip]), Poses.of_clip(clip), contacts.contacts(clip)


def play(retargeter: Retargeter, poses: Poses, resting: np.ndarray | None, fps: float) -> Poses:
    """The frames of poses one after the other, the same for all characters, of the last of whom are kept."""
    frames = []
    for t in range(len(poses)):
        rows = np.full(retargeter.count, t)
        told = None if resting is None else resting[rows]
        frames.append(retargeter.step(poses[rows], told, 1 / fps)[np.array([-1])].copy())
    return Poses(*(np.concatenate([f.arrays()[name] for f in frames]) for name in poses.arrays()))


def as_clip(poses: Poses, skeleton: Skeleton, fps: float) -> Clip:
    rotations = quat.normalize(poses.rotations.astype(np.float64))
    return Clip("played", skeleton, fps, poses.positions, rotations)


@pytest.mark.parametrize("target", [stocky, other_joints])
@pytest.mark.parametrize("planting", [False, True])
def test_the_kernel_does_what_its_twin_does(played, target, planting):
    clip, source, poses, resting = played
    roles = FEET if planting else ()
    fast, slow = (
        Retargeter(source, target(), 3, contact_roles=roles, compiled=compiled) for compiled in (True, False)
    )
    for t in range(45):
        rows = np.array([t, t + 40, t + 90])
        a = fast.step(poses[rows], resting[rows] if planting else None, 1 / clip.fps)
        b = slow.step(poses[rows], resting[rows] if planting else None, 1 / clip.fps)
        for name, array in a.arrays().items():
            np.testing.assert_allclose(array, b.arrays()[name], atol=2e-5, err_msg=f"{name} in frame {t}")


def test_frame_by_frame_it_is_the_whole_clip(played):
    clip, source, poses, _ = played
    for target in (stocky(), other_joints(), root.ground(clip).skeleton):
        live = as_clip(play(Retargeter(source, target, 1), poses, None, clip.fps), target, clip.fps)
        whole = retarget.retarget(clip, target, source=source, feet=False)
        np.testing.assert_allclose(world(live)[0], world(whole)[0], atol=1e-5)
        assert quat.angle_between(world(live)[1], world(whole)[1]).max() < 1e-3


def test_velocities_are_those_of_the_motion(played):
    clip, source, poses, _ = played
    target = other_joints()
    live = play(Retargeter(source, target, 1), poses, None, clip.fps)
    arrays = [array.astype(np.float64) for array in live.arrays().values()]
    positions, rotations, velocities, angular = kinematics.forward_velocities(target, *arrays)
    inner = slice(3, -3)
    expected = kinematics.velocities(positions, clip.fps)
    # Differences over frames of a motion whose feet stop at once are off there by themselves.
    assert np.median(np.abs(velocities - expected)[inner]) < 2e-3
    assert np.mean(np.abs(velocities - expected)[inner]) < 0.02
    expected = kinematics.angular_velocities(rotations, clip.fps)
    assert np.median(np.abs(angular - expected)[inner]) < 1e-2


def test_a_rig_of_191_joints_is_driven_by_few(played):
    clip, source, poses, resting = played
    small, large = stocky(), rig.enlarge(stocky(), 191)
    one = Retargeter(source, large, 1, contact_roles=FEET)
    live = as_clip(play(one, poses, resting, clip.fps), large, clip.fps)
    plain = Retargeter(source, small, 1, contact_roles=FEET)
    few = as_clip(play(plain, poses, resting, clip.fps), small, clip.fps)
    own = [large.index(name) for name in small.names]
    np.testing.assert_allclose(world(live)[0][:, own], world(few)[0], atol=1e-5)
    added = np.setdiff1d(np.arange(191), own)
    np.testing.assert_array_equal(np.ptp(live.rotations[:, added], axis=0), 0)
    # Of those added none is in the kernel's way.
    assert len(retarget_kernels.work(1, 1, 0).places) == 0
    assert set(one._tables.needed) <= set(own)


def test_feet_stay_where_they_are_told_to(played):
    clip, source, poses, resting = played
    target = stocky()
    retargeter = Retargeter(source, target, 2, contact_roles=FEET)
    live = as_clip(play(retargeter, poses, resting, clip.fps), target, clip.fps)
    # After the tenth of a second in which they come to rest.
    late = resting.copy()
    for c in range(2):
        for start in np.flatnonzero(np.diff(resting[:, c].astype(int)) == 1):
            late[start : start + 10, c] = 0
    late[:10] = 0
    assert late.sum() > 100
    assert slides(live, late).max() < 1e-3
    free = as_clip(play(Retargeter(source, target, 1), poses, None, clip.fps), target, clip.fps)
    assert slides(live, resting).mean() < slides(free, resting).mean()
    steps = quat.angle_between(live.rotations[1:], live.rotations[:-1]).max()
    assert steps < 1.5 * quat.angle_between(free.rotations[1:], free.rotations[:-1]).max()


def test_out_of_reach_the_hips_come_down(played):
    clip, source, poses, _ = played
    target = stocky()
    retargeter = Retargeter(source, target, 1, contact_roles=FEET, unlock_radius=2.0)
    held = np.ones((1, 2), np.uint8)
    hips, heights = target.roles["hips"], []
    for t in range(40, 80):  # both feet are held while the body walks on
        pose = retargeter.step(poses[np.array([t])], held, 1 / clip.fps)
        heights.append(float(pose.positions[0, hips, 1]))
    free = play(Retargeter(source, target, 1), poses[np.arange(40, 80)], None, clip.fps)
    down = free.positions[:, hips, 1] - np.array(heights)
    assert down.max() > 0.01
    assert np.abs(np.diff(down)).max() < 0.02
    assert np.isfinite(heights).all()


def test_reset_forgets_where_feet_stood(played):
    clip, source, poses, resting = played
    retargeter = Retargeter(source, stocky(), 1, contact_roles=FEET)
    first = play(retargeter, poses[np.arange(40)], resting, clip.fps)
    retargeter.reset()
    second = play(retargeter, poses[np.arange(40)], resting, clip.fps)
    for name, array in first.arrays().items():
        np.testing.assert_array_equal(array, second.arrays()[name])


def test_the_same_buffers_come_out_every_frame(played):
    clip, source, poses, resting = played
    retargeter = Retargeter(source, stocky(), 1, contact_roles=FEET)
    one = retargeter.step(poses[np.array([0])], resting[:1], 1 / clip.fps)
    two = retargeter.step(poses[np.array([1])], resting[1:2], 1 / clip.fps)
    assert one is two
    assert one.positions.dtype == one.rotations.dtype == np.float32


def test_what_does_not_fit_is_refused(played, walker):
    clip, source, poses, resting = played
    with pytest.raises(UserError, match="0 characters"):
        Retargeter(source, stocky(), 0)
    with pytest.raises(UserError, match="no root on the ground; ground its clips"):
        Retargeter(anatomy(walker.skeleton), clip.skeleton, 1)
    other, _ = twisted(walker)
    with pytest.raises(UserError, match="give a clip of it"):
        Retargeter(other.skeleton, stocky(), 1)
    retargeter = Retargeter(source, stocky(), 2, contact_roles=FEET)
    with pytest.raises(UserError, match="give 2 characters of 23 joints"):
        retargeter.step(poses[np.array([0])], None, 1 / 60)
    with pytest.raises(UserError, match=r"give \(2, 2\): left_toe, right_toe"):
        retargeter.step(poses[np.array([0, 1])], resting[:1], 1 / 60)


def test_a_dog_drives_a_larger_dog(data):
    dog = root.ground(sources.load(data / "dog_mann" / "D1_007_KAN01_001.bvh"))
    source, roles = anatomy(dog.skeleton, [dog]), (*FEET, "left_hand", "right_hand")
    roles = contacts.contact_roles(dog.skeleton, world(dog)[0])
    assert len(roles) == 4
    large = Skeleton(
        dog.skeleton.names,
        dog.skeleton.parents,
        1.3 * dog.skeleton.offsets,
        dog.skeleton.roles,
        {j: 1.3 * end for j, end in dog.skeleton.end_sites.items()},
    )
    resting = contacts.contacts(dog)
    poses = Poses.of_clip(dog)
    live = play(Retargeter(source, large, 1, contact_roles=roles), poses, resting, dog.fps)
    clip = as_clip(live, large, dog.fps)
    assert np.abs(world(clip)[0] - 1.3 * world(dog)[0]).max() < 0.08
