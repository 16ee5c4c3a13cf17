"""Every search index against the obvious one, on awkward data; and against the public reference's."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from features import presets
from features.normalise import total_costs
from features.schema import Feature, Schema
from mm import search
from mm.search import Exclusions
from motion.errors import UserError

EXACT = ["aabb", "exact", "kdtree", "faiss-flat"]
APPROXIMATE = {
    "two-phase": 0.2,
    "faiss-ivf": 0.9,
    "faiss-hnsw": 0.9,
    "faiss-pq": 0.9,
}  # least recall asked for


def random(rng, count, width):
    return rng.normal(size=(count, width)).astype(np.float32)


def smooth(rng, count, width):
    """Curves through a space of few dimensions, as features of motion are."""
    time, few = np.arange(count)[:, None] * 0.03, min(width, 6)
    curves = sum(np.sin(time * f + rng.uniform(0, 6, few)) for f in rng.uniform(0.2, 3, (5, few)))
    return (curves @ rng.normal(size=(few, width)) + rng.normal(size=(count, width)) * 0.05).astype(
        np.float32
    )


def duplicates(rng, count, width):
    """Few different rows, and a column that never varies."""
    rows = random(rng, 9, width)[rng.integers(0, 9, count)]
    rows[:, 0] = 1
    return rows


def close(rng, count, width):
    """Clusters far apart, whose rows differ by less than half floats tell."""
    centers = random(rng, 9, width)[rng.integers(0, 9, count)] * 100
    return (centers + rng.normal(size=(count, width)) * 3e-4).astype(np.float32)


def harsh(rng, count, width):
    """Far from the origin, columns of very different widths, and a few rows far out."""
    rows = random(rng, count, width) * 10.0 ** rng.uniform(-4, 2, width) + 300
    rows[rng.integers(0, count, 5)] *= 1e4
    return rows.astype(np.float32)


def ranges(rng, count, pieces=4):
    """Ranges that cover all frames; one of them shorter than 20."""
    cuts = np.unique(np.concatenate([[0, min(12, count), count], rng.integers(0, count + 1, pieces)]))
    return cuts[:-1].astype(np.int32), cuts[1:].astype(np.int32)


def asked(rng, features, count=12):
    """Queries between rows, beyond and very near them; the frames they come from, whose costs are bounds."""
    current = rng.integers(0, len(features), count).astype(np.int32)
    other = features[rng.integers(0, len(features), count)]
    mask = rng.random(features.shape[1]) < 0.5
    queries = np.where(mask, features[current], other * 1.1 + 0.2).astype(np.float32)
    queries[::3] = features[current[::3]] + rng.normal(size=queries[::3].shape) * 1e-4
    return queries, current, ((queries - features[current]) ** 2).sum(1)


def same(answer, truth, features, queries):
    """Equal costs slot by slot, and frames that really cost that much."""
    frames, costs = answer
    np.testing.assert_allclose(costs, truth[1], rtol=2e-6, atol=1e-9)
    np.testing.assert_array_equal(frames < 0, truth[0] < 0)
    n, slot = np.nonzero(frames >= 0)
    real = ((queries[n] - features[frames[n, slot]]) ** 2).sum(1)
    np.testing.assert_allclose(real, costs[n, slot], rtol=1e-5, atol=1e-6)
    for row in frames:
        assert len(set(row[row >= 0])) == (row >= 0).sum()


def kept(frames, current, radius, starts, stops, ignore_end=20):
    """Whether no answer is near its current frame or at a range's end."""
    for row, at in zip(frames, current, strict=True):
        for frame in row[row >= 0]:
            r = np.flatnonzero((starts <= frame) & (frame < stops))
            assert len(r) == 1 and frame < stops[r[0]] - ignore_end
            assert abs(int(frame) - int(at)) >= radius


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("make", [random, smooth, duplicates, close, harsh])
@pytest.mark.parametrize("width", [1, 2, 27, 70])
@pytest.mark.parametrize("k", [1, 5])
def test_exact_index_equals_brute(name, make, width, k):
    rng = np.random.default_rng(width)
    features = make(rng, 3000, width)
    starts, stops = ranges(rng, len(features))
    queries, current, bound = asked(rng, features)
    truth_index = search.build("brute", features, starts, stops)
    index = search.build(name, features, starts, stops)
    assert index.name == name and index.nbytes > 0
    for limit in (None, bound):
        for exclude in (None, Exclusions(current=current), Exclusions(current=current, radius=300)):
            answer = index.search(queries, k=k, bound=limit, exclude=exclude)
            truth = truth_index.search(queries, k=k, bound=limit, exclude=exclude)
            same(answer, truth, features, queries)
            if exclude is not None:
                kept(answer[0], current, exclude.radius, starts, stops)


