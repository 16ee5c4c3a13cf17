"""Tables on disk, as CSV, Parquet and JSON; and all the numbers of a comparison."""

from __future__ import annotations

import importlib.util
import io
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from .comparison import Comparison

FOLDER = "tables"
FIRST = ("summary", "courses")  # tables of a comparison whose CSV file lies beside its page
PARQUET = "pip install 'motion-matching[parquet]' to have the tables as Parquet, too"


def has_parquet() -> bool:
    """Whether what writes Parquet is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def written(tables: Mapping[str, pd.DataFrame]) -> dict[str, str | bytes]:
    """Contents of files, by name: every table as CSV, and as Parquet where pyarrow is installed."""
    out: dict[str, str | bytes] = {}
    for name, table in tables.items():
        out[f"{name}.csv"] = table.to_csv(index=False, lineterminator="\n")
        if has_parquet():
            stream = io.BytesIO()
            table.to_parquet(stream, index=False, engine="pyarrow")
            out[f"{name}.parquet"] = stream.getvalue()
    return out


def files(names: Iterable[str]) -> list[str]:
    """What `written` may call the files of tables of these names."""
    return [f"{name}{ending}" for name in names for ending in (".csv", ".parquet")]


def contents(comparison: Comparison, *, command: str) -> dict[str, str | bytes]:
    """What goes into files, by name: summary.csv, courses.csv, summary.json, which has all, and every table
    of `Comparison.tables` in a folder."""
    out: dict[str, str | bytes] = {}
    for name, content in written(comparison.tables()).items():
        beside = name in [f"{first}.csv" for first in FIRST]
        out[name if beside else f"{FOLDER}/{name}"] = content
    text = json.dumps(to_json(comparison, command=command), indent=1, allow_nan=False)
    return out | {"summary.json": text + "\n"}


def to_json(comparison: Comparison, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    judged = comparison.verdict
    return {
        "command": command,
        "verdict": {
            "paragraph": judged.paragraph,
            "rule": judged.rule,
            "systems": judged.systems,
            "reference": judged.reference,
            "keeps": list(judged.keeps),
            "budgets": list(judged.budgets),
            "breaks": judged.breaks,
        },
        "database": comparison.database,
        "models": comparison.models,
        "machine": comparison.machine,
        "code": comparison.code,
        "ground": comparison.ground and comparison.ground.facts(),
        "notes": comparison.notes,
        **{name: plain(table) for name, table in comparison.tables().items()},
        "played": [course.to_dict() for course in comparison.played],
    }


def plain(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table for JSON: NaN becomes None."""
    return [
        {key: None if _missing(value) else _python(value) for key, value in row.items()}
        for row in table.to_dict("records")
    ]


def _missing(value: Any) -> bool:
    return isinstance(value, float | np.floating) and not math.isfinite(value)


def _python(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
