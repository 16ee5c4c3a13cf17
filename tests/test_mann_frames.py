"""lmm.mann.frames: a network that gives a clip's own frames plays the clip; inputs; ends; statistics."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest

from features.labels import Labels
from lmm.locomotion import settings as settings_types
from lmm.locomotion import trajectory
from lmm.locomotion.labelling import labels_of
from lmm.locomotion.statistics import joint_weights, statistics
from lmm.locomotion.window import GAITS
from lmm.mann import steps
from lmm.mann.controller import CHARACTER, PAST
from lmm.mann.frames import Frames, frames, wanted_speeds
from lmm.mann.layout import Layout
from mm.database import Database
from motion import kinematics, quat

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def labels(database: Database) -> Labels:
    """Any: gaits and contacts by chance."""
    rng, count = np.random.default_rng(0), len(database)
    gait = rng.dirichlet(np.ones(6), count).astype(np.float32)
    return Labels(NAMES, rng.integers(0, 2, (count, 4)).astype(np.uint8), None, gait)


@pytest.fixture(scope="module")
def found(database: Database, labels: Labels) -> Frames:
    return frames(database, labels)


def layout_of(database: Database) -> Layout:
    return Layout(len(database.skeleton) - 1, 4)


def test_all_but_the_ends_of_ranges(database: Database, found: Frames) -> None:
    ends = np.r_[database.starts, database.stops - 1]
    np.testing.assert_array_equal(found.frame, np.setdiff1d(np.arange(len(database)), ends))
    layout = layout_of(database)
    assert found.x.shape == (len(found.frame), layout.input_size)
    assert found.y.shape == (len(found.frame), layout.output_size)
    assert np.isfinite(found.x).all() and np.isfinite(found.y).all()


def test_who_puts_out_these_frames_plays_the_clip(database: Database, found: Frames, labels: Labels) -> None:
    """The runtime's own kernels, fed with the outputs in order, go the way of the data.

    They also remember and predict what the inputs of the frame to come say.
    """
    layout = layout_of(database)
    out = np.array([part.start for part in layout.outputs.values()], np.int64)
    settings = settings_types.record(
        settings_types.LocomotionSettings(joint_smoothing=0.0), 60, walk_mps=1, run_mps=2
    )
    for start, stop in zip(database.starts, database.stops, strict=True):
        poses = database.poses[slice(int(start), int(stop))]
        rows = np.flatnonzero((found.frame > start) & (found.frame < stop - 1))
        c = np.zeros(1, CHARACTER)
        c["root"][0, :2], c["root"][0, 2] = poses.positions[1, 0, [0, 2]], quat.yaw(poses.rotations[1, 0])
        past, joints = trajectory.ring(1, 10, PAST), np.zeros((2, 1, layout.joints, 3), np.float32)
        axes = np.zeros((1, layout.joints, 6), np.float32)
        shown = np.zeros((1, layout.joints + 1, 3), np.float32)
        rotations, rates = quat.identity(1, layout.joints + 1, dtype=np.float32), np.zeros((2, *shown.shape))
        contacts = np.zeros((1, 4), np.uint8)
        for i, row in enumerate(rows, start=1):
            y = found.y[row : row + 1]
            steps.show(
                c, y, out, settings, database.skeleton.parents.astype(np.int64),
                database.skeleton.offsets.astype(np.float32), True, np.arange(4), *joints, axes, shown,
                rotations, *rates.astype(np.float32), contacts, np.zeros((layout.joints, 4), np.float32),
            )  # fmt: skip
            np.testing.assert_allclose(shown[0], poses.positions[i], atol=2e-4)
            assert quat.angle_between(rotations[0], np.asarray(poses.rotations[i])).max() < 2e-3
            np.testing.assert_array_equal(contacts[0], labels.contacts[start + i])
            steps.advance(c, past, 0, y, out, settings, np.zeros((0, 5), np.float32))
            if row == rows[-1]:
                break
            after = found.x[row + 1]
            fed = {name: after[columns] for name, columns in layout.inputs.items()}
            np.testing.assert_allclose(fed["positions"], joints[0].ravel(), atol=1e-5)
            np.testing.assert_allclose(fed["velocities"], joints[1].ravel(), atol=1e-5)
            np.testing.assert_allclose(fed["rotations"], axes.ravel(), atol=2e-3)
            yaw = c["root"][0, 2]
            arrived = quat.rotate(quat.from_yaw(-yaw), np.insert(c["velocity"][0], 1, 0))[[0, 2]]
            np.testing.assert_allclose(fed["going"][[6, 18]], arrived, atol=2e-2)
            for a, name in enumerate(("path", "facing", "going")):
                ahead = c["future"][0, :, 2 * a : 2 * a + 2]
                np.testing.assert_allclose(fed[name].reshape(2, 12)[:, 6:], ahead.T, atol=2e-3)


def test_inputs_are_of_the_frame_before_and_the_trajectory_now(
    database: Database, found: Frames, labels: Labels
) -> None:
    layout = layout_of(database)
    row = int(np.argmax(found.frame >= 62))
    t = int(found.frame[row])
    parts = layout.unpack_inputs(found.x[row : row + 1])
    poses = database.poses[slice(t - 61, t + 2)]
    world, turned = kinematics.forward(
        database.skeleton, np.asarray(poses.positions), np.asarray(poses.rotations)
    )
    at = {k: world[61 + k] for k in (-61, -60, -21, -20, -1, 0)}
    yaw = {k: quat.yaw(np.asarray(poses.rotations[61 + k, 0])) for k in at}

    def local(points: np.ndarray, k: int) -> np.ndarray:
        return quat.rotate(quat.inv(quat.from_yaw(yaw[k])), points)

    np.testing.assert_allclose(parts.positions[0], local(at[-1][1:] - at[-1][0], -1), atol=1e-5)
    np.testing.assert_allclose(parts.velocities[0], local(60 * (at[0] - at[-1])[1:], -1), atol=1e-3)
    expected = quat.mul(quat.inv(quat.from_yaw(yaw[-1])), turned[60, 1:])
    assert quat.angle_between(parts.rotations[0], expected).max() < 2e-3
    for sample, k in ((0, -60), (4, -20), (6, 0)):
        np.testing.assert_allclose(parts.path[0, sample], local(at[k][0] - at[0][0], 0)[[0, 2]], atol=1e-5)
        turn = yaw[k] - yaw[0]
        np.testing.assert_allclose(parts.facing[0, sample], [np.sin(turn), np.cos(turn)], atol=1e-5)
        np.testing.assert_array_equal(parts.gaits[0, sample], labels.gait[t + k])
        going = local(60 * (at[k] - at[k - 1])[0], 0)[[0, 2]]
        np.testing.assert_allclose(parts.going[0, sample], going, atol=1e-3)


def test_the_speed_wanted_is_that_of_the_second_to_come() -> None:
    """Two seconds of standing, then two at 1.5 m/s round a corner, at 10 frames a second."""
    steps_ = np.zeros((40, 2))
    steps_[20:30, 0] = steps_[30:, 1] = 0.15
    speeds = wanted_speeds(np.cumsum(steps_, axis=0), 10.0)
    np.testing.assert_allclose(speeds[:10], 0)
    np.testing.assert_allclose(speeds[9:20], 0.15 * np.arange(11), atol=1e-6)
    np.testing.assert_allclose(speeds[19:], 1.5, rtol=1e-6)


def test_labels_of_a_database_are_its_contacts_and_gaits(database: Database) -> None:
    labels = labels_of(database, phase=False)
    assert labels.names == database.contact_roles and labels.phase is None
    np.testing.assert_array_equal(labels.contacts, database.contacts)
    np.testing.assert_allclose(labels.gait.sum(axis=1), 1, atol=1e-5)
    means = {
        name: labels.gait[start:stop].mean(axis=0)
        for name, start, stop in zip(database.names, database.starts, database.stops, strict=True)
    }
    assert means["straight"][GAITS.index("walk")] > 0.9 and means["run"][GAITS.index("jog")] > 0.9


def test_labels_must_fit(database: Database, labels: Labels) -> None:
    with pytest.raises(ValueError, match="labels of 3 frames"):
        frames(database, labels[0:3])


def test_joints_count_as_much_as_the_trajectory(database: Database, found: Frames) -> None:
    layout = layout_of(database)
    weights = joint_weights(database.skeleton)
    stats = statistics(found.x, found.y, layout, weights, joint_scale=1.0)
    for block in ("positions", "rotations", "velocities", "speeds"):
        spread = found.x[:, layout.inputs[block]].std(axis=0).mean()
        np.testing.assert_allclose(stats["input_std"][layout.inputs[block]], spread, rtol=1e-3)
    going = layout.inputs["going"]
    for half in (slice(going.start, going.start + 12), slice(going.start + 12, going.stop)):
        np.testing.assert_allclose(stats["input_std"][half], found.x[:, half].std(axis=0).mean(), rtol=1e-3)
    less = statistics(found.x, found.y, layout, weights, joint_scale=0.1)
    ratio = less["input_std"] / stats["input_std"]
    np.testing.assert_allclose(ratio, np.where(np.arange(len(ratio)) < 156, 1, 10), rtol=1e-5)
    weights[2] = 0
    unseen = statistics(found.x, found.y, layout, weights, joint_scale=1.0)["input_std"][
        layout.inputs["rotations"]
    ]
    assert (unseen.reshape(-1, 6)[2] > 1e6).all() and (unseen.reshape(-1, 6)[3] < 1e3).all()
