"""What is there twice: nearest frames by brute force, copies that were put there, what may go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.data import duplicates
from bench.data.clips import Clips
from bench.data.duplicates import Twice
from features import normalise
from features.schema import Feature, Schema
from mm import quality
from motion.pose import Poses

SQUARED = Schema("squared", (Feature("hips", "velocity", role="hips"),))
ABSOLUTE = Schema("absolute", (Feature("hips", "velocity", role="hips", residual="absolute"),))


def clips(*lengths, fps=10.0):
    stops = np.cumsum(lengths)
    names = tuple(f"clip{i}" for i in range(len(lengths)))
    return Clips(100 + np.arange(stops[-1]), stops - lengths, stops, names, fps)


def local(database, own):
    poses = database.poses[own.frames]
    return quality.in_root_space(database.skeleton, poses.positions, poses.rotations)


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def copied(database):
    """The database with the clip "run" a second time, as "again", at its end."""
    run = next(i for i, n in enumerate(database.names) if n == "run" and not database.mirrored[i])
    frames = np.arange(database.starts[run], database.stops[run])
    both = np.append(np.arange(len(database)), frames)
    return replace(
        database,
        poses=Poses(*(array[both] for array in database.poses.arrays().values())),
        contacts=database.contacts[both],
        features=database.features[both],
        tags=database.tags[both],
        starts=np.append(database.starts, len(database)).astype(np.int32),
        stops=np.append(database.stops, len(both)).astype(np.int32),
        names=(*database.names, "again"),
        mirrored=np.append(database.mirrored, False),
    )


def test_passages_keep_to_their_clips():
    own = clips(5, 5, 10)
    mask = np.array([*"00111 11000 1101100010".replace(" ", "")]) == "1"
    assert own.passages(mask).tolist() == [[2, 5], [5, 7], [10, 12], [13, 15], [18, 19]]
    assert own.passages(mask, join=0.1).tolist() == [[2, 5], [5, 7], [10, 15], [18, 19]]
    assert own.passages(mask, join=0.3).tolist() == [[2, 5], [5, 7], [10, 19]]
    assert own.passages(mask, least=0.25).tolist() == [[2, 5]]
    assert own.passages(np.zeros(20, bool)).shape == (0, 2)
    assert own.where(13, 15) == {"clip": "clip2", "from_s": 0.3, "to_s": 0.5, "frame": 113}
    assert own.at([0, 4, 5, 19]).tolist() == [0, 0, 1, 2]


def test_clips_are_the_database_without_mirrored_copies(database):
    own = Clips.of(database)
    assert len(own) == len(database) / 2 and len(own.names) == len(database.names) / 2
    assert not database.mirrored[database.ranges()[own.frames]].any()
    assert own.where(own.starts[3] + 6, own.starts[3] + 7)["from_s"] == pytest.approx(0.1)
    all_copies = replace(database, mirrored=np.ones(len(database.names), bool))
    assert len(Clips.of(all_copies)) == len(database)


@pytest.mark.parametrize("schema", [SQUARED, ABSOLUTE], ids=lambda s: s.name)
def test_the_nearest_elsewhere_is_brute_forces(schema):
    rng = np.random.default_rng(0)
    own = clips(40, 3, 60, 8)  # two clips shorter than what is left out around each frame
    rows = rng.normal(size=(111, 3)).astype(np.float32)
    rows[43:46] = rows[40:43]  # the short clip again, at once behind it
    nearest, cost = duplicates.elsewhere(schema, rows, own, away=1.0)
    costs = normalise.total_costs(schema, rows[:, None], rows[None]).astype(np.float64)
    clip, at = own.at(np.arange(111)), np.arange(111)
    costs[(clip[:, None] == clip) & (np.abs(at[:, None] - at) < 10)] = np.inf
    np.testing.assert_allclose(cost, costs.min(axis=1), atol=1e-5)
    np.testing.assert_allclose(costs[at, nearest], costs.min(axis=1), atol=1e-5)  # ties aside, that frame
    assert nearest[40:46].tolist() == [43, 44, 45, 40, 41, 42]


def test_one_short_clip_has_nothing_elsewhere():
    nearest, cost = duplicates.elsewhere(SQUARED, np.zeros((5, 3), np.float32), clips(5), away=1.0)
    assert (nearest == -1).all() and np.isinf(cost).all()


def test_the_typical_cost_is_the_median_of_frames_so_far_apart():
    rows = np.cumsum(np.random.default_rng(1).normal(size=(50, 3)), axis=0).astype(np.float32)
    pairs = [(i, i + 2) for a, b in ((0, 30), (30, 50)) for i in range(a, b - 2)]
    truth = np.median([((rows[j] - rows[i]) ** 2).sum() for i, j in pairs])
    assert duplicates.typical_cost(SQUARED, rows, clips(30, 20), frames=2) == pytest.approx(truth, rel=1e-5)
    assert duplicates.typical_cost(SQUARED, rows, clips(1, 49 - 48), frames=2) == 0


def test_of_what_is_spare_everything_stays_that_it_is_the_same_as():
    rng = np.random.default_rng(2)
    own = clips(200, 300, 100)
    nearest = rng.integers(0, 600, 600)
    same = rng.random(600) < 0.97
    out = duplicates.spare(same, nearest, own)
    assert out.any() and same[out].all()
    assert not out[nearest[out]].any()
    runs = own.passages(out)
    assert (runs[:, 1] - runs[:, 0]).min() >= duplicates.SHORTEST * own.fps


def test_of_two_copies_one_is_spare():
    own = clips(50, 80)
    nearest = np.concatenate([np.arange(50, 100), np.arange(50), np.full(30, -1)])
    out = duplicates.spare(nearest >= 0, nearest, own)
    assert out.sum() == 50 and len(own.passages(out)) == 1


def test_a_clip_that_is_there_twice_is_found(copied):
    own = Clips.of(copied)
    twice = duplicates.find(copied, own, local(copied, own))
    run, again = own.names.index("run"), own.names.index("again")
    here, there = (np.arange(own.starts[i], own.stops[i]) for i in (run, again))
    assert (twice.cost[here] == 0).all() and twice.near[here].all() and twice.near[there].all()
    assert (twice.apart_cm[there] < 1e-3).all()
    assert not (twice.spare[here] & twice.spare[there]).any()
    assert (twice.spare[here] | twice.spare[there]).mean() > 0.95
    clip = duplicates.by_clip(twice, own).set_index("clip")
    assert clip.loc["again", "most_like"] == "run" and clip.loc["again", "in_others"] > 0.95
    stretch = duplicates.stretches(twice, own).set_index("clip").loc["again"]
    assert (stretch["like"], stretch["like_from_s"]) == ("run", 0) and stretch["times"] == 0
    gone = duplicates.spares(twice, own)
    assert gone["seconds"].sum() == pytest.approx(twice.spare.sum() / own.fps)
    # Nothing is lost: searches find as good a frame without it.
    assert duplicates.price(copied, own, twice, count=50) == pytest.approx(0, abs=0.02)


def test_leaving_out_what_is_not_there_twice_has_a_price(database):
    own = Clips.of(database)
    twice = duplicates.find(database, own, local(database, own))
    moving = own.at(np.arange(len(own))) != own.names.index("stand")
    assert duplicates.price(database, own, replace(twice, spare=moving), count=100) > 0.5


def test_other_poses_and_other_tags_are_no_duplicates(copied):
    own = Clips.of(copied)
    there = slice(own.starts[own.names.index("again")], None)
    tags = copied.tags.copy()
    tags[copied.starts[-1] :] = 1
    tagged = replace(copied, tags=tags)
    assert not duplicates.find(tagged, own, local(copied, own)).near[there].any()
    lifted = local(copied, own)
    lifted[there] += [0, 0.06, 0]
    assert not duplicates.find(copied, own, lifted).near[there].any()


def test_mirrored_copies_go_with_their_originals(database):
    frames = np.arange(database.starts[0] + 3, database.starts[0] + 9)
    out = duplicates.with_copies(database, frames)
    assert database.names[0] == database.names[1] and database.mirrored[1]
    assert np.flatnonzero(out).tolist() == [*frames, *(frames - database.starts[0] + database.starts[1])]


def test_what_nothing_is_like_is_told_first():
    own = clips(100, 100)
    cost = np.ones(200)
    cost[150:152] = [40, 80]
    none = np.zeros(200, bool)
    twice = Twice(np.zeros(200, np.int64), cost, np.zeros(200), 0.5, none, none)
    table = duplicates.alone(twice, own)
    assert table[["clip", "from_s", "to_s", "times"]].values.tolist() == [["clip1", 5.0, 5.2, 160.0]]
