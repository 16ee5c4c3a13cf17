"""Speeds that a database has, from roots whose speeds are known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mm import speeds
from mm.speeds import Speeds
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton


def database(*stretches: tuple[float, int], hips: float = 0.92):
    """What `of_database` looks at: frames that move at given speeds, in all directions."""
    speed = np.concatenate([np.full(frames, value) for value, frames in stretches])
    angle = np.linspace(0, 20, len(speed))
    poses = Poses.empty(len(speed), 2)
    poses.velocities[:, 0, 0], poses.velocities[:, 0, 2] = speed * np.sin(angle), speed * np.cos(angle)
    poses.positions[:, 1, 1] = hips
    skeleton = Skeleton(("root", "hips"), np.array([-1, 0]), np.zeros((2, 3)), {"root": 0, "hips": 1})
    return SimpleNamespace(poses=poses, skeleton=skeleton)


@pytest.mark.parametrize(
    "stretches, expected",
    [
        ([(0.0, 500), (1.3, 300), (3.2, 200)], (1.3, 3.2)),
        ([(0.0, 500), (0.8, 300), (1.3, 100)], (0.8, 1.3)),
        ([(0.0, 100), (2.5, 100), (4.0, 300)], (2.5, 4.0)),
        ([(0.1, 400)], (0.0, 0.0)),
        ([(1.3, 300), (3.2, 2)], (1.3, 1.3)),
    ],
    ids=["both", "walk only", "run only", "still", "hardly a run"],
)
def test_walk_and_run_are_found(stretches, expected):
    assert speeds.of_database(database(*stretches)) == pytest.approx(expected)


def test_what_is_a_run_depends_on_the_legs():
    # 1.7 m/s is a walk for hips at 0.92 m and a run for a dog's at 0.4 m.
    assert speeds.of_database(database((0.8, 100), (1.7, 50))) == pytest.approx((0.8, 1.7))
    assert speeds.of_database(database((0.8, 100), (1.7, 80), (2.0, 40), hips=0.4)) == pytest.approx(
        (0.8, 2.0)
    )
    assert speeds.of_database(database((0.8, 100), (1.7, 80), (2.0, 40))) == pytest.approx((1.7, 2.0))


def test_stick_speeds_are_checked():
    assert Speeds().run == (4.0, 3.0, 2.5) and Speeds().walk == (1.75, 1.5, 1.25)
    with pytest.raises(UserError, match="run"):
        Speeds(run=(1, 1, float("nan")))
    with pytest.raises(UserError, match="expected 3 values"):
        Speeds(run=(1, 1))  # type: ignore[arg-type]
