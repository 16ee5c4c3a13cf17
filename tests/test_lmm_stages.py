"""Learned stages alone: against formulas and the networks themselves."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

from lmm import mixtures
from lmm.stages import DecompressorDecompression, LatentState, ProjectorProjection, StepperStepping
from mm.control import Command
from mm.controller import Controller
from motion import quat
from motion.errors import UserError
from motion.pose import Poses


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def model(database):
    return lmm_models.model(database)


def test_a_projector_is_told_whether_to_crouch():
    crouching = lmm_models.database(crouch=True)
    model = lmm_models.model(crouching)
    tag = np.uint32(model.description.crouch_tag)
    assert tag
    projection = ProjectorProjection(model)
    queries, bound = crouching.features[[9, 9]], np.full(2, np.inf, np.float32)
    required, state = np.array([tag, 0], np.uint32), StepperStepping(model).start(2)
    found, _, _ = projection.project(queries, state, bound, required, tag - required)
    np.testing.assert_array_equal(found.tags(), required)
    asked = np.concatenate([queries, [[1], [0]]], axis=1, dtype=np.float32)
    np.testing.assert_allclose(found.values, model.projector.evaluate(asked), atol=1e-5)
    assert np.abs(found.values[0] - found.values[1]).max() > 0.01
    assert projection.possible(int(tag), 0) and projection.possible(0, int(tag))
    assert not projection.possible(int(tag), int(tag)) and not projection.possible(2, 0)


def test_what_was_answered_a_moment_ago_is_no_answer_again(database, model):
    """As motion matching leaves out the frames around the one that plays."""
    projection, stepping = ProjectorProjection(model, ignore_radius=3), StepperStepping(model)
    queries, tags = database.features[[5, 300]], np.zeros(2, np.uint32)
    state, never = stepping.start(2), np.full(2, np.inf, np.float32)
    dear = np.full(2, 1e9, np.float32)
    state, _, found = projection.project(queries, state, never, tags, tags)
    assert found.all()
    for step in range(4):
        _, _, found = projection.project(queries, state, dear, tags, tags)
        assert (found == (step >= 3)).all()
        _, _, found = projection.project(queries, state, never, tags, tags)  # it cannot play on
        assert found.all()
        _, _, found = projection.project(queries[::-1].copy(), state, dear, tags, tags)
        assert found.all()
        stepping.step(state)
    forgetful = ProjectorProjection(model)
    state, _, _ = forgetful.project(queries, stepping.start(2), never, tags, tags)
    assert forgetful.project(queries, state, dear, tags, tags)[2].all()


def test_poses_are_those_of_the_decompressor(model, database):
    values = np.random.default_rng(1).normal(size=(70, model.F + model.L)).astype(np.float32)
    poses, contacts = Poses.empty(70, len(database.skeleton)), np.zeros((70, 2), np.uint8)
    DecompressorDecompression(model).decompress(LatentState.of(values, model.F), poses, contacts)
    expected, feet = model.layout.unpack(model.decompressor.evaluate(values), database.fps)
    np.testing.assert_allclose(poses.positions, expected.positions, atol=1e-5)
    angles = quat.angle_between(poses.rotations.astype(float), expected.rotations.astype(float))
    assert angles.max() < 3e-3
    np.testing.assert_array_equal(contacts, feet)


def test_learned_states_are_taken_and_put_apart():
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    state = LatentState(values.copy(), 3, np.array([1, 2, 4], np.uint32), np.array([7, 8, 9], np.int32))
    state.since[:], state.moved[:], state.age[:] = [4, 5, 6], [True, False, False], [1, 2, 3]
    two = state.take(np.array([2, 0]))
    two.values[:] += 100
    two.since[:] += 10
    np.testing.assert_array_equal(state.values, values)
    state.put(np.array([0, 1]), two)
    np.testing.assert_array_equal(state.features()[:, 0], [108, 100, 8])
    np.testing.assert_array_equal(state.latents()[:, 0], [111, 103, 11])
    np.testing.assert_array_equal(state.tags(), [4, 1, 4])
    np.testing.assert_array_equal(state.near, [9, 7, 9])
    np.testing.assert_array_equal(state.since, [16, 14, 6])
    np.testing.assert_array_equal(state.age, [3, 1, 3])
    np.testing.assert_array_equal(state.landed[:, 0], [8, 0, 8])
    np.testing.assert_array_equal(state.jumped(), [1])
    ended = np.ones(3, np.bool_)
    state.ended(ended)
    assert len(state) == 3 and (state.frames() == -1).all() and not ended.any()


def test_tags_that_a_projector_does_not_know_are_refused():
    model = lmm_models.model(lmm_models.database(crouch=True))
    named = replace(model, description=replace(model.description, tag_names=("crouch", "hop")))
    system = Controller(named.description, three_stages=mixtures.stages(named))
    command = Command.still(1)
    command.required_tags[:] = 2
    with pytest.raises(UserError, match="does not know: hop"):
        system.step(command)
