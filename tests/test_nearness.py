"""Distances to other poses: of known offsets, out of step, and to the nearest of the data by brute force."""

from __future__ import annotations

import numpy as np
import pytest

from mm import quality
from mm.course import Course, VelocityKey
from mm.driving import Again, Clock, Diverged, Replay
from mm.nearness import RealPoses, difference
from mm.recording import record
from motion.console import silent

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def test_the_difference_is_the_mean_distance_of_the_joints():
    poses = RNG.normal(size=(5, 4, 3))
    shifted = poses.copy()
    shifted[:, 0] += (0.03, 0.04, 0)  # one joint of four by 5 cm
    np.testing.assert_allclose(difference(poses, shifted), np.full(5, 5 / 4))
    with pytest.raises(ValueError, match="poses"):
        difference(poses, poses[:1])


@pytest.mark.parametrize("late", [-3, 2])
def test_a_window_forgives_being_out_of_step_and_no_more(late):
    walk = RNG.normal(size=(40, 6, 3))
    other = np.roll(walk, late, axis=0)
    inner = slice(3, -3)
    assert difference(walk, other)[inner].min() > 50
    assert difference(walk, other, window=abs(late) - 1)[inner].min() > 50
    np.testing.assert_array_equal(difference(walk, other, window=abs(late))[inner], 0)
    # At the ends there is less to look at, but always the same frame of the other.
    assert np.isfinite(difference(walk[:2], other[:2], window=9)).all()


def local(database, frames):
    poses = database.poses[frames]
    return quality.in_root_space(database.skeleton, poses.positions, poses.rotations)


def test_the_nearest_real_pose_is_that_of_brute_force(database, monkeypatch):
    monkeypatch.setattr("mm.nearness.CHUNK", 700)  # the walker has 3,000 frames
    every = local(database, slice(None))
    asked = every[::171] + RNG.normal(0, 0.05, every[::171].shape)
    apart = np.linalg.norm(asked[:, None] - every, axis=-1)
    nearest = np.square(apart).sum(axis=-1).argmin(axis=1)
    expected = 100 * apart[np.arange(len(asked)), nearest].mean(axis=-1)
    real = RealPoses(database)
    np.testing.assert_allclose(real.distances(asked), expected, rtol=1e-4)
    np.testing.assert_allclose(real.distances(every[::500]), 0, atol=1e-4)


def test_where_a_pose_stands_and_looks_does_not_count(database):
    poses = database.poses[np.arange(0, len(database), 500)].copy()
    poses.positions[:, 0] += (3, 0, -7)
    poses.rotations[:, 0] = (np.cos(0.4), 0, np.sin(0.4), 0)
    moved = quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
    np.testing.assert_allclose(RealPoses(database).distances(moved), 0, atol=1e-4)


class Point:
    """Goes as it is told, times a factor."""

    name, fps, count = "point", 60.0, 1

    def __init__(self, database, factor):
        self.skeleton, self.factor, self.pose = database.skeleton, factor, database.poses[:1].copy()
        self.asked = []

    def reset(self, positions, yaws):
        self.asked = []
        self.pose.positions[:, 0] = 0

    def step(self, command):
        self.asked.append(command.velocity.copy())
        self.pose.positions[:, 0, [0, 2]] += self.factor * command.velocity / self.fps
        return self.pose

    def record(self):
        return {}


def test_a_replay_asks_what_was_asked_wherever_the_system_goes(database):
    keys = (VelocityKey(time=0.0, velocity=(0.0, 1.0)), VelocityKey(time=0.2, velocity=(1.0, 0.0)))
    course = Course(name="two", velocity=keys, seconds=0.5)
    options = {"progress": silent}
    first, clock = Point(database, 1.0), Clock(course, 1, 60.0)
    before = record(first, course, driver=clock, **options)
    other = Point(database, 2.0)
    after = record(other, course, driver=Replay(clock), seconds=9.0, **options)
    assert len(after) == len(before) == 30
    np.testing.assert_array_equal(other.asked, first.asked)
    np.testing.assert_allclose(after["positions"][:, 0, 0], 2 * before["positions"][:, 0, 0], atol=1e-6)
    with pytest.raises(Diverged):
        record(Point(database, 2.0), course, driver=Again(clock), **options)
    again = record(Point(database, 1.0), course, driver=Again(clock), **options)
    np.testing.assert_array_equal(again["positions"], before["positions"])


def test_a_run_is_judged_by_evenly_spread_frames(database):
    keys = (VelocityKey(time=0.0, velocity=(0.0, 1.0)),)
    course = Course(name="on", velocity=keys, seconds=10.0)
    run = record(Point(database, 1.0), course, progress=silent)
    pose, frames = database.poses[np.arange(0, len(database), 5)[: len(run)]], len(run)
    run["positions"][:, 0], run["rotations"][:, 0] = pose.positions, pose.rotations
    run["positions"][0, 0, 3] += 0.3  # frames that count are not on the data
    run["positions"][-1, 0, 3] += 0.3
    real = RealPoses(database)
    off = real.distances(
        quality.in_root_space(run.skeleton, *(run[n][[0, -1], 0] for n in ("positions", "rotations")))
    )
    assert frames == 600 and real.of_run(run) == pytest.approx(off.sum() / 300, rel=1e-3)
