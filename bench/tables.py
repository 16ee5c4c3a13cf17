"""The numbers of a comparison on disk: CSV, JSON and Parquet."""

from __future__ import annotations

import importlib.util
import io
import json
from typing import Any

from .compare import Comparison, plain

FOLDER = "tables"
PARQUET = "pip install 'motion-matching[parquet]' to have the tables as Parquet, too"


def has_parquet() -> bool:
    """Whether what writes Parquet is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def contents(comparison: Comparison, *, command: str) -> dict[str, str | bytes]:
    """What goes into files, by name: summary.csv, courses.csv, summary.json, which has all, and every table
    of `Comparison.tables` in a folder, as Parquet where pyarrow is installed."""
    out: dict[str, str | bytes] = {}
    for name, table in comparison.tables().items():
        text = table.to_csv(index=False, lineterminator="\n")
        out[f"{name}.csv" if name in ("summary", "courses") else f"{FOLDER}/{name}.csv"] = text
        if has_parquet():
            stream = io.BytesIO()
            table.to_parquet(stream, index=False, engine="pyarrow")
            out[f"{FOLDER}/{name}.parquet"] = stream.getvalue()
    text = json.dumps(to_json(comparison, command=command), indent=1, allow_nan=False)
    return out | {"summary.json": text + "\n"}


def to_json(comparison: Comparison, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    judged = comparison.verdict
    return {
        "command": command,
        "verdict": {
            "paragraph": judged.paragraph,
            "systems": judged.systems,
            "reference": judged.reference,
            "keeps": list(judged.keeps),
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
