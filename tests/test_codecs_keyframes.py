"""Key frames: what lies between is never farther off than stated, and few are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mm.codecs.compressed import compress
from mm.database import Database
from motion import kinematics, quat
from motion.errors import UserError
from motion.pose import Poses


@pytest.fixture(scope="module")
def database(walker_database: Database) -> Database:
    return walker_database


@pytest.mark.parametrize("name", ["keyframes-0.5", "keyframes-2+float16", "keyframes-1+quantised-11"])
def test_nothing_is_farther_off_than_stated(database: Database, name: str) -> None:
    """Joints, and what is fixed to them ten centimetres away."""
    small = compress(database, name, rigs=False)
    poses, _ = small.decode(np.arange(len(database), dtype=np.int32))
    away = 0.1 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])

    def places(shown: Poses) -> np.ndarray:
        positions, rotations = shown.positions.astype(float), shown.rotations.astype(float)
        positions[:, 0], rotations[:, 0] = 0, [1, 0, 0, 0]
        world, turned = kinematics.forward(database.skeleton, positions, rotations)
        return world[:, :, None] + quat.rotate(turned[:, :, None], away)

    off = 100 * np.linalg.norm(places(poses) - places(database.poses), axis=-1)
    stated = small.codec.keyframes
    assert stated is not None and 0.5 * stated < off.max() <= stated
    assert len(small.tables.keys) < 0.75 * len(database)


def test_a_larger_error_takes_fewer_frames(database: Database) -> None:
    kept = [len(compress(database, f"keyframes-{e}", rigs=False).tables.keys) for e in (0.1, 0.5, 2, 8)]
    assert kept == sorted(kept, reverse=True) and kept[0] > 2 * kept[-1]


def test_both_ends_of_every_range_are_kept(database: Database) -> None:
    keys = compress(database, "keyframes-8", rigs=False).tables.keys
    assert set(database.starts) | set(database.stops - 1) <= set(keys)
    assert np.diff(keys).max() <= 255


def test_a_clip_that_stands_still_is_its_ends(database: Database) -> None:
    still = database.poses.copy()
    for array in still.arrays().values():
        array[:300] = array[:1]
    keys = compress(replace(database, poses=still), "keyframes-0.5", rigs=False).tables.keys
    assert keys[keys < 300].tolist() == [0, 255, 299]


def test_rounding_that_errs_more_than_is_allowed_is_refused(database: Database) -> None:
    with pytest.raises(UserError, match=r"rounding alone is .* cm off.*more bits"):
        compress(database, "keyframes-0.01+quantised-8", rigs=False)
