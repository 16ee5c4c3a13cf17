"""What the question of scale leaves behind: tables, JSON, pictures, and one page that needs nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from bench import pages
from bench.tables import files as files_of
from bench.tables import plain, written
from motion import figures, files

from . import plots
from .measure import Scale

TABLES = ("indexes", "systems", "models", "fits")
FILES = (*(f"{name}.csv" for name in TABLES), "scale.json", "search.png", "systems.png", "report.html")
# Column, title, digits, what it is.
INDEXES = (
    ("minutes", "minutes", 1, "of capture: mirrored copies do not count"),
    ("frames", "frames", 0, "that are searched, mirrored copies among them"),
    ("memory_mb", "MB", 2, "features and index, 10^6 bytes"),
    ("build_s", "build s", 2, "building the index, one pinned thread"),
    ("median_us", "µs", 1, "median of a search, one pinned thread"),
    ("p99_us", "p99 µs", 0, "99th percentile of that"),
    ("recall", "recall", 3, "share of searches that find what costs the least"),
    ("cost_regret", "regret", 4, "what is found costs more than the best, as a share, mean"),
)
SYSTEMS = (
    ("minutes", "minutes", 1, "of capture: mirrored copies do not count"),
    ("frames", "frames", 0, "of the database, mirrored copies among them"),
    ("memory_mb", "MB", 1, "all that it holds of one character"),
    ("prepare_s", "data s", 1, "making the database, of the built-in data with its dance"),
    ("frame_us", "frame µs", 1, "median of a frame, one character, one pinned thread"),
    ("frame_mean_us", "mean µs", 1, "mean of a frame, its share of the searches included"),
    ("search_us", "search µs", 1, "median of the projection over the frames that searched"),
    ("unseen_cm", "unseen cm", 2, "joints of poses that are not in the data from the nearest in it"),
    ("found_cm", "found cm", 1, "future places of what a search finds from those that it was asked for"),
    ("path_cm", "way cm", 1, "mean distance from the commanded way"),
    ("heading_deg", "facing °", 1, "mean difference from the commanded facing"),
    ("skate_cm_s", "skate cm/s", 2, "foot skate (see bench compare)"),
)


def save(found: Scale, folder: Path, *, command: str) -> list[Path]:
    """Write the tables, their JSON, the pictures and the page, all of them or none."""
    contents = written({name: table for name in TABLES if len(table := getattr(found, name))})
    contents["scale.json"] = json.dumps(to_json(found, command=command), indent=1, allow_nan=False) + "\n"
    for name in ("search", "systems"):
        with figures.style(name):
            contents[f"{name}.png"] = figures.png(getattr(plots, name)(found))
    contents["report.html"] = html(found, command=command)
    return files.write_together(folder, contents, stale=files_of(TABLES))


def to_json(found: Scale, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    return {
        "command": command,
        "data": found.data,
        "plan": asdict(found.plan),
        "machine": found.machine,
        "notes": found.notes,
    } | {name: plain(getattr(found, name)) for name in TABLES}


def exponents(found: Scale) -> list[dict[str, Any]]:
    """A row an index or system, a column a quantity: the exponent and half of its 95 % interval."""
    rows: dict[str, dict[str, Any]] = {}
    quantities = list(dict.fromkeys(found.fits["quantity"]))
    for fit in found.fits.to_dict("records"):
        row = rows.setdefault(fit["of"], {"of": fit["of"]} | dict.fromkeys(quantities))
        if math.isfinite(fit["exponent"]):
            row[fit["quantity"]] = _power(fit)
    return list(rows.values())


def _power(fit: Mapping[str, Any]) -> str:
    """An exponent and half of its 95 % interval, where that is known."""
    half = f" ± {fit['ci95']:.2f}" if math.isfinite(fit["ci95"]) else ""
    return f"{fit['exponent']:.2f}{half}"


def facts(found: Scale) -> list[str]:
    """Sentences that follow from the numbers."""
    fits, out = found.fits, []
    last = found.indexes[found.indexes["minutes"] == found.indexes["minutes"].max()]
    exact = last[last["recall"] == 1]
    if len(exact):
        best = exact.loc[exact["median_us"].idxmin()]
        out.append(
            f"At {best['minutes']:g} minutes {best['index']} is the fastest of those that always find what "
            f"costs the least: {best['median_us']:.3g} µs a search."
        )
    surest = found.indexes.groupby("index")["recall"].min()
    always = surest.index[surest == 1]
    searched = fits[(fits["column"] == "median_us") & (fits["points"] > 1) & fits["of"].isin(always)]
    if len(searched):
        slow, fast = searched.loc[searched["exponent"].idxmax()], searched.loc[searched["exponent"].idxmin()]
        out.append(
            "Of these, a search's time grows with the minutes to the power of "
            f"{_power(fast)} by {fast['of']}, the least, and of {_power(slow)} by {slow['of']}, the most."
        )
    for column, what in (("unseen_cm", "Unseen poses come closer"), ("found_cm", "Futures are met better")):
        own = found.systems.dropna(subset=[column])
        if len(own) > 1:
            a, b = own.iloc[0], own.iloc[-1]
            change = f"{a[column]:.2f} cm at {a['minutes']:g} minutes, {b[column]:.2f} cm at {b['minutes']:g}"
            out.append(f"{what if b[column] < a[column] else what + ' not'}: {change}.")
    return out


def rows(table: pd.DataFrame, columns: tuple[tuple[str, str, int, str], ...]) -> list[dict[str, Any]]:
    """Rows for a terminal: what it is of, and the columns there are, rounded."""
    first = next(name for name in ("index", "system") if name in table)
    out = []
    for row in table.to_dict("records"):
        cells: dict[str, Any] = {first: row[first]}
        for name, title, digits, _ in columns:
            if name in table:
                cells[title] = round(float(row[name]), digits or None) if pages.known(row[name]) else None
        out.append(cells)
    return out


def html(found: Scale, *, command: str) -> str:
    """The page."""
    pictures = {}
    for name in ("search", "systems"):
        with figures.style(name):
            pictures[name] = figures.svg(getattr(plots, name)(found))
    return pages.render(
        "scale.html",
        found=found,
        facts=facts(found),
        pictures=pictures,
        exponents=exponents(found),
        tables=[
            (title, first, [c for c in columns if c[0] in table], table.to_dict("records"))
            for title, first, columns, table in (
                ("Search indexes", "index", INDEXES, found.indexes),
                ("Motion matching", "system", SYSTEMS, found.systems),
                ("Models", "system", SYSTEMS, found.models),
            )
            if len(table)
        ],
        number=pages.number,
        command=command,
    )
