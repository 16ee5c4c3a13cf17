"""lmm.pfnn.frames: a network that gives a clip's own frames plays the clip; inputs by their meaning; ends."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest

from features.labels import Labels
from lmm.locomotion import settings as settings_types
from lmm.pfnn import steps, trajectory
from lmm.pfnn.frames import Frames, frames
from lmm.pfnn.layout import Layout
from mm.database import Database
from motion import kinematics, quat

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def labels(database: Database) -> Labels:
    """Any: a phase that goes round, gaits and contacts by chance."""
    rng, count = np.random.default_rng(0), len(database)
    phase = np.mod(np.arange(count) * 0.11, 2 * np.pi).astype(np.float32)
    gait = rng.dirichlet(np.ones(6), count).astype(np.float32)
    return Labels(NAMES, rng.integers(0, 2, (count, 4)).astype(np.uint8), phase, gait)


@pytest.fixture(scope="module")
def found(database: Database, labels: Labels) -> Frames:
    return frames(database, labels)


def test_all_but_the_ends_of_ranges(database: Database, found: Frames, labels: Labels) -> None:
    ends = np.r_[database.starts, database.stops - 1]
    np.testing.assert_array_equal(found.frame, np.setdiff1d(np.arange(len(database)), ends))
    np.testing.assert_array_equal(found.phase, labels.phase[found.frame])
    assert np.isfinite(found.x).all() and np.isfinite(found.y).all()


def test_who_puts_out_these_frames_plays_the_clip(database: Database, found: Frames, labels: Labels) -> None:
    """The runtime's own kernels, fed with the outputs in order, go the way of the data."""
    layout = Layout(len(database.skeleton) - 1)
    out = np.array([part.start for part in layout.outputs.values()], np.int64)
    settings = settings_types.record(
        settings_types.LocomotionSettings(joint_smoothing=0.0), 60, walk_mps=1, run_mps=2
    )
    for start, stop in zip(database.starts, database.stops, strict=True):
        poses = database.poses[slice(int(start), int(stop))]
        rows = np.flatnonzero((found.frame > start) & (found.frame < stop - 1))
        c = np.zeros(1, trajectory.CHARACTER)
        c["root"][0, :2], c["root"][0, 2] = poses.positions[1, 0, [0, 2]], quat.yaw(poses.rotations[1, 0])
        c["phase"] = labels.phase[start + 1]
        past, joints = trajectory.ring(1, 10), np.zeros((2, 1, layout.joints, 3), np.float32)
        shown = np.zeros((1, layout.joints + 1, 3), np.float32)
        rotations, rates = quat.identity(1, layout.joints + 1, dtype=np.float32), np.zeros((2, *shown.shape))
        contacts = np.zeros((1, 4), np.uint8)
        for i, row in enumerate(rows, start=1):
            y = found.y[row : row + 1]
            steps.show(
                c, y, out, settings, database.skeleton.parents.astype(np.int64),
                database.skeleton.offsets.astype(np.float32), True, np.arange(4), *joints, shown, rotations,
                *rates.astype(np.float32), contacts, np.zeros((layout.joints, 4), np.float32),
            )  # fmt: skip
            np.testing.assert_allclose(shown[0], poses.positions[i], atol=2e-4)
            assert quat.angle_between(rotations[0], np.asarray(poses.rotations[i])).max() < 2e-3
            np.testing.assert_array_equal(contacts[0], labels.contacts[start + i])
            assert abs(np.mod(c["phase"][0] - labels.phase[start + i] + 1, 2 * np.pi) - 1) < 1e-3
            steps.advance(c, past, 0, y, out, settings, np.zeros((0, 5), np.float32))
            # What is ahead is where the data goes, as far as it goes.
            ahead = np.minimum(i + 1 + 10 * np.arange(6), stop - start - 1)
            whole = ahead == i + 1 + 10 * np.arange(6)
            c_, s_ = np.cos(c["root"][0, 2]), np.sin(c["root"][0, 2])
            local = c["future"][0, :, :2]
            world = c["root"][0, :2] + np.stack(
                [c_ * local[:, 0] + s_ * local[:, 1], c_ * local[:, 1] - s_ * local[:, 0]], axis=-1
            )
            np.testing.assert_allclose(world[whole], poses.positions[ahead[whole], 0][:, [0, 2]], atol=2e-3)


def test_inputs_are_of_the_frame_before_and_the_trajectory_now(
    database: Database, found: Frames, labels: Labels
) -> None:
    layout = Layout(len(database.skeleton) - 1)
    row = int(np.argmax(found.frame >= 61))
    t = int(found.frame[row])
    parts = layout.unpack_inputs(found.x[row : row + 1])
    poses = database.poses[slice(t - 60, t + 2)]
    world, _ = kinematics.forward(database.skeleton, np.asarray(poses.positions), np.asarray(poses.rotations))
    at = {k: world[60 + k] for k in (-60, -20, -1, 0)}
    yaw = {k: quat.yaw(np.asarray(poses.rotations[60 + k, 0])) for k in at}

    def local(points: np.ndarray, k: int) -> np.ndarray:
        return quat.rotate(quat.inv(quat.from_yaw(yaw[k])), points)

    np.testing.assert_allclose(parts.positions[0], local(at[-1][1:] - at[-1][0], -1), atol=1e-5)
    np.testing.assert_allclose(parts.velocities[0], local(60 * (at[0] - at[-1])[1:], -1), atol=1e-3)
    for sample, k in ((0, -60), (4, -20)):
        np.testing.assert_allclose(parts.path[0, sample], local(at[k][0] - at[0][0], 0)[[0, 2]], atol=1e-5)
        turn = yaw[k] - yaw[0]
        np.testing.assert_allclose(parts.facing[0, sample], [np.sin(turn), np.cos(turn)], atol=1e-5)
        np.testing.assert_array_equal(parts.gaits[0, sample], labels.gait[t + k])
    np.testing.assert_array_equal(parts.path[0, 6], [0, 0])
    assert not parts.heights.any()


def test_beyond_its_ends_a_range_goes_straight_on(database: Database, found: Frames) -> None:
    layout = Layout(len(database.skeleton) - 1)
    last = int(np.flatnonzero(found.frame == database.stops[0] - 2)[0])
    path = layout.unpack_outputs(found.y[last : last + 1]).path[0]
    steps_ = np.diff(path, axis=0)
    np.testing.assert_allclose(steps_, np.broadcast_to(steps_[:1], steps_.shape), atol=1e-5)
    speed = np.linalg.norm(database.poses.velocities[database.stops[0] - 1, 0])
    assert np.linalg.norm(steps_[0]) == pytest.approx(speed / 6, rel=0.2)


def test_labels_must_fit(database: Database, labels: Labels) -> None:
    with pytest.raises(ValueError, match="labels of 3 frames"):
        frames(database, labels[0:3])
