"""lmm.pfnn.frames, lmm.mann.frames: who puts out a clip's own frames plays the clip; inputs; ends; labels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import lmm_models
import numpy as np
import pytest
from locomotion_models import CONTROLLERS, FRAMES, MODELS

from features.labels import Labels
from lmm.locomotion.labelling import labels_of
from lmm.locomotion.settings import LocomotionSettings
from lmm.locomotion.window import GAITS
from mm.control import Command
from mm.database import Database
from mm.description import Description
from motion import kinematics, quat


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module", params=MODELS)
def model(request: pytest.FixtureRequest, database: Database) -> Any:
    return MODELS[request.param](found=Description.of(database))


@pytest.fixture(scope="module")
def labels(database: Database, model: Any) -> Labels:
    """Any: a phase that goes round, gaits and contacts by chance."""
    rng, count = np.random.default_rng(0), len(database)
    contacts = rng.integers(0, 2, (count, len(model.contacts))).astype(np.uint8)
    phase = np.mod(np.arange(count) * 0.11, 2 * np.pi).astype(np.float32)
    return Labels(model.contacts, contacts, phase, rng.dirichlet(np.ones(6), count).astype(np.float32))


@pytest.fixture(scope="module")
def found(database: Database, model: Any, labels: Labels) -> Any:
    return FRAMES[model.family](database, labels)


def test_all_but_the_ends_of_ranges(database: Database, model: Any, labels: Labels, found: Any) -> None:
    ends = np.r_[database.starts, database.stops - 1]
    np.testing.assert_array_equal(found.frame, np.setdiff1d(np.arange(len(database)), ends))
    assert found.x.shape == (len(found.frame), model.layout.input_size)
    assert found.y.shape == (len(found.frame), model.layout.output_size)
    assert np.isfinite(found.x).all() and np.isfinite(found.y).all()
    if model.family == "pfnn":
        np.testing.assert_array_equal(found.phase, labels.phase[found.frame])


def test_who_puts_out_these_frames_plays_the_clip(
    database: Database, model: Any, labels: Labels, found: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller whose network tells the outputs in order goes the way of the data.

    It also remembers and predicts what the inputs of the frame to come say.
    """
    settings = LocomotionSettings(joint_smoothing=0.0, adjustment_ratio=0.0, foot_lock=False)
    controller, command = CONTROLLERS[model.family](model, settings=settings), Command.still(1)
    command.velocity[0] = 0, 2  # who stands does not go
    c, inputs = controller.characters, model.layout.inputs
    feet = [model.contacts.index(role) for role in database.contact_roles]
    for start, stop in zip(database.starts, database.stops, strict=True):
        truth = database.poses[slice(int(start), int(stop))]
        rows = np.flatnonzero((found.frame > start) & (found.frame < stop - 1))
        controller.reset(truth.positions[1:2, 0][:, [0, 2]], quat.yaw(truth.rotations[1:2, 0]))
        c["gait"], c["target_velocity"] = np.eye(6)[1], command.velocity
        if model.family == "pfnn":
            c["phase"] = labels.phase[start + 1]
        for i, row in enumerate(rows, start=1):
            monkeypatch.setattr(controller, "_evaluate", lambda *_, row=row: found.y[row : row + 1])
            poses = controller.step(command)
            np.testing.assert_allclose(poses.positions[0], truth.positions[i], atol=2e-4)
            assert quat.angle_between(poses.rotations[0], np.asarray(truth.rotations[i])).max() < 2e-3
            np.testing.assert_array_equal(controller.contacts()[0], labels.contacts[start + i, feet])
            if model.family == "pfnn":
                assert abs(np.mod(c["phase"][0] - labels.phase[start + i + 1] + 1, 2 * np.pi) - 1) < 1e-3
            # What is ahead is where the data goes, as far as it goes.
            ahead = np.minimum(i + 1 + 10 * np.arange(6), stop - start - 1)
            whole = ahead == i + 1 + 10 * np.arange(6)
            local = np.insert(c["future"][0, :, :2], 1, 0, axis=-1)
            world = c["root"][0, :2] + quat.rotate(quat.from_yaw(c["root"][0, 2]), local)[:, [0, 2]]
            np.testing.assert_allclose(world[whole], truth.positions[ahead[whole], 0][:, [0, 2]], atol=2e-3)
            if row == rows[-1]:
                break
            after = {name: found.x[row + 1, columns] for name, columns in inputs.items()}
            for name, fed in zip(("positions", "velocities", "rotations"), controller._fed, strict=False):
                np.testing.assert_allclose(after[name], fed.ravel(), atol=2e-3, err_msg=name)
            for a, name in enumerate(name for name in ("path", "facing", "going") if name in inputs):
                predicted = c["future"][0, :, 2 * a : 2 * a + 2]
                np.testing.assert_allclose(after[name].reshape(2, 12)[:, 6:], predicted.T, atol=2e-3)
            if "going" in inputs:
                velocity = np.insert(c["velocity"][0], 1, 0)
                arrived = quat.rotate(quat.from_yaw(-c["root"][0, 2]), velocity)[[0, 2]]
                np.testing.assert_allclose(after["going"][[6, 18]], arrived, atol=2e-2)


