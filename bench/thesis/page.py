"""What the reproduction leaves behind: CSV, JSON, and one page that needs nothing else."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from bench.pages import number, render
from bench.tables import plain, written
from motion import figures, files

from . import plots, published
from .measure import Thesis

# Column, title, digits after the point; of the summary.
COLUMNS = (
    ("frame_ms", "frame ms", 3),
    ("frame_ms_sd", "sd ms", 4),
    ("frame_median_ms", "median ms", 3),
    ("published_frame_ms", "thesis ms", 3),
    ("published_frame_ms_sd", "its sd ms", 4),
    ("relative", "rel. error", 4),
    ("relative_sd", "error sd", 5),
    ("published_relative", "thesis error", 4),
    ("published_relative_sd", "its error sd", 5),
    ("operations", "operations", 0),
    ("published_operations", "thesis op.", 0),
    ("path_cm", "path cm", 1),
    ("path_max_cm", "path max cm", 1),
)
FILES = ("summary.csv", "laps.csv", "files.csv", "thesis.json", "report.html")


def save(thesis: Thesis, folder: Path, *, command: str) -> list[Path]:
    """Write the tables, thesis.json and report.html, all of them or none."""
    texts = written({name: getattr(thesis, name) for name in ("summary", "laps", "files")}) | {
        "thesis.json": json.dumps(to_json(thesis, command=command), indent=1, allow_nan=False) + "\n",
        "report.html": html(thesis, command=command),
    }
    return files.write_together(folder, texts)


def to_json(thesis: Thesis, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    return {
        "command": command,
        "source": published.SOURCE,
        "database": thesis.database,
        "models": thesis.models,
        "machine": thesis.machine,
        "notes": thesis.notes,
        "course": thesis.course,
        "mode": thesis.mode,
        "line": None if thesis.line is None else list(thesis.line),
        "training": thesis.training,
    } | {name: plain(getattr(thesis, name)) for name in _TABLES}


_TABLES = ("summary", "differences", "modes", "pipeline", "sizes", "laps", "files")


def brief(thesis: Thesis) -> list[dict[str, Any]]:
    """Rows for the terminal."""
    out = []
    for row in thesis.summary.to_dict("records"):
        cells: dict[str, Any] = {"configuration": row["configuration"]}
        for name, title, digits in COLUMNS:
            if not (name.startswith("published") and name.endswith("_sd")):
                known = math.isfinite(row[name])
                cells[title] = round(float(row[name]), digits or None) if known else None
        out.append(cells)
    return out


def duration(seconds: float) -> str:
    """Seconds as people say them; a dash where there are none."""
    if not math.isfinite(seconds):
        return "–"
    for unit, size in (("h", 3600), ("min", 60), ("s", 1), ("ms", 1e-3)):
        if seconds >= size or unit == "ms":
            return f"{seconds / size:.3g} {unit}"
    raise AssertionError


def size(mb: float) -> str:
    """MB as people say them; a dash where there are none."""
    if not math.isfinite(mb):
        return "–"
    return f"{mb / 1000:.3g} GB" if mb >= 1000 else f"{mb:.3g} MB"


def html(thesis: Thesis, *, command: str) -> str:
    """The page."""
    laps = thesis.laps.pivot(index="lap", columns="configuration", values="mean_ms")
    return render(
        "thesis.html",
        thesis=thesis,
        source=published.SOURCE,
        names=published.CONFIGURATIONS,
        columns=COLUMNS,
        summary=thesis.summary.to_dict("records"),
        differences=thesis.differences.to_dict("records"),
        modes=thesis.modes.to_dict("records"),
        pipeline=thesis.pipeline.to_dict("records"),
        sizes=thesis.sizes.to_dict("records"),
        laps=[(lap, row.to_dict()) for lap, row in laps.iterrows()],
        lapped=[name for name in published.CONFIGURATIONS if name in laps],
        worst=_worst(thesis),
        pictures=_pictures(thesis),
        number=number,
        duration=duration,
        size=size,
        command=command,
    )


def _worst(thesis: Thesis) -> list[dict[str, Any]]:
    """The files of the largest error of each configuration."""
    if not len(thesis.files):
        return []
    at = thesis.files.groupby("configuration", sort=False)["relative"].idxmax()
    return thesis.files.loc[at].to_dict("records")


def _pictures(thesis: Thesis) -> dict[str, str]:
    """SVG by name; those of which nothing was measured show the thesis's part alone."""
    out = {}
    for name in ("laps", "lap_boxes", "files", "file_boxes", "training", "operations"):
        with figures.style(name):
            out[name] = figures.svg(getattr(plots, name)(thesis), name.replace("_", " "))
    return out