def test_brute_is_the_definition():
    rng = np.random.default_rng(1)
    features = smooth(rng, 500, 9)
    starts, stops = np.array([0, 200, 215]), np.array([200, 215, 500])
    queries, current, _ = asked(rng, features)
    frames, costs = search.build("brute", features, starts, stops).search(
        queries, k=3, exclude=Exclusions(current=current, radius=10)
    )
    for n, query in enumerate(queries):
        cost = ((features.astype(np.float64) - query) ** 2).sum(1)
        cost[180:215] = cost[480:] = np.inf
        cost[max(0, current[n] - 9) : current[n] + 10] = np.inf
        best = np.argsort(cost, kind="stable")[:3]
        np.testing.assert_array_equal(frames[n], best)
        np.testing.assert_allclose(costs[n], cost[best], rtol=1e-5)


@pytest.mark.parametrize("name", search.names())
@pytest.mark.parametrize("count", [1, 2, 7, 33, 100])
def test_tiny_data(name, count):
    rng = np.random.default_rng(count)
    features = random(rng, count, 5)
    truth_index = search.build("brute", features, [0], [count], ignore_end=0)
    index = search.build(name, features, [0], [count], ignore_end=0)
    queries = random(rng, 4, 5)
    for k in (1, 5):
        truth = truth_index.search(queries, k=k)
        answer = index.search(queries, k=k)
        assert (truth[0] >= 0).sum() == 4 * min(k, count)
        same(answer, truth, features, queries)


@pytest.mark.parametrize("name", search.names())
def test_nothing_to_return(name):
    rng = np.random.default_rng(3)
    features = random(rng, 300, 6)
    queries = features[50:53] + 0.1
    short = search.build(name, features, [0, 15], [15, 34])
    index = search.build(name, features, [0], [300], tags=np.ones(300, np.uint32))
    below = np.full(3, 1e-6, np.float32)
    for found, costs, bound in (
        (*short.search(queries, k=2), np.full(3, np.inf)),
        (*index.search(queries, k=2, bound=below), below),
        (
            *index.search(queries, k=2, exclude=Exclusions(forbidden_tags=np.ones(3, np.uint32))),
            np.full(3, np.inf),
        ),
        (*index.search(queries, k=2, exclude=Exclusions(required_tags=np.full(3, 2))), np.full(3, np.inf)),
        (
            *index.search(queries, k=2, exclude=Exclusions(current=np.full(3, 150), radius=400)),
            np.full(3, np.inf),
        ),
    ):
        assert found.dtype == np.int32 and costs.dtype == np.float32 and found.shape == (3, 2)
        assert (found == -1).all()
        np.testing.assert_array_equal(costs, np.repeat(bound[:, None], 2, 1))


@pytest.mark.parametrize("name", search.names())
def test_tags_choose_frames(name):
    rng = np.random.default_rng(4)
    features = smooth(rng, 2000, 8)
    tags = (rng.integers(0, 4, 2000) | np.where(rng.random(2000) < 0.005, 8, 0)).astype(np.uint32)
    queries, current, _ = asked(rng, features)
    exclude = Exclusions(
        current=current,
        required_tags=np.array([1, 2, 3, 8] * 3, np.uint32),
        forbidden_tags=np.array([2, 0, 0, 0] * 3, np.uint32),
    )
    starts, stops = [0, 900], [900, 2000]
    frames, costs = search.build(name, features, starts, stops, tags=tags).search(
        queries, k=2, exclude=exclude
    )
    assert (frames >= 0).all()
    bits = tags[frames]
    assert ((bits & exclude.required_tags[:, None]) == exclude.required_tags[:, None]).all()
    assert ((bits & exclude.forbidden_tags[:, None]) == 0).all()
    kept(frames, current, 20, np.array(starts), np.array(stops))
    if name in EXACT:
        truth = search.build("brute", features, starts, stops, tags=tags).search(
            queries, k=2, exclude=exclude
        )
        np.testing.assert_allclose(costs, truth[1], rtol=2e-6)


@pytest.mark.parametrize("name", APPROXIMATE)
def test_approximate_index_finds_most(name):
    rng = np.random.default_rng(5)
    features = smooth(rng, 6000, 27)
    starts, stops = ranges(rng, len(features), 10)
    _, current, _ = asked(rng, features, 60)
    queries = features[current] + rng.normal(size=(60, 27)).astype(np.float32) * 0.3
    exclude = Exclusions(current=current)
    truth = search.build("brute", features, starts, stops).search(queries, exclude=exclude)
    frames, costs = search.build(name, features, starts, stops).search(queries, exclude=exclude)
    kept(frames, current, 20, starts, stops)
    assert (costs >= truth[1] * (1 - 1e-5)).all()
    assert (costs <= truth[1] * (1 + 1e-5)).mean() >= APPROXIMATE[name]


