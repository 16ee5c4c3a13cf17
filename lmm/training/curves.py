"""Error against minutes of training, drawn from logs."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motion import figures, files
from motion.errors import UserError

from . import log
from .log import Record

PARTS: dict[str, Any] = {
    "held_out": "-",
    "training": (0, (3, 2)),
}  # how the line of each part of the data is drawn
LABELS = {"error_cm": "error, cm"}


def check_output(path: str | os.PathLike[str], *, inputs: Sequence[str]) -> None:
    """A UserError unless path can be written and its name says in which form."""
    if Path(path).suffix.lower() not in (".png", ".svg"):
        raise UserError("unknown form of picture", path=path, remedy="name a .png or a .svg")
    files.check_output(path, inputs=inputs)


def save(path: str | os.PathLike[str], logs: Sequence[str], names: Sequence[str]) -> None:
    """Draw logs, each under a name, into a .png or .svg file."""
    records = [log.read(one) for one in logs]
    with figures.style("curves"):
        picture = draw(records, names)
        # On white: a file of its own has no page to take its colours from.
        data = figures.png(picture) if Path(path).suffix.lower() == ".png" else _svg(picture)
    with files.atomic(path) as stream:
        stream.write(data)


def _svg(picture: Any) -> bytes:
    import io

    data = io.BytesIO()
    picture.savefig(data, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
    return data.getvalue()


def draw(logs: Sequence[Sequence[Record]], names: Sequence[str]) -> Any:
    """A matplotlib figure: a panel a stage, a colour a log, a line a part of the data; both axes logarithmic.

    Time is the stage's own, minutes. The error is ``error_cm`` where the stage has it, else its first.
    """
    stages = list(dict.fromkeys(record["stage"] for records in logs for record in records))
    picture, panels = figures.figure(3.4 * len(stages) + 0.6, 3.2, len(stages))
    for axes, stage in zip(panels, stages, strict=True):
        which = _error([record for records in logs for record in records if record["stage"] == stage])
        for colour, records in zip(_colours(len(logs)), logs, strict=True):
            for part, line in PARTS.items():
                minutes, errors = series(records, stage, part, which)
                axes.plot(
                    minutes,
                    errors,
                    color=colour,
                    linestyle=line,
                    linewidth=1.2,
                    marker="." * (len(minutes) < 2),
                )
        axes.set_title(stage, fontsize=9)
        axes.set_xlabel("minutes of training")
        axes.set_ylabel(LABELS.get(which, which.replace("_", " ")))
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(_sparse)
        axes.grid(True, which="both", linewidth=0.5)
    picture.legend(
        handles=_legend(names), loc="outside lower left", ncols=len(names) + len(PARTS), fontsize=8
    )
    return picture


def series(records: Sequence[Record], stage: str, part: str, error: str) -> tuple[list[float], list[float]]:
    """Minutes of a stage's own training, and an error on a part of the data at each; both above 0."""
    begun = 0.0
    minutes: list[float] = []
    errors: list[float] = []
    for record in records:
        if record["stage"] != stage:
            if not minutes:
                begun = record["seconds"]
            continue
        value = record["errors"].get(part, {}).get(error)
        if value is not None and value > 0 and record["seconds"] > begun:
            minutes.append((record["seconds"] - begun) / 60)
            errors.append(value)
    return minutes, errors


def _error(records: Sequence[Record]) -> str:
    found = dict.fromkeys(name for r in records for errors in r["errors"].values() for name in errors)
    return "error_cm" if "error_cm" in found or not found else next(iter(found))


def _colours(count: int) -> list[str]:
    return [figures.COLOURS[i % len(figures.COLOURS)] for i in range(count)]


def _legend(names: Sequence[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    plain = [name.replace("$", r"\$") for name in names]  # no formulas
    handles = [Line2D([], [], color=c, label=n) for n, c in zip(plain, _colours(len(names)), strict=True)]
    styles = [
        Line2D([], [], color=figures.INK, linestyle=line, label=part.replace("_", " "))
        for part, line in PARTS.items()
    ]
    return handles + styles


def _sparse(value: float, place: int) -> str:
    """Labels of a logarithmic axis between its powers of ten: 2, 3 and 5 only."""
    first = f"{value:e}"[0] if value > 0 and math.isfinite(value) else ""
    return f"{value:g}" if first in ("2", "3", "5") else ""
