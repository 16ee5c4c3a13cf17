"""Queries of a driven controller: real ones, repeatable, answered and costed as the controller would."""

from __future__ import annotations

import numpy as np
import pytest

from mm import queries
from mm.build import build
from mm.controller import Controller
from mm.course import Course, RandomUser, VelocityKey
from mm.settings import Settings


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def tagged(database):
    """The same with half of its clips tagged "crouch"."""
    low = np.isin(database.names, ["left_turn", "stand"])[database.ranges()]
    return type(database)(**(vars(database) | {"tags": low.astype(np.uint32), "tag_names": ("crouch",)}))


@pytest.fixture(scope="module")
def recorded(database):
    return queries.record(database, 600, index="brute")


def test_queries_are_as_many_as_asked_and_the_same_every_time(database, recorded):
    assert len(recorded) == 600 and recorded.features.shape == (600, database.schema.size)
    assert recorded.radius == 20 and recorded.ignore_end == 20
    again = queries.record(database, 600, index="aabb")  # exact as well, so the run is the same
    np.testing.assert_array_equal(again.features, recorded.features)
    np.testing.assert_array_equal(again.current, recorded.current)
    other = queries.record(database, 600, seed=1)
    assert not np.array_equal(other.features, recorded.features)


def test_whoever_is_recorded_is_no_user_of_a_course(database):
    """Systems may be compared on any course: none was trained on."""
    courses = {RandomUser(seed=seed).keys(20) for seed in range(8)}
    recorded = {queries.random_user(database, 60, seed=seed).random.keys(20) for seed in range(8)}
    assert len(courses) == len(recorded) == 8 and not courses & recorded


def test_the_bound_is_the_cost_of_playing_on(database, recorded):
    finite = np.isfinite(recorded.bound)
    assert finite.mean() > 0.5
    difference = recorded.features - database.features[recorded.current]
    playing_on = (1 - Settings().continuing_bias) * (difference**2).sum(axis=1)
    np.testing.assert_allclose(recorded.bound[finite], playing_on[finite], rtol=1e-4, atol=1e-4)


def test_the_pose_of_a_query_is_what_plays_and_its_trajectory_is_not(database, recorded):
    difference = recorded.features - database.features[recorded.current]
    np.testing.assert_array_equal(difference[:, database.schema.pose_columns()], 0)
    assert np.abs(difference[:, database.schema.trajectory_columns()]).mean() > 0.1


def test_a_crowd_asks_for_many_things(database):
    """No two characters are asked the same at once: commands, and so queries, differ."""
    found = queries.record(database, 1000, characters=50)
    assert len(np.unique(found.features[50:100], axis=0)) > 40
    goals = found.features[:, database.schema.trajectory_columns()[:6]]
    assert np.all(goals.std(axis=0) > 0.2)


def test_a_crowd_plays_nothing_but_what_is_searched(database):
    some = np.arange(len(database.starts)) % 2 == 0
    found = queries.record(database, 300, index=queries.index_of(database, ranges=some))
    assert some[database.ranges()[found.current]].all()
    assert not some[database.ranges()[queries.record(database, 300).current]].all()


def test_a_listener_leaves_the_controller_as_it_was(database):
    controller = Controller(database, count=2, settings=queries.SETTINGS)
    before = controller.stages.projection
    course = Course(velocity=(VelocityKey(time=0, velocity=(0, 1)),), seconds=5)
    found = queries.listen(controller, course, 30)
    assert len(found) == 30 and controller.stages.projection is before


def test_crouches_are_asked_for_where_the_database_has_them(database, tagged, recorded):
    found = queries.record(tagged, 1000)
    assert set(np.unique(found.required)) == {0, 1}
    np.testing.assert_array_equal(found.required ^ found.forbidden, 1)  # who is not to crouch must not
    frames, _ = queries.neighbours(tagged, found)
    asked = frames >= 0
    assert asked.all()
    np.testing.assert_array_equal(tagged.tags[frames], found.required)
    assert not recorded.required.any() and not recorded.forbidden.any()


def _nearest(database, asked, allowed):
    """By hand: costs [M, T] of every frame, infinite where it may not be had."""
    costs = ((asked.features[:, None] - database.features[None]) ** 2).sum(axis=-1)
    frames = np.arange(len(database))
    left = database.stops[database.ranges()] - frames
    barred = ~allowed[database.ranges()] | (left <= asked.ignore_end)
    near = np.abs(frames[None] - asked.current[:, None]) < asked.radius
    lacks = (asked.required[:, None] & ~database.tags) != 0
    lacks |= (asked.forbidden[:, None] & database.tags) != 0
    return np.where(barred[None] | near | lacks, np.inf, costs)


@pytest.mark.parametrize("some", [False, True])
def test_neighbours_are_the_nearest_that_may_be_had(tagged, some):
    asked = queries.record(tagged, 400).take(slice(300, None))
    allowed = np.ones(len(tagged.starts), bool)
    if some:
        allowed[::3] = False
    frames, costs = queries.neighbours(tagged, asked, ranges=allowed)
    truth = _nearest(tagged, asked, allowed)
    np.testing.assert_allclose(costs, truth.min(axis=1), rtol=1e-4)
    np.testing.assert_allclose(truth[np.arange(100), frames], truth.min(axis=1), rtol=1e-4)
    index = queries.index_of(tagged, ranges=np.flatnonzero(allowed), name="brute")
    np.testing.assert_array_equal(queries.neighbours(index, asked)[1], costs)


def test_bounded_neighbours_beat_playing_on_or_are_none(database, recorded):
    frames, costs = queries.neighbours(database, recorded)
    jumps, bounded = queries.neighbours(database, recorded, bounded=True)
    better = costs < recorded.bound
    assert 0 < better.mean() < 1
    np.testing.assert_array_equal(jumps, np.where(better, frames, -1))
    np.testing.assert_array_equal(bounded, np.where(better, costs, recorded.bound))


def test_no_frame_that_may_be_had_is_none_and_infinitely_far(database, recorded):
    frames, costs = queries.neighbours(database, recorded.take(slice(5)), ranges=[])
    assert np.all(frames == -1) and np.all(np.isinf(costs))
    assert len(queries.residuals(database, recorded.take(slice(5)), ranges=[])) == 0


def test_residuals_lead_from_the_nearest_row_to_the_query(database, recorded):
    frames, costs = queries.neighbours(database, recorded)
    found = queries.residuals(database, recorded)
    np.testing.assert_allclose(database.features[frames] + found, recorded.features, atol=1e-5)
    scale = queries.noise(database, recorded)
    assert scale.shape == (database.schema.size,)
    assert np.sum(scale.astype(float) ** 2) == pytest.approx(costs.astype(float).mean(), rel=1e-4)


def test_queries_are_not_rows_of_the_database(database, recorded):
    """What is asked lies off the data: the nearest row is at a distance, and which one it is changes."""
    frames, costs = queries.neighbours(database, recorded)
    assert np.median(costs) > 0.01
    assert len(np.unique(frames)) > 20


def test_skeletons_without_legs_can_be_searched(walker_files):
    database = build([walker_files], jobs=1, roles_only=True)
    assert len(queries.record(database, 24, index="brute")) == 24
