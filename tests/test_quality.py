"""mm.quality: the judgement of runs on grounds whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from features import terrain
from mm import quality
from mm.build import build


@pytest.fixture(scope="module")
def database(walker_files):
    return build([walker_files], jobs=1, mirror=False)


@pytest.fixture(scope="module")
def feet(database):
    return quality.Feet.of(database)


def tape(database, name, raised=lambda x, z: 0 * x):
    """A clip as if it had been recorded, one character, each frame as high as a ground under its root."""
    start, stop = next(
        (a, b) for a, b, n in zip(database.starts, database.stops, database.names, strict=True) if name in n
    )
    poses = database.poses[slice(start, stop)]
    positions = poses.positions[:, None].copy()
    positions[:, :, 0, 1] += raised(positions[:, :, 0, 0], positions[:, :, 0, 2])
    asked = np.zeros((stop - start, 1, 2), np.float32)
    return {
        "positions": positions,
        "rotations": poses.rotations[:, None],
        "contacts": database.contacts[start:stop][:, None],
        "command_velocity": asked,
        "command_yaw": asked[..., 0],
    }


def judged(database, feet, arrays, ground=None):
    return quality.judge(arrays, database.skeleton, database.fps, feet, None, ground=ground)


def test_heels_lie_behind_the_ankles_as_low_as_the_toes(database, feet):
    skeleton = database.skeleton
    assert feet.heels.joints == [skeleton.role("left_foot"), skeleton.role("right_foot")]
    arrays = tape(database, "stand")
    world, turned = quality.world_transforms(skeleton, arrays["positions"], arrays["rotations"])
    ankles, toes, heels = (
        world[:, :, feet.heels.joints],
        feet.place(world, turned),
        feet.heels.place(world, turned),
    )
    np.testing.assert_allclose(heels[..., 1], toes[..., 1], atol=2e-3)
    np.testing.assert_allclose((heels - ankles)[..., [0, 2]], -0.4 * (toes - ankles)[..., [0, 2]], atol=2e-3)
    np.testing.assert_allclose(feet.heels.rest, feet.rest, atol=5e-3)


@pytest.mark.parametrize("name", ["straight", "run"])
def test_level_ground_leaves_every_number_as_it_is(database, feet, name):
    arrays = tape(database, name)
    plain, trace = judged(database, feet, arrays)
    level = terrain.Heightmap(np.zeros((40, 30), np.float32), 0.5)
    for ground in (terrain.flat, level):
        row, same = judged(database, feet, arrays, ground)
        assert set(row) - set(plain) == {"sink_cm", "sink_p99_cm", "hover_cm"}
        np.testing.assert_equal({key: row[key] for key in plain}, plain)
        assert same.same(trace) and np.array_equal(same.low, trace.low)


def test_who_walks_as_high_as_the_ground_does_as_on_level_ground(database, feet):
    def high(x, z):
        return np.full_like(x, 1.5)

    plain, trace = judged(database, feet, tape(database, "straight"), terrain.flat)
    row, same = judged(database, feet, tape(database, "straight", high), high)
    assert row == pytest.approx(plain, rel=1e-3, abs=1e-3, nan_ok=True)
    assert np.array_equal(same.low, trace.low)
    assert plain["skate_cm_s"] > 0 and plain["sink_cm"] < 0.5 and plain["hover_cm"] < 0.5


@pytest.mark.parametrize(("off", "sinks", "hovers"), [(0.03, 3, 0), (-0.03, 0, 3)])
def test_who_stands_off_the_ground_is_told_by_how_much(database, feet, off, sinks, hovers):
    arrays = tape(database, "stand")
    assert arrays["contacts"].all()
    row, trace = judged(database, feet, arrays, lambda x, z: np.full_like(x, off))
    assert row["sink_cm"] == pytest.approx(sinks, abs=0.1)
    assert row["sink_p99_cm"] == pytest.approx(sinks, abs=0.1)
    assert row["hover_cm"] == pytest.approx(hovers, abs=0.1)
    assert (trace.low == (off > 0)).all()


def test_the_clips_stand_on_the_level_ground_that_they_were_captured_on(database, feet):
    plain, on_ground = quality.of_data(database, feet), quality.of_data(database, feet, on_ground=True)
    np.testing.assert_equal({key: on_ground[key] for key in plain}, plain)
    assert 0 <= on_ground["sink_cm"] < 0.3 and 0 <= on_ground["hover_cm"] < 0.3
