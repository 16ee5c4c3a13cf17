"""The ground root: where it is, where it faces, and that nothing else moves."""

import dataclasses

import numpy as np
import pytest
import synthetic

from motion import kinematics, quat, resample, root, sources
from motion.errors import UserError

REAL = [
    "bandai/dataset-1/dataset-1_run_normal_001.bvh",
    "bandai/dataset-1/dataset-1_dash_normal_001.bvh",
    "cmu/daz_bvh/02/02_01.bvh",
    "cmu/asfamc/02/02_01.amc",
    "pfnn/animations/LocomotionFlat04_000.bvh",
    "lafan1/mirror_oracle/walk1_subject1_walk2_mirror_filtered.bvh",
    "dog_mann/D1_010_KAN01_002.bvh",
]


def world(clip):
    positions, _ = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    return dict(zip(clip.skeleton.names, positions.swapaxes(0, 1), strict=True))


def check_ground_root(clip, grounded):
    skeleton = grounded.skeleton
    assert skeleton.names[0] == "root" and skeleton.roles["root"] == 0
    assert np.all(grounded.positions[:, 0, 1] == 0)
    up = quat.rotate(grounded.rotations[:, 0], np.broadcast_to([0.0, 1.0, 0.0], (len(grounded), 3)))
    np.testing.assert_allclose(up, np.broadcast_to([0.0, 1.0, 0.0], up.shape), atol=1e-12)
    for role, joint in clip.skeleton.roles.items():
        if role != "root":
            assert skeleton.names[skeleton.roles[role]] == clip.skeleton.names[joint]
    before, after = world(clip), world(grounded)
    first = clip.skeleton.names[0] if "root" in clip.skeleton.roles else None
    for name in before:
        if name != first:
            np.testing.assert_allclose(after[name], before[name], atol=1e-9)
    assert np.all(np.sum(grounded.rotations[1:] * grounded.rotations[:-1], axis=-1) > 0)


@pytest.mark.parametrize("name", REAL)
def test_world_positions_stay_and_the_root_is_on_the_ground(data, name):
    clip = sources.load(data / name)
    grounded = root.ground(clip)
    check_ground_root(clip, grounded)
    again = root.ground(grounded)
    check_ground_root(grounded, again)
    np.testing.assert_allclose(again.positions, grounded.positions, atol=1e-9)
    # People and dogs that run or walk straight face where they go.
    step = np.diff(grounded.positions[:, 0], axis=0)
    facing = quat.rotate(grounded.rotations[:-1, 0], np.broadcast_to([0.0, 0.0, 1.0], step.shape))
    share = np.sum(step * facing) / np.linalg.norm(step, axis=-1).sum()
    assert share > (0.6 if "Flat04" in name else 0.9)


def test_a_straight_walk_has_a_straight_root():
    clip = synthetic.walk(speed=1.2, seconds=4)
    grounded = root.ground(clip)
    check_ground_root(clip, grounded)
    middle = slice(30, -30)
    assert np.abs(quat.yaw(grounded.rotations[middle, 0])).max() < 0.06  # the hips sway by 0.06
    np.testing.assert_allclose(np.diff(grounded.positions[middle, 0, 2]) * 60, 1.2, atol=0.05)


def test_a_turn_is_followed():
    clip = synthetic.walk(turn=0.8, seconds=4)
    yaw = np.unwrap(quat.yaw(root.ground(clip).rotations[:, 0]))
    time = np.arange(len(clip)) / 60
    np.testing.assert_allclose(yaw[30:-30], 0.8 * time[30:-30], atol=0.06)


