"""What an analysis leaves behind: CSV, JSON, and one page that needs nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from motion import figures, files

from .. import coverage
from ..pages import render
from ..tables import files as files_of
from ..tables import plain, written
from . import costs, duplicates, features, glitches, pictures, reach, verdict
from .analyse import Analysis

SHOWN = 12  # rows of a table on the page; the files have all
LONG = ("run_costs",)  # tables that are files only
FILES = (
    *("features", "weights", "correlations", "redundant", "outliers", "leaps", "components", "speeds"),
    *(
        "clips",
        "twice",
        "spare",
        "alone",
        "holes",
        "run_features",
        "run_glitches",
        "run_moments",
        "run_costs",
    ),
)
PERCENT = (
    *("far_out", "share", "share_at_peaks", "any_share", "near_share", "cumulative"),
    *("twice", "spare", "in_others", "like_share"),
)


def names(*, with_run: bool) -> list[str]:
    """The files that an analysis writes."""
    tables = [f"{name}.csv" for name in FILES if with_run or not name.startswith("run_")]
    return [*tables, "data.json", "report.html"]


def save(found: Analysis, folder: Path, *, command: str) -> list[Path]:
    """Write the tables (see `bench.tables`), data.json and report.html, all of them or none."""
    texts = written(found.tables())
    texts["data.json"] = json.dumps(to_json(found, command=command), indent=1, allow_nan=False) + "\n"
    texts["report.html"] = html(found, command=command)
    return files.write_together(folder, texts, stale=files_of(FILES))


def to_json(found: Analysis, *, command: str) -> dict[str, Any]:
    """All numbers but those of every frame, as plain data."""
    database = found.database
    return {
        "command": command,
        "name": found.name,
        "fingerprint": database.fingerprint,
        "frames": len(database),
        "fps": database.fps,
        "clips": len(found.clips.names),
        "minutes_without_mirrored": found.clips.seconds / 60,
        "verdict": verdict.sentences(found),
        "bounds": {
            "same_cost": found.twice.bound,
            "same_seconds": found.near,
            "rare_cost": _known(found.bounds.cost),
            "rare_pop_cm": found.bounds.pop_cm,
            "slip_cm": found.bounds.slip_cm,
        },
        "spare_price": None if found.price is None else _known(found.price),
        "covered": None if found.coverage is None else found.coverage.share,
        "components_of_95_percent": found.components.needed(verdict.HELD),
        "tables": {name: plain(table) for name, table in found.tables().items() if name not in LONG},
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def brief(found: Analysis) -> list[dict[str, Any]]:
    """Rows for the terminal: the columns of the features."""
    keys = ("column", "unit", "mean", "std", "p1", "p50", "p99", "skewness")
    return [
        {key: row[key] for key in keys} | {"far out %": round(100 * row["far_out"], 2)}
        for row in plain(found.columns)
    ]


def cell(name: str, value: Any) -> str:
    """A cell of the page: shares as per cent, seconds with two digits, three digits else, a dash for none."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    if name in PERCENT:
        return f"{100 * value:.1f} %"
    if isinstance(value, float):
        return (
            f"{value:,.2f}"
            if name.endswith("_s") or name == "seconds" or abs(value) >= 100
            else f"{value:.3g}"
        )
    return f"{value:,}" if isinstance(value, int) else str(value)


def title(name: str) -> str:
    """A column's name as a header."""
    for end, unit in (("_mps", ", m/s"), ("_cm", ", cm"), ("_s", ", s")):
        if name.endswith(end):
            name = name.removesuffix(end) + unit
            break
    return name.replace("_", " ")


def html(found: Analysis, *, command: str) -> str:
    """The page."""
    tables = {name: _table(name, table) for name, table in found.tables().items() if name not in LONG}
    return render(
        "data.html",
        found=found,
        tables=tables,
        verdict=verdict.sentences(found),
        pictures=dict(_pictures(found)),
        cell=cell,
        title=title,
        command=command,
        constants={
            **{name: getattr(features, name) for name in ("FAR", "SAME", "STILL", "FAINT")},
            **{name: getattr(glitches, name) for name in ("RARE", "SLIPS", "SEEN_CM", "LEAPS")},
            **{name: getattr(duplicates, name) for name in ("AWAY", "ALIKE_CM", "SHORTEST", "ALONE")},
            **{"TURNING": reach.TURNING, "FEW": coverage.FEW, "ENOUGH": reach.ENOUGH, "AFTER": costs.AFTER},
        },
    )


def _table(name: str, table: pd.DataFrame) -> dict[str, Any]:
    """Rows that the page shows, and how many there are."""
    rows = plain(table if name == "features" else table.head(SHOWN))
    return {"columns": list(table.columns), "rows": rows, "all": len(table), "name": name}


def _pictures(found: Analysis) -> Iterable[tuple[str, str]]:
    """SVG by name."""
    for name in ("histograms", "boxes", "correlations", "variance", "component_map", "speeds", "nearest"):
        with figures.style(name):
            yield name, figures.svg(getattr(pictures, name)(found), name.replace("_", " "))
    if found.coverage is not None:
        with figures.style("coverage"):
            yield (
                "coverage",
                figures.svg(coverage.figure(found.coverage, found.name), "coverage of what is asked"),
            )
    if found.run is not None:
        with figures.style("run"):
            yield "run", figures.svg(pictures.run(found.run), "the run")
