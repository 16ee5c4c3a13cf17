"""The ground root in few bits: it never leaves its way by more than rounding one step."""

from __future__ import annotations

import numpy as np
import pytest

from mm.codecs import root
from mm.database import Database
from mm.stages import root_steps
from motion import springs


@pytest.fixture(scope="module")
def database(walker_database: Database) -> Database:
    return walker_database


def off(database: Database, steps: np.ndarray) -> tuple[float, float]:
    """How far steps lead from the root's way: metres, and radians of what it faces."""
    truth = root.path(database)
    apart = root.follow(steps, truth[database.starts], database.starts, database.stops) - truth
    return float(np.hypot(*apart[:, :2].T).max()), float(np.abs(springs.wrap(apart[:, 2])).max())


def test_exact_steps_are_followed_to_where_the_root_is(database: Database) -> None:
    metres, radians = off(database, root_steps(database))
    assert metres < 1e-4 and radians < 1e-4


def test_codes_lead_no_farther_off_than_half_of_one(database: Database) -> None:
    codes, scale = root.coded(database)
    assert codes.dtype == np.int16 and scale.shape == (6,)
    metres, radians = off(database, codes.astype(np.float64) * scale)
    assert metres <= np.hypot(*scale[:2]) / 2 * 1.001 and radians <= scale[2] / 2 * 1.001
    np.testing.assert_allclose(codes * scale, root_steps(database), atol=2 * scale.max())


def test_half_floats_lead_no_farther_off_than_half_of_the_last_bit_of_a_step(database: Database) -> None:
    steps = root.halves(database)
    assert steps.dtype == np.float16
    most = np.abs(root_steps(database)).max(axis=0)
    metres, radians = off(database, steps)
    assert metres <= np.hypot(*most[:2]) * 2.0**-11 * 1.01 and radians <= most[2] * 2.0**-11 * 1.01
    # Rounded each by itself they lead astray.
    alone, _ = off(database, root_steps(database).astype(np.float16))
    assert alone > 3 * metres


def test_a_range_of_one_frame_stands_still(database: Database) -> None:
    from dataclasses import replace

    short = replace(
        database,
        poses=database.poses[slice(0, 3)],
        starts=np.array([0, 1], np.int32),
        stops=np.array([1, 3], np.int32),
        features=database.features[:3],
    )
    codes, _ = root.coded(short)
    assert not codes[0, :3].any()
    np.testing.assert_array_equal(codes[1, :3], codes[2, :3])