def test_the_root_is_the_same_at_any_rate():
    fine = root.ground(synthetic.walk(turn=synthetic.weave, seconds=4, fps=120))
    for fps in (30, 100, 29.97):
        clip = synthetic.walk(turn=synthetic.weave, seconds=4, fps=fps)
        positions = resample.resample(fine, fps).positions[:, 0]
        count = min(len(positions), len(clip))
        difference = root.ground(clip).positions[:count, 0] - positions[:count]
        assert np.abs(difference[10:-10]).max() < 0.005


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 20])
def test_clips_shorter_than_the_filters(walker, frames):
    clip = walker.replace(positions=walker.positions[:frames], rotations=walker.rotations[:frames])
    grounded = root.ground(clip)
    check_ground_root(clip, grounded)
    assert np.isfinite(grounded.positions).all() and np.isfinite(grounded.rotations).all()


def test_equals_the_public_reference(data):
    """Root, velocities and contacts of the oracle's first range, made from frames 60 to 460."""
    from scipy.interpolate import CubicSpline

    oracle = first_range(data)
    clip = sources.load(data / "lafan1/original_30fps/obstacles1_subject2.bvh")
    clip = clip.replace(positions=clip.positions[60:460], rotations=clip.rotations[60:460])
    times = np.linspace(0, 399, len(oracle[0]))
    clip = clip.replace(
        fps=60.0,
        positions=CubicSpline(np.arange(400), clip.positions)(times),
        rotations=quat.normalize(CubicSpline(np.arange(400), quat.unroll(clip.rotations))(times)),
    )
    grounded = root.ground(clip)
    np.testing.assert_allclose(grounded.positions, oracle[0], atol=2e-5)
    assert quat.angle_between(grounded.rotations, oracle[1].astype(np.float64)).max() < 1e-5


def first_range(data):
    """Positions and rotations of the oracle database's first range."""
    raw = np.fromfile(data / "reference/oracle/database.bin", np.uint8)
    arrays, at = [], 0
    for width in (3, 3, 4, 3):
        rows, columns = raw[at : at + 8].view("<i4")
        size = 4 * width * rows * columns
        arrays.append(raw[at + 8 : at + 8 + size].view("<f4").reshape(rows, columns, width))
        at += 8 + size
    return arrays[0][:719], arrays[2][:719]


def test_a_ground_root_of_the_file_is_replaced(walker):
    grounded = root.ground(walker)
    moved = grounded.positions.copy()
    moved[:, 0] += [3.0, 0.0, -2.0]
    clip = grounded.replace(
        positions=moved,
        skeleton=dataclasses.replace(grounded.skeleton, names=("Trajectory", *grounded.skeleton.names[1:])),
    )
    again = root.ground(clip)
    assert len(again.skeleton) == len(grounded.skeleton)
    np.testing.assert_allclose(again.positions[:, 0], grounded.positions[:, 0] + [3, 0, -2], atol=1e-9)


def test_hips_named_root_get_another_name(walker):
    names = ("root", *walker.skeleton.names[1:])
    grounded = root.ground(walker.replace(skeleton=dataclasses.replace(walker.skeleton, names=names)))
    assert grounded.skeleton.names[:2] == ("root", "hips")


def test_heading_without_direction_stays_finite(walker):
    lying = walker.rotations.copy()
    lying[:, 0] = quat.from_axis_angle([0.0, 0.0, 1.0], np.pi / 2)
    grounded = root.ground(walker.replace(rotations=lying))
    assert np.isfinite(grounded.rotations).all()


def test_missing_roles_are_named(walker):
    with pytest.raises(UserError, match=r"role 'hips'.*LeftUpLeg"):
        root.ground(walker.replace(skeleton=walker.skeleton.with_roles({"chest": 3})))
    with pytest.raises(UserError, match=r"up_leg, arm or shoulder.*LeftUpLeg"):
        root.ground(walker.replace(skeleton=walker.skeleton.with_roles({"hips": 0})))


@pytest.mark.parametrize(
    ("seconds", "fps", "frames"), [(0.5, 60, 29), (31 / 60, 60, 31), (61 / 60, 30, 31), (0.01, 30, 1)]
)
def test_windows_are_odd(seconds, fps, frames):
    assert root.odd_frames(seconds, fps) == frames
