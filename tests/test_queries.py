"""How indexes do on a driven controller's queries."""

from __future__ import annotations

import json

import page_html
import pandas as pd
import pytest
from click.testing import CliRunner

from bench import queries, recall
from bench.cli import main
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


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


def test_a_sweep_trades_recall_for_time(database):
    rows = queries.table(database, count=60, indexes=["exact", "two-phase"], repeats=1, sweep=True)
    assert [row["index"] for row in rows] == ["exact"] + ["two-phase"] * 6
    own, *others = rows[1:]
    assert own["option"] is None and {row["option"] for row in others} == {"leaf"}
    regrets = [row["cost_regret"] for row in others]  # by rising leaves
    assert regrets[-1] == pytest.approx(0, abs=1e-6) and regrets[0] >= regrets[-1]
    assert others[-1]["recall"] == 1 and others[0]["recall"] <= own["recall"] <= 1


def test_the_picture_has_a_mark_for_each_row(database, tmp_path):
    out = tmp_path / "search"
    database.save(tmp_path / "walker.mmdb")
    arguments = [tmp_path / "walker.mmdb", "--queries", 40, "--indexes", "exact,faiss-ivf", "-o", out]
    result = CliRunner().invoke(main, ["search", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    assert page_html.files(out) == {"search.csv", "search.json", "search.png"}
    rows = pd.read_csv(out / "search.csv")
    assert len(rows) == 2 + len(queries.SWEPT["faiss-ivf"][1])
    told = json.loads((out / "search.json").read_text())
    assert told["database"]["fingerprint"] == database.fingerprint and len(told["rows"]) == len(rows)
    picture = recall.figure(told["rows"], "")
    for axes in picture.axes:
        marks = [line for line in axes.get_lines() if line.get_marker() not in ("", "None")]
        lines = [line for line in marks if line.get_fillstyle() == "none"]
        assert sum(len(line.get_xdata()) for line in lines) == len(rows)
        assert len(marks) - len(lines) == 2  # the indexes as they come


def test_an_unknown_index_is_refused_before_any_work(database, monkeypatch):
    monkeypatch.setattr(queries, "record", lambda *a, **b: pytest.fail("it began to work"))
    with pytest.raises(UserError, match="no search index 'nope'; choose from brute"):
        queries.table(database, indexes=["nope"])