@pytest.mark.parametrize(
    ("name", "built", "option", "values"),
    [
        ("faiss-ivf", {}, "probes", (1, 40)),
        ("faiss-hnsw", {"links": 2}, "effort", (1, 300)),
        ("faiss-pq", {}, "rerank", (1, 400)),
    ],
)
def test_options_of_searching_need_no_other_index(name, built, option, values):
    """They find what an index that was built with them finds, and leave the one they came from alone."""
    rng = np.random.default_rng(5)
    features = smooth(rng, 4000, 12)
    queries = features[rng.integers(0, 4000, 200)] + 0.3 * random(rng, 200, 12)
    parts = features, [0], [4000]
    own = search.build(name, *parts, **built)
    before = own.search(queries)[1]
    costs = [own.searching(**{option: value}).search(queries)[1] for value in values]
    for value, found in zip(values, costs, strict=True):
        other = search.build(name, *parts, **built, **{option: value})
        np.testing.assert_array_equal(found, other.search(queries)[1])
    assert costs[0].mean() > costs[1].mean()
    np.testing.assert_array_equal(own.search(queries)[1], before)
    with pytest.raises(ValueError, match="cells"):
        own.searching(cells=3)


@pytest.mark.parametrize("name", ["faiss-flat", "faiss-ivf", "faiss-hnsw"])
def test_many_choices_of_tags_are_all_kept_to(name):
    rng = np.random.default_rng(6)
    features, tags = random(rng, 500, 6), rng.integers(0, 32, 500).astype(np.uint32)
    index = search.build(name, features, [0], [500], ignore_end=0, tags=tags)
    required = np.tile(np.arange(32, dtype=np.uint32), 2)
    asked = Exclusions(required_tags=required, forbidden_tags=np.zeros(64, np.uint32))
    frames = index.search(features[:64], exclude=asked)[0][:, 0]
    assert all((tags[f] & r) == r for f, r in zip(frames, required, strict=True) if f >= 0)
    assert (frames >= 0).mean() > 0.9


def test_exact_index_of_several_levels_and_threads():
    rng = np.random.default_rng(8)
    features = smooth(rng, 20000, 12)
    queries, current, bound = asked(rng, features, 40)
    starts, stops = ranges(rng, len(features), 10)
    exclude = Exclusions(current=current)
    truth = search.build("brute", features, starts, stops).search(queries, bound=bound, exclude=exclude)
    alone = search.build("exact", features, starts, stops).search(queries, bound=bound, exclude=exclude)
    index = search.build("exact", features, starts, stops, threads=3)
    together = index.search(queries, bound=bound, exclude=exclude)
    same(alone, truth, features, queries)
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", search.names())
def test_bad_input(name):
    features = random(np.random.default_rng(6), 100, 4)
    index = search.build(name, features, [0], [100])
    good = features[:2]
    for queries, options, said in (
        (np.full((2, 4), np.nan), {}, "nan"),
        (features[:2, :3], {}, r"expected \[N, 4\]"),
        (good, {"k": 0}, "k is 0"),
        (good, {"bound": [1, 2, 3]}, "bound"),
        (good, {"bound": [1, np.nan]}, "bound"),
        (good, {"exclude": Exclusions(current=np.zeros(3, np.int32))}, "current"),
    ):
        with pytest.raises(UserError, match=said):
            index.search(queries, **options)
    with pytest.raises(UserError, match="frame 3, column 1"):
        broken = features.copy()
        broken[3, 1] = np.nan
        search.build(name, broken, [0], [100])
    with pytest.raises(UserError, match="no option 'speed'"):
        search.build(name, features, [0], [100], speed=11)
    with pytest.raises(UserError, match="outside"):
        search.build(name, features, [0], [101])
    with pytest.raises(UserError, match="tags"):
        search.build(name, features, [0], [100], tags=np.zeros(99, np.uint32))


def absolute() -> Schema:
    """A schema of norms alone, whose 8 columns need no padding."""
    names = ("left_foot", "right_foot")
    joints = [Feature(name, "position", name, residual="absolute") for name in names]
    return Schema("absolute", (*joints, Feature("way", "trajectory_position", times=(0.5,), residual="path")))


def mixed() -> Schema:
    """A schema with every residual: squared, absolute, path."""
    times = (0.2, 0.4, 0.6)
    return Schema(
        "mixed",
        (
            Feature("way", "trajectory_position", times=times, residual="path"),
            Feature("facing", "trajectory_direction", times=times),
            Feature("left", "position", "left_foot", residual="absolute"),
            Feature("height", "height", "hips"),
            Feature("speed", "velocity", "hips", residual="absolute"),
        ),
    )


