"""Queries of a driven controller: real ones, repeatable, and costed as the controller would."""

from __future__ import annotations

import numpy as np
import pytest

from bench import queries
from mm.build import build
from mm.controller import build_index
from mm.search import Exclusions
from mm.settings import Settings
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_files):
    return build([walker_files], jobs=1)


@pytest.fixture(scope="module")
def recorded(database):
    return queries.record(database, 120, index="brute")


def test_queries_are_as_many_as_asked_and_the_same_every_time(database, recorded):
    assert len(recorded) == 120 and recorded.features.shape == (120, database.schema.size)
    assert recorded.radius == 20
    again = queries.record(database, 120, index="aabb")  # exact as well, so the run is the same
    np.testing.assert_array_equal(again.features, recorded.features)
    np.testing.assert_array_equal(again.current, recorded.current)


def test_the_bound_is_the_cost_of_playing_on(database, recorded):
    finite = np.isfinite(recorded.bound)
    assert finite.mean() > 0.5
    difference = recorded.features - database.features[recorded.current]
    playing_on = (1 - Settings().continuing_bias) * (difference**2).sum(axis=1)
    np.testing.assert_allclose(recorded.bound[finite], playing_on[finite], rtol=1e-4, atol=1e-4)


def test_queries_are_not_rows_of_the_database(database, recorded):
    """What is asked lies off the data: the nearest row is at a distance, and which one it is changes."""
    index = build_index(database, "brute", Settings())
    frames, costs = index.search(recorded.features, exclude=Exclusions())
    assert np.median(costs) > 0.01
    assert len(np.unique(frames)) > 20


def test_table_sees_a_worse_index(database):
    rows = {
        row["index"]: row
        for row in queries.table(database, count=80, indexes=["exact", "two-phase"], repeats=1)
    }
    assert rows["exact"]["recall"] == 1 and rows["exact"]["cost_regret"] == pytest.approx(0, abs=1e-6)
    assert rows["two-phase"]["recall"] <= 1 and rows["two-phase"]["cost_regret"] >= -1e-6
    for row in rows.values():
        assert 0 < row["median_us"] <= row["p99_us"]
        assert row["bytes"] > 0 and row["build_s"] > 0 and row["ratio_to_aabb"] > 0


def test_the_ratio_is_of_medians_of_the_same_run(database):
    rows = queries.table(database, count=40, indexes=["aabb", "brute"], repeats=1)
    assert [row["index"] for row in rows] == ["aabb", "brute"]
    assert rows[0]["ratio_to_aabb"] == 1
    assert rows[1]["ratio_to_aabb"] == pytest.approx(rows[0]["median_us"] / rows[1]["median_us"])


def test_skeletons_without_legs_can_be_searched(walker_files):
    database = build([walker_files], jobs=1, roles_only=True)
    assert len(queries.record(database, 24, index="brute")) == 24


def test_an_unknown_index_is_refused_before_any_work(database, monkeypatch):
    monkeypatch.setattr(queries, "record", lambda *a, **b: pytest.fail("it began to work"))
    with pytest.raises(UserError, match="no search index 'nope'; choose from brute"):
        queries.table(database, indexes=["nope"])
