"""The table of search indexes: its numbers on data where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from bench import search as table
from mm import search


def test_quality_counts_ties_and_measures_what_a_wrong_answer_costs():
    truth = np.array([[2.0], [4.0], [0.0], [np.inf]], np.float32)
    assert table.quality(truth, truth) == (1.0, 0.0)
    near = truth * np.float32(1 + 2e-6)
    assert table.quality(near, truth)[0] == 1.0
    worse = np.array([[3.0], [4.0], [0.0], [np.inf]], np.float32)
    recall, regret = table.quality(worse, truth)
    assert recall == pytest.approx(0.75) and regret == pytest.approx(0.25)


def test_quality_of_several_answers_needs_all_of_them():
    truth = np.array([[1.0, 2.0], [1.0, 2.0]], np.float32)
    found = np.array([[1.0, 2.0], [1.0, 2.5]], np.float32)
    assert table.quality(found, truth) == (0.5, 0.0)


def test_every_index_has_its_row():
    rng = np.random.default_rng(0)
    features = rng.normal(size=(900, 6)).astype(np.float32)
    current = rng.integers(0, 900, 15).astype(np.int32)
    queries = features[current] + np.float32(0.3)
    rows = table.compare_indexes(features, [0, 400], [400, 900], queries, current, repeats=1)
    assert list(rows["index"]) == search.names()
    assert list(rows.columns) == ["index", "recall", "cost_regret", "median_us", "p99_us", "build_s", "bytes"]
    rows = rows.set_index("index")
    for name in ("brute", "aabb", "exact", "kdtree", "faiss-flat"):
        assert rows.recall[name] == 1 and rows.cost_regret[name] == pytest.approx(0, abs=1e-6)
    assert (rows.recall <= 1).all() and (rows.cost_regret >= -1e-6).all()
    assert (rows.median_us > 0).all() and (rows.p99_us >= rows.median_us).all() and (rows.bytes > 0).all()


def test_chosen_indexes_options_and_bounds():
    rng = np.random.default_rng(1)
    features = rng.normal(size=(600, 4)).astype(np.float32)
    queries, current = features[:5] + 1, np.arange(5)
    rows = table.compare_indexes(
        features, [0], [600], queries, current, names=["exact", "kdtree"], bound=np.full(5, 1e-9),
        options={"kdtree": {"leaf": 5}}, repeats=2, k=2,
    )  # fmt: skip
    assert list(rows["index"]) == ["exact", "kdtree"]
    assert (rows.recall == 1).all() and (rows.cost_regret == 0).all()
