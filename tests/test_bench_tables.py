"""Tables on disk: the same numbers in all forms, and nothing of an earlier run beside them."""

from __future__ import annotations

import io
import json

import numpy as np
import pandas as pd
import pytest

from bench import report, tables
from bench.comparison import TABLES, Comparison

TABLE = pd.DataFrame(
    {"system": ["a", "b, c"], "frames": [1, 2], "x_cm": [0.1, np.nan], "same": [True, False]}
)


def test_csv_parquet_and_json_hold_the_same():
    found = tables.written({"one": TABLE, "none": TABLE[:0]})
    assert set(found) <= set(tables.files(["one", "none"]))
    pd.testing.assert_frame_equal(pd.read_csv(io.StringIO(found["one.csv"])), TABLE)
    assert len(pd.read_csv(io.StringIO(found["none.csv"]))) == 0
    rows = json.loads(json.dumps(tables.plain(TABLE), allow_nan=False))
    assert rows[1] == {"system": "b, c", "frames": 2, "x_cm": None, "same": False}


@pytest.mark.skipif(not tables.has_parquet(), reason="pyarrow is not installed")
def test_parquet_keeps_types():
    found = tables.written({"one": TABLE, "nothing": pd.DataFrame()})
    pd.testing.assert_frame_equal(pd.read_parquet(io.BytesIO(found["one.parquet"])), TABLE)
    assert len(pd.read_parquet(io.BytesIO(found["nothing.parquet"]))) == 0


def test_without_pyarrow_there_is_csv(monkeypatch):
    monkeypatch.setattr(tables, "has_parquet", lambda: False)
    assert list(tables.written({"one": TABLE})) == ["one.csv"]


def test_tables_of_an_earlier_comparison_do_not_stay(tmp_path, monkeypatch):
    """One without crowds in the folder of one with them: its folder holds no crowds."""
    monkeypatch.setattr(report, "html", lambda comparison, command: "page")
    one = {"traces": [], "played": [], "feet": [], "notes": [], "database": {}}
    report.save(Comparison(TABLE, TABLE, crowd=TABLE, **one), tmp_path, command="first")
    assert (tmp_path / "tables" / "crowd.csv").is_file()
    mine = tmp_path / "tables" / "mine.csv"
    mine.write_text("of somebody else")
    written = report.save(Comparison(TABLE, TABLE, **one), tmp_path, command="second")
    assert "crowd" in TABLES and not any(path.stem == "crowd" for path in tmp_path.rglob("*"))
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == {*written, mine}
