"""mm.grounded: a controller's characters on a ground, what is put on it and what stays the controller's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pfnn_models
import pytest

from features import terrain, terrain_made
from lmm.pfnn.controller import PhaseController
from mm import courses
from mm.control import Command
from mm.controller import Controller
from mm.description import Description
from mm.ground_feet import GroundFeet
from mm.grounded import Grounded
from mm.recording import record
from mm.settings import Settings
from motion import kinematics, quat
from motion.errors import UserError

HILLS = terrain_made.make(4, "hills", size=(30, 30))


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def ahead(count: int) -> Command:
    command = Command.still(count)
    command.velocity[:, 1] = 1.2
    return command


def test_level_ground_changes_nothing(database):
    one, other = Controller(database, count=2), Grounded(Controller(database, count=2), terrain.flat)
    for _ in range(60):
        found, expected = other.step(ahead(2)), one.step(ahead(2))
        for name, array in expected.arrays().items():
            np.testing.assert_array_equal(found.arrays()[name], array, err_msg=name)
    np.testing.assert_array_equal(other.record()["frame"], one.record()["frame"])


def test_it_is_the_controller_with_feet_put_on_the_ground(database):
    plain, put = Controller(database), Grounded(Controller(database), HILLS)
    feet = GroundFeet(database.skeleton, Description.of(database).feet(), 60.0, 1, ground=HILLS)
    for frame in range(90):
        if frame == 45:  # both forget where they were
            plain.reset([[3, 1]], [2.0])
            put.reset([[3, 1]], [2.0])
            feet.reset()
        expected = plain.step(ahead(1)).copy()
        feet.apply(plain.contacts(), expected.positions, expected.rotations)
        found = put.step(ahead(1))
        np.testing.assert_array_equal(found.positions, expected.positions)
        np.testing.assert_array_equal(found.rotations, expected.rotations)
        np.testing.assert_array_equal(put.record()["positions"], found.positions)
        np.testing.assert_array_equal(put.record()["rotations"], found.rotations)
    assert abs(float(found.positions[0, 0, 1])) > 0.02


def test_a_run_over_hills_stands_on_them(database):
    system = Grounded(Controller(database), HILLS)
    system.timed = True
    run = record(system, courses.load("circle"), seconds=5, progress=lambda it, **_: it)
    root = run["positions"][:, 0, 0]
    away = root[:, 1] - HILLS(root[:, 0], root[:, 2])
    assert np.ptp(root[:, 1]) > 0.1 and np.abs(away).max() < 0.05
    legs = Description.of(database).feet()
    world, turned = kinematics.forward(
        database.skeleton, run["positions"][:, 0].astype(float), run["rotations"][:, 0].astype(float)
    )
    joints = legs.joints[:, 3]
    touch = world[:, joints] + quat.rotate(turned[:, joints], legs.points)
    above = touch[..., 1] - HILLS(touch[..., 0], touch[..., 2])
    held = run["locked"][:, 0]
    assert held.mean() > 0.2 and np.percentile(np.abs(above[held] - legs.heights.mean()), 95) < 0.03
    assert run.stages[-1] == "ground" and (run.stage_seconds[:, -1] > 0).all()
    assert system.memory()["ground"] > 0


def test_who_is_put_somewhere_stands_there_before_the_first_step(database):
    put, plain = Grounded(Controller(database), HILLS), Controller(database)
    for system in (put, plain):
        system.reset([[3, 1]], [2.0])
    root, joints = (put.record()["positions"][0, where] for where in (0, slice(1, None)))
    assert abs(root[1] - float(HILLS(np.array(3.0), np.array(1.0)))) < 0.05
    np.testing.assert_allclose(joints[1:], plain.record()["positions"][0, 2:], atol=1e-6)


def test_a_network_that_sees_the_ground_keeps_its_height():
    """Its poses are made for the ground: a step up that it was told of is not taken twice."""

    def high(x, z):
        return 0 * x + 2.5

    plain = PhaseController(pfnn_models.model(), ground=high)
    put = Grounded(PhaseController(pfnn_models.model(), ground=high), high, follow=False)
    for _ in range(10):
        found, expected = put.step(ahead(1)), plain.step(ahead(1))
        np.testing.assert_allclose(found.positions[0, 0], expected.positions[0, 0], atol=1e-6)


def test_without_legs_there_is_nothing_to_put_on_a_ground(database):
    skeleton = database.skeleton
    roles = {role: joint for role, joint in skeleton.roles.items() if role != "left_leg"}
    bare = replace(database, skeleton=skeleton.with_roles(roles))
    with pytest.raises(UserError, match="no feet to put on a ground: foot locking needs the whole leg"):
        Grounded(Controller(bare, settings=Settings(foot_lock=False)), HILLS)