def test_inputs_are_of_the_frame_before_and_the_trajectory_now(
    database: Database, model: Any, found: Any, labels: Labels
) -> None:
    row = int(np.argmax(found.frame >= 62))
    t = int(found.frame[row])
    parts = model.layout.unpack_inputs(found.x[row : row + 1])
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
    for sample, k in ((0, -60), (4, -20), (6, 0)):
        np.testing.assert_allclose(parts.path[0, sample], local(at[k][0] - at[0][0], 0)[[0, 2]], atol=1e-5)
        turn = yaw[k] - yaw[0]
        np.testing.assert_allclose(parts.facing[0, sample], [np.sin(turn), np.cos(turn)], atol=1e-5)
        np.testing.assert_array_equal(parts.gaits[0, sample], labels.gait[t + k])
        if model.family == "mann":
            going = local(60 * (at[k] - at[k - 1])[0], 0)[[0, 2]]
            np.testing.assert_allclose(parts.going[0, sample], going, atol=1e-3)
    if model.family == "mann":
        expected = quat.mul(quat.inv(quat.from_yaw(yaw[-1])), turned[60, 1:])
        assert quat.angle_between(parts.rotations[0], expected).max() < 2e-3
    else:
        assert not parts.heights.any()


def test_beyond_its_ends_a_range_goes_straight_on(database: Database, model: Any, found: Any) -> None:
    last = int(np.flatnonzero(found.frame == database.stops[0] - 2)[0])
    path = model.layout.unpack_outputs(found.y[last : last + 1]).path[0]
    steps = np.diff(path, axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[:1], steps.shape), atol=1e-5)
    speed = np.linalg.norm(database.poses.velocities[database.stops[0] - 1, 0])
    assert np.linalg.norm(steps[0]) == pytest.approx(speed / 6, rel=0.2)


def test_which_of_its_two_quaternions_is_stored_says_nothing(
    database: Database, model: Any, labels: Labels, found: Any
) -> None:
    """A network would have to learn both, were it told one of them in a clip and the other in the next."""
    poses = database.poses[slice(0, len(database))].copy()
    poses.rotations[database.starts[1] : database.stops[1], database.skeleton.role("hips")] *= -1
    poses.rotations[5:20, database.skeleton.role("left_arm")] *= -1
    other = FRAMES[model.family](replace(database, poses=poses), labels)
    np.testing.assert_array_equal(other.x, found.x)
    np.testing.assert_array_equal(other.y, found.y)


def test_labels_must_fit(database: Database, model: Any, labels: Labels) -> None:
    with pytest.raises(ValueError, match="labels of 3 frames"):
        FRAMES[model.family](database, labels[0:3])


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
