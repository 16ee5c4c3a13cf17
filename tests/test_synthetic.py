"""The synthetic walker is as true as the tests that rely on it assume."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic

from motion import kinematics, quat
from motion.clip import Clip

GAITS = {"straight": "walk", "left_turn": "walk", "right_turn": "walk", "stand": "stand", "run": "run"}


def world(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


@pytest.mark.parametrize("name", GAITS)
def test_planted_feet_stay_and_lifted_feet_move(walker_clips: list[Clip], name: str) -> None:
    clip = {c.name: c for c in walker_clips}[name]
    planted = synthetic.planted(clip, GAITS[name])
    both = planted[1:] & planted[:-1]
    positions, _ = world(clip)
    for side, column in (("left", 0), ("right", 1)):
        for part in ("foot", "toe"):
            joint = clip.skeleton.role(f"{side}_{part}")
            speed = np.linalg.norm(np.diff(positions[:, joint], axis=0), axis=-1) * clip.fps
            assert speed[both[:, column]].max() < 1e-6
            if GAITS[name] != "stand":
                assert speed[~planted[1:, column] & ~planted[:-1, column]].max() > 2 * 1.2
    assert 0 < positions[..., 1].min() < 0.03
    assert 1.5 < positions[..., 1].max() < 1.7


@pytest.mark.parametrize(("turn", "sign"), [(0.0, 0), (0.8, 1), (-0.8, -1)])
def test_speed_and_turn_are_as_asked(turn: float, sign: int) -> None:
    clip = synthetic.walk(speed=1.2, turn=turn, seconds=4.0)
    path = np.linalg.norm(np.diff(clip.positions[:, 0, [0, 2]], axis=0), axis=-1).sum()
    assert path == pytest.approx(1.2 * 4.0, rel=0.01)
    yaw = np.unwrap(quat.yaw(clip.rotations[:, 0]))
    assert yaw[-1] - yaw[0] == pytest.approx(turn * 4.0, abs=0.2)
    assert np.sign(np.round(clip.positions[-1, 0, 0], 1)) == sign  # left is +X


def test_the_pose_is_that_of_a_humanoid_facing_forwards(walker: Clip) -> None:
    positions, _ = world(walker)
    inverse = quat.inv(quat.from_yaw(quat.yaw(walker.rotations[:, :1])))
    seen = quat.rotate(np.broadcast_to(inverse, (*positions.shape[:2], 4)), positions - positions[:, :1])
    role = walker.skeleton.role
    assert np.all(seen[:, role("left_hand"), 0] > 0)
    assert np.all(seen[:, role("right_hand"), 0] < 0)
    knee, hip, foot = (seen[:, role(f"left_{part}")] for part in ("leg", "up_leg", "foot"))
    assert np.all((knee - (hip + foot) / 2)[:, 2] > 0)  # knees bend forwards
    assert np.all(seen[:, role("left_toe"), 2] > foot[:, 2])


def test_it_is_the_same_every_time(walker: Clip) -> None:
    again = synthetic.walk("walker", turn=synthetic.weave)
    assert np.array_equal(again.positions, walker.positions)
    assert np.array_equal(again.rotations, walker.rotations)
    assert (len(walker), walker.fps, len(walker.skeleton)) == (300, 60.0, 22)
