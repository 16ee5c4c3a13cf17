"""What a comparison of motion leaves behind: tables, pictures, and one page to look at all of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from bench.pages import render
from bench.tables import written as tables_on_disk
from motion import figures, files

from . import pictures
from .compare import Likeness

WORST = 40  # rows of the page's table of what lies outside
COLUMNS = ("measure", "unit", "a", "a_low", "a_high", "b", "b_low", "b_high", "inside", "off")


def save(
    likeness: Likeness, folder: Path, *, command: str, progress: Callable[..., Iterator[Any]] | None = None
) -> list[Path]:
    """Write the tables, index.html and three pictures a move; returns their paths."""
    written = []
    shown = []
    for move in progress(likeness.moves, label="draw") if progress else likeness.moves:
        names = {}
        for kind, draw in (
            ("strip", pictures.strip),
            ("curves", pictures.curves_figure),
            ("spectra", pictures.spectra_figure),
        ):
            picture = draw(likeness, move)
            if picture is None:
                continue
            names[kind] = f"{kind}-{move.replace(' ', '-')}.png"
            with files.atomic(folder / names[kind]) as stream:
                stream.write(figures.png(picture))
            written.append(folder / names[kind])
        shown.append((move, names, likeness.table[likeness.table["move"] == move].to_dict("records")))
    page = render(
        "likeness.html",
        likeness=likeness,
        command=command,
        summary=likeness.summary(),
        by_measure=likeness.by_measure(WORST),
        worst=likeness.worst(WORST).to_dict("records"),
        shown=shown,
        columns=COLUMNS,
        number=number,
    )
    tables = tables_on_disk({"table": likeness.table, "summary": pd.DataFrame(likeness.summary())})
    return [*written, *files.write_together(folder, tables | {"index.html": page})]


def number(value: Any) -> str:
    """A cell of the page: three digits, yes and no, nothing for what is not known."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.0f}" if abs(value) >= 100 else f"{value:.1f}" if abs(value) >= 10 else f"{value:.2f}"
    return str(value)


def rounded(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows for the terminal with three digits."""
    return [{k: float(f"{v:.3g}") if isinstance(v, float) else v for k, v in row.items()} for row in rows]


def rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows for the terminal, rounded; None where there is no number."""
    out = []
    for row in table.to_dict("records"):
        cells: dict[str, Any] = {"move": row["move"], "measure": row["measure"], "unit": row["unit"]}
        for name in ("a", "a_low", "a_high", "b", "b_low", "b_high"):
            cells[name] = float(f"{row[name]:.3g}")
        cells["inside"] = None if row["inside"] is None else "yes" if row["inside"] else "no"
        cells["off"] = round(row["off"], 1) if math.isfinite(row["off"]) else None
        out.append(cells)
    return out


def to_json(likeness: Likeness) -> dict[str, Any]:
    """All numbers as plain data; None instead of what is not a number."""

    def plain(value: Any) -> Any:
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {
        "a": {"sources": likeness.a.name, "clips": likeness.a.clips, "seconds": likeness.a.seconds},
        "b": {"sources": likeness.b.name, "clips": likeness.b.clips, "seconds": likeness.b.seconds},
        "notes": likeness.notes,
        "summary": likeness.summary(),
        "by_measure": likeness.by_measure(),
        "table": [{k: plain(v) for k, v in row.items()} for row in likeness.table.to_dict("records")],
    }
