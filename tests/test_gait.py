"""Gait weights: of planned dances, of made jumps and falls, of bodies of any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic

from features import contacts as touching
from features import gait as gaits
from features.gait import GAITS
from motion import kinematics
from motion.clip import Clip
from motion.dancecard import Move, Style, perform
from motion.errors import UserError


def decide(clip: Clip):
    world = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    names, found = touching.find(clip.skeleton, clip.fps, *world)
    return gaits.decide(clip.skeleton, clip.fps, world[0], names, found)


def scaled(clip: Clip, size: float) -> Clip:
    """A body of another size that moves likewise: lengths grow as size, times as its root (equal Froude)."""
    ends = {joint: end * size for joint, end in clip.skeleton.end_sites.items()}
    skeleton = replace(clip.skeleton, offsets=clip.skeleton.offsets * size, end_sites=ends)
    return clip.replace(skeleton=skeleton, positions=clip.positions * size, fps=clip.fps / np.sqrt(size))


@pytest.fixture(scope="module")
def dance():
    moves = [
        Move(3),
        Move(4, 1.3),
        Move(4, 3.0, gait="run"),
        Move(3),
        Move(4, 0.8, gait="crouch"),
        Move(4),
        Move(4, 0, 0.8),
        Move(4, turn=200),
    ]
    return perform(moves, name="all", style=Style(), rng=np.random.default_rng(0))


@pytest.mark.parametrize("size", [0.7, 1.0, 1.3])
def test_gaits_of_a_dance(dance, size):
    found = decide(scaled(dance.clip, size))
    at = [int(60 * seconds) for seconds in (1.5, 5.5, 9.5, 16.0, 21.0, 24.5, 28.0)]
    assert [GAITS[k] for k in found[at]] == ["stand", "walk", "jog", "crouch", "stand", "walk", "walk"]


def test_most_frames_are_as_planned(dance):
    found = decide(dance.clip)
    assert np.mean(found == dance.labels.gait) > 0.9
    assert len(np.flatnonzero(np.diff(found))) < 12  # no flicker


@pytest.mark.parametrize("fps", [30, 60, 120])
@pytest.mark.parametrize(
    ("gait", "speed", "name"), [("stand", 0, "stand"), ("walk", 1.2, "walk"), ("run", 3, "jog")]
)
def test_gaits_at_any_rate(gait, speed, name, fps):
    found = decide(synthetic.walk(gait=gait, speed=float(speed), seconds=6, fps=fps))
    assert np.mean(found == GAITS.index(name)) > 0.95


def leap(seconds: float, fps: float = 60.0) -> Clip:
    """A body that stands, rises in free flight for some time as it is, and stands again."""
    clip = synthetic.walk(gait="stand", speed=0.0, seconds=4, fps=fps)
    t = np.arange(len(clip)) / fps - 2
    height = np.maximum(gaits.GRAVITY / 2 * ((seconds / 2) ** 2 - t**2), 0)
    positions = clip.positions.copy()
    positions[:, 0, 1] += height
    return clip.replace(positions=positions)


def test_a_leap_is_a_jump_and_a_hop_is_none():
    found = decide(leap(0.5))
    assert (found[[115, 120, 125]] == gaits.JUMP).all()
    spans = touching.spans(found == gaits.JUMP)
    assert len(spans) == 1 and 0.5 < (spans[0][1] - spans[0][0]) / 60 < 1.0
    assert not (decide(leap(0.15)) == gaits.JUMP).any()


def test_who_lies_down_does_something_else():
    clip = synthetic.walk(gait="stand", speed=0.0, seconds=4)
    positions, rotations = clip.positions.copy(), clip.rotations.copy()
    positions[:, 0, 1] = 0.2
    rotations[:, 0] = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]  # face down
    assert (decide(clip.replace(positions=positions, rotations=rotations)) == gaits.OTHER).all()


def test_a_skeleton_without_a_head_is_told_by_its_hips(dance):
    roles = {role: joint for role, joint in dance.clip.skeleton.roles.items() if role != "head"}
    found = decide(dance.clip.replace(skeleton=dance.clip.skeleton.with_roles(roles)))
    assert np.mean(found == dance.labels.gait) > 0.9


def test_a_skeleton_without_hips_is_one_line(walker):
    roles = {role: joint for role, joint in walker.skeleton.roles.items() if role != "hips"}
    with pytest.raises(UserError, match="no joint plays the role 'hips'"):
        decide(walker.replace(skeleton=walker.skeleton.with_roles(roles)))


def test_weights_blend_and_sum_to_one():
    gait = np.repeat([0, 1, 2], [60, 60, 60])
    found = gaits.weights(gait, 60)
    assert found.dtype == np.float32 and found.shape == (180, 6)
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-6)
    assert found[30, 0] == found[90, 1] == found[150, 2] == 1
    assert found[60, 0] == pytest.approx(found[59, 1], abs=1e-6) and 0.4 < found[60, 1] < 0.6
    assert np.abs(np.diff(found, axis=0)).max() < 0.06  # about 0.4 s from one to the other
    np.testing.assert_array_equal(gaits.weights(gait, 60, smooth=0), np.eye(6)[gait])
    assert gaits.weights(np.zeros(0, int), 60).shape == (0, 6)


def test_short_spells_are_taken_for_what_is_around():
    gait = np.repeat([1, 2, 1, 0], [60, 12, 60, 120])
    assert gaits.settle(gait, 60).tolist() == np.repeat([1, 0], [132, 120]).tolist()


def test_few_frames(walker):
    for frames in (1, 2, 3):
        clip = walker.replace(positions=walker.positions[:frames], rotations=walker.rotations[:frames])
        assert decide(clip).shape == (frames,)
    empty = np.zeros((0, len(walker.skeleton), 3))
    assert gaits.decide(walker.skeleton, 60, empty, ("left_foot", "right_foot"), np.zeros((0, 2))).shape == (
        0,
    )
