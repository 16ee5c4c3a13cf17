"""What the memory question leaves behind: a table, JSON, pictures, and one page that needs nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from bench import colours
from bench.pages import known, number, render
from bench.tables import plain, written
from motion import figures, files

from . import plots, resident
from .allocations import FRAMES
from .measure import Memory

# Column, title, digits after the point, what it is; `{n}` stands for a number of characters.
COLUMNS = (
    ("stored_mb", "stored MB", 2, "files that it is read from"),
    ("memory_mb", "loaded MB", 2, "what it holds of all data and one character"),
    (
        "resident_mb",
        "resident MB",
        1,
        "what a process holds more for it; a file that it still reads a part of counts as a whole",
    ),
    ("peak_mb", "peak MB", 1, "the most that a process held more while it was made and run"),
    (
        "pose_cm",
        "error cm",
        3,
        "joints of poses decoded of true frames from those of the data, training clips",
    ),
    ("pose_p99_cm", "p99 cm", 2, "99th percentile of that"),
    ("pose_worst_cm", "worst cm", 2, "mean of the worst joint"),
    ("pose_deg", "error °", 2, "mean angle between the joints' own rotations, decoded and true"),
    ("pose_cm_s", "cm/s", 1, "mean difference of the joints' velocities"),
    ("pose_held_cm", "held-out cm", 3, "joints of clips that no model was trained on"),
    ("drift_cm", "drift cm", 2, "joints after ten frames that the Stepper makes of its own, training clips"),
    ("drift_held_cm", "held-out drift cm", 2, "the same on clips that no model was trained on"),
)
ALLOCATED = (
    ("frame_bytes_{n}", "frame B, {n}", 0, "bytes that a frame of {n} characters allocates and frees again"),
    ("search_bytes_{n}", "search B, {n}", 0, "the same of a frame in which any of {n} searches"),
    (
        "blocks_{n}",
        "blocks, {n}",
        0,
        "small blocks of numba's runtime a frame of {n}: one an array handed over",
    ),
    ("kept_bytes_{n}", "kept B, {n}", 0, "bytes held after all the frames of {n} and not before"),
)
BOUNDS = (0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)  # cm
FILES = ("memory.csv", "memory.json", "pareto.png", "report.html")


def save(memory: Memory, folder: Path, *, command: str) -> list[Path]:
    """Write the table, its JSON, the plot of memory against error and the page, all of them or none."""
    with figures.style("pareto"):
        picture = figures.png(plots.against_error(memory.systems))
    contents = written({"memory": memory.systems}) | {
        "memory.json": json.dumps(to_json(memory, command=command), indent=1, allow_nan=False) + "\n",
        "pareto.png": picture,
        "report.html": html(memory, command=command),
    }
    return files.write_together(folder, contents)


def to_json(memory: Memory, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    tables = {name: plain(getattr(memory, name)) for name in ("systems", "features", "published")}
    return {
        "command": command,
        "database": memory.database,
        "models": memory.models,
        "machine": memory.machine,
        "notes": memory.notes,
    } | tables


def columns(memory: Memory) -> list[tuple[str, str, int, str]]:
    """Those of `COLUMNS` and `ALLOCATED` that were measured."""
    counts = [c.removeprefix("frame_bytes_") for c in memory.systems if c.startswith("frame_bytes_")]
    every = list(COLUMNS) + [
        (name.format(n=n), title.format(n=n), digits, about.format(n=n))
        for n in counts
        for name, title, digits, about in ALLOCATED
    ]
    return [column for column in every if column[0] in memory.systems]


def brief(memory: Memory) -> list[dict[str, Any]]:
    """Rows for the terminal; a star marks what is on the Pareto front."""
    rows = []
    for row in memory.systems.to_dict("records"):
        cells: dict[str, Any] = {"system": row["system"], "front": "*" if row.get("front") else ""}
        for name, title, digits, _ in columns(memory):
            cells[title] = round(float(row[name]), digits or None) if known(row[name]) else None
        rows.append(cells)
    return rows


def facts(memory: Memory) -> list[str]:
    """Sentences that follow from the numbers."""
    rows, out = memory.systems, []
    for _, column, _ in (panel for panel in plots.PANELS if panel[2] in rows):
        words = smallest(rows, column)
        of = (
            "On clips that were held out these are" if column != "pose_cm" else "The smallest whose poses are"
        )
        out += [f"{of} {'; '.join(words)}."] * bool(words)
    drifting = rows[rows["drift_cm"].notna()] if "drift_cm" in rows else rows[:0]
    if len(drifting):
        row = drifting.iloc[0]
        states = f"true states {row['pose_cm']:.2g} cm off, those that it made itself for ten frames"
        out.append(f"{row['system']} decodes {states} {row['drift_cm']:.2g} cm, on average.")
    if "frame_bytes_1" in rows:
        least, most = rows["frame_bytes_1"].min(), rows["frame_bytes_1"].max()
        searching, kept = rows["search_bytes_1"].max(), rows["kept_bytes_1"].max()
        with_search = f", one with a search up to {searching:,.0f}" if known(searching) else ""
        out.append(
            f"A frame of one character allocates {least:,.0f} to {most:,.0f} bytes and frees them again"
            f"{with_search}; {FRAMES} frames together leave at most {kept:,.0f} behind."
        )
    return out


def smallest(rows: pd.DataFrame, column: str) -> list[str]:
    """Which system that decodes frames is the smallest within each of `BOUNDS`, where looser ones save."""
    words: list[str] = []
    last = ""
    for bound in BOUNDS:
        fitting = rows[(rows["error"] == "decoded") & (rows[column] <= bound)]
        if len(fitting):
            best = fitting.sort_values("memory_mb").iloc[0]
            if best["system"] != last:
                within = f"within {bound:g} cm" if bound else "the data's own"
                words.append(f"{within}: {best['system']}, {best['memory_mb']:.3g} MB")
            last = best["system"]
    return words


def html(memory: Memory, *, command: str) -> str:
    """The page."""
    pictures = {}
    for name, draw, label in (
        ("against_error", plots.against_error, "memory against error"),
        ("by_part", plots.by_part, "memory by part"),
    ):
        with figures.style(name):
            pictures[name] = figures.svg(draw(memory.systems), label)
    return render(
        "memory.html",
        memory=memory,
        facts=facts(memory),
        columns=columns(memory),
        systems=memory.systems.to_dict("records"),
        colours=colours.of(memory.systems["system"]),
        held={kind: parts(memory.systems, kind) for kind in ("stored", "memory")},
        features=memory.features.to_dict("records"),
        published=memory.published.to_dict("records"),
        pictures=pictures,
        steps=resident.STEPS,
        number=number,
        command=command,
    )


def parts(systems: pd.DataFrame, kind: str) -> list[tuple[str, str]]:
    """Columns of bytes by part, and their titles."""
    found = [c for c in systems if c.startswith(f"{kind}_") and c != f"{kind}_mb"]
    return [(c, c.removeprefix(f"{kind}_").removesuffix("_mb").replace("_", " ")) for c in found]
