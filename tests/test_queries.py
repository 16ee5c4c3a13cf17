"""How indexes do on a driven controller's queries."""

from __future__ import annotations

import pytest

from bench import queries
from mm.build import build
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_files):
    return build([walker_files], jobs=1)


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


def test_an_unknown_index_is_refused_before_any_work(database, monkeypatch):
    monkeypatch.setattr(queries, "record", lambda *a, **b: pytest.fail("it began to work"))
    with pytest.raises(UserError, match="no search index 'nope'; choose from brute"):
        queries.table(database, indexes=["nope"])