@pytest.mark.parametrize("make", [random, smooth, duplicates, close])
@pytest.mark.parametrize("schema", [absolute(), mixed(), presets.load("o3de59")], ids=lambda s: s.name)
def test_other_costs_are_searched_exactly(make, schema):
    rng = np.random.default_rng(9)
    features = make(rng, 3000, schema.size)
    starts, stops = ranges(rng, len(features))
    queries, current, _ = asked(rng, features)
    bound = total_costs(schema, queries, features[current])
    brute = search.build("brute", features, starts, stops, schema=schema)
    exact = search.build("exact", features, starts, stops, schema=schema)
    for limit, exclude in ((None, None), (bound, Exclusions(current=current))):
        truth = brute.search(queries, k=3, bound=limit, exclude=exclude)
        frames, costs = exact.search(queries, k=3, bound=limit, exclude=exclude)
        np.testing.assert_allclose(costs, truth[1], rtol=2e-6)
        n, slot = np.nonzero(frames >= 0)
        real = total_costs(schema, queries[n], features[frames[n, slot]])
        np.testing.assert_allclose(costs[n, slot], real, rtol=1e-5, atol=1e-5)
    every = np.zeros(len(features), bool)
    for start, stop in zip(starts, stops, strict=True):
        every[start : max(start, stop - 20)] = True
    least = np.where(every, total_costs(schema, queries[:, None], features), np.inf).min(axis=1)
    np.testing.assert_allclose(brute.search(queries)[1][:, 0], least, rtol=1e-5, atol=1e-5)


def test_two_phase_ranks_by_the_schema():
    rng = np.random.default_rng(10)
    schema = mixed()
    features = smooth(rng, 500, schema.size)
    queries, current, _ = asked(rng, features)
    exclude = Exclusions(current=current)
    answers = [
        search.build(name, features, [0], [500], schema=schema).search(queries, k=2, exclude=exclude)
        for name in ("brute", "two-phase")  # the whole database is one leaf
    ]
    for one, other in zip(*answers, strict=True):
        np.testing.assert_array_equal(one, other)


def test_unknown_index_lists_the_known():
    with pytest.raises(UserError, match="brute, aabb, exact"):
        search.build("magic", np.zeros((1, 1)), [0], [1])


def test_names_are_of_what_can_search_a_cost():
    assert set(search.names(presets.load("mm27"))) == set(search.names())
    assert search.names(presets.load("o3de59")) == ["brute", "exact", "two-phase"]


def test_other_cost_is_refused_by_euclidean_indexes():
    schema = SimpleNamespace(euclidean=False)
    with pytest.raises(UserError, match="brute, exact, two-phase"):
        search.build("kdtree", np.zeros((1, 1)), [0], [1], schema=schema)


def test_read_only_features_and_single_query():
    features = random(np.random.default_rng(7), 200, 3)
    features.flags.writeable = False
    for name in search.names():
        frames, costs = search.build(name, features, [0], [200]).search(features[5])
        assert frames.tolist() == [[5]] and costs.tolist() == [[0]]


def test_equals_the_public_reference(data):
    """Its 200 recorded searches: same frame (or one that costs the same) and same cost."""
    folder = data / "reference" / "oracle"
    blob = (folder / "features.bin").read_bytes()
    count, width = np.frombuffer(blob, np.int32, 2)
    features = np.frombuffer(blob, np.float32, count * width, 8).reshape(count, width)
    tail = np.frombuffer(blob, np.float32, 2 * width + 2, 8 + features.nbytes)
    offset, scale = tail[1 : width + 1], tail[width + 2 :]
    table = np.genfromtxt(folder / "search_oracle.csv", delimiter=",", skip_header=1)
    current, best_frame, best_cost = table[:, 0].astype(np.int32), table[:, -2].astype(int), table[:, -1]
    queries = ((table[:, 1 : width + 1] - offset) / scale).astype(np.float32)
    starts, stops = np.array([0, 719, 1438, 1977]), np.array([719, 1438, 1977, 2516])
    bound = ((queries - features[current]) ** 2).sum(1)
    for name in ["brute", *EXACT]:
        index = search.build(name, features, starts, stops, ignore_end=20)
        frames, costs = index.search(queries, bound=bound, exclude=Exclusions(current=current, radius=20))
        frames = np.where(frames[:, 0] < 0, current, frames[:, 0])
        np.testing.assert_allclose(costs[:, 0], best_cost, rtol=1e-4)
        tied = np.abs(((queries - features[best_frame]) ** 2).sum(1) / best_cost - 1) < 1e-4
        assert ((frames == best_frame) | (tied & (np.abs(costs[:, 0] / best_cost - 1) < 1e-4))).all()
        assert (frames == best_frame).mean() > 0.98
