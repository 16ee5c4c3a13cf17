"""What a comparison leaves behind: CSV, JSON, and one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from features.terrain import flat
from motion import figures, files

from . import colours, plots, strips, tables
from .columns import BRIEF, COLUMNS, GROUPS, Column
from .comparison import DATA, TABLES, Comparison
from .intervals import CI
from .memory.measure import KINDS
from .memory.pareto import with_fronts
from .memory.plots import against_error
from .pages import known, number, render

STRIPS = 3  # different ways a course whose film strips are seen at once, at least


def save(comparison: Comparison, folder: Path, *, command: str) -> list[Path]:
    """Write the tables (see `bench.tables`) and report.html, all of them or none."""
    texts = tables.contents(comparison, command=command) | {"report.html": html(comparison, command=command)}
    stale = [f"{tables.FOLDER}/{name}" for name in tables.files(TABLES)]
    return files.write_together(folder, texts, stale=stale)


def brief(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows for the terminal: the columns that matter most, rounded; None where there is no number."""
    of = {column.name: column for column in COLUMNS}
    rows = []
    for row in table.to_dict("records"):
        cells: dict[str, Any] = {"system": row["system"]}
        if "course" in row:
            cells["course"] = row["course"]
        for name in (name for name in BRIEF if name in table):
            column, value = of[name], row[name]
            half = row.get(f"{name}{CI}")
            cells[column.heading] = round(float(value), column.digits) if known(value) else None
            if known(value) and known(half):
                cells[column.heading] = f"{number(value, column.digits)} ± {number(half, column.digits)}"
        rows.append(cells)
    return rows


def html(comparison: Comparison, *, command: str) -> str:
    """The page."""
    shades = colours.of(name for name in comparison.summary["system"] if name != DATA)
    return render(
        "report.html",
        comparison=comparison,
        command=command,
        data=DATA,
        summary=table(comparison.summary, shades),
        published=comparison.published.to_dict("records"),
        number=number,
        pictures=_pictures(comparison, shades),
        sections=[_section(comparison, course, shades) for course in comparison.played],
    )


def table(rows: pd.DataFrame, shades: Mapping[str, str]) -> dict[str, Any]:
    """Rows of systems by groups of columns, as the page's macro `systems` takes them.

    Half the widths of intervals (`bench.intervals.CI`) stand below the numbers. The best are marked.
    """
    judged = (rows["system"] != DATA).to_numpy()
    groups: list[dict[str, Any]] = []
    columns: list[Column] = []
    best: dict[str, Any] = {}
    for name, every in GROUPS.items():
        own = [c for c in every if c.name in rows and rows[c.name].notna().any()]
        own.sort(key=lambda column: not column.telling)
        groups += [{"name": name, "columns": own, "telling": sum(c.telling for c in own)}] * bool(own)
        columns += own
    for column in columns:
        best[column.name] = np.zeros(len(rows), bool)
        best[column.name][judged] = column.best(rows.loc[judged, column.name])
    first = {group["columns"][0].name for group in groups}

    def classes(column: Column, *more: str) -> str:
        known = ["first-of-group"] * (column.name in first) + ["seldom"] * (not column.telling)
        return " ".join([*known, *more])

    def cell(i: int, row: Mapping[str, Any], column: Column) -> dict[str, str]:
        half = row.get(f"{column.name}{CI}")
        between = f"± {number(half, column.digits)}" if known(half) else ""
        marked = ["best"] * bool(best[column.name][i])
        text = number(row[column.name], column.digits)
        return {"text": text, "range": between, "classes": classes(column, *marked)}

    return {
        "groups": groups,
        "columns": [(column, classes(column)) for column in columns],
        "seldom": not all(column.telling for column in columns),
        "rows": [
            {
                "name": row["system"],
                "colour": shades.get(row["system"], ""),
                "classes": "" if judged[i] else "yardstick",
                "cells": [cell(i, row, column) for column in columns],
            }
            for i, row in enumerate(rows.to_dict("records"))
        ],
    }


def _pictures(comparison: Comparison, shades: Mapping[str, str]) -> list[tuple[str, str]]:
    """Title and SVG of the figures over all courses."""
    systems = comparison.summary[comparison.summary["system"] != DATA]
    decoded, crowd = _decoded(systems), comparison.crowd
    draws: list[tuple[str, Callable[[], Any]]] = [
        ("What systems are worth beside what a frame costs", lambda: plots.worth(systems, shades)),
        ("Memory against the error of decoded poses", lambda: len(decoded) and against_error(decoded)),
        ("Cost of a frame by stage", lambda: plots.costs(systems)),
        ("Cost by number of characters", lambda: len(crowd) and plots.crowd(crowd, shades)),
        ("Memory by part", lambda: plots.memory(systems)),
        ("Skate and distance from the path", lambda: plots.skate_and_path(comparison.summary, shades)),
    ]
    out = []
    for title, draw in draws:
        with figures.style(title):
            picture = draw()
            out += [(title, figures.svg(picture, title))] if picture else []
    return out


def _decoded(systems: pd.DataFrame) -> pd.DataFrame:
    """Systems of which is known what they make of true frames, as `bench.memory` has them; none where no pose
    differs from the data's."""
    if "pose_cm" not in systems or not (systems["pose_cm"] > 0).any():
        return systems[:0]
    kinds = [KINDS.get(colours.family(name), "other") for name in systems["system"]]
    return with_fronts(systems.assign(kind=kinds, error="decoded"))


def _section(comparison: Comparison, course: Any, shades: Mapping[str, str]) -> dict[str, Any]:
    """What the page shows of one course."""
    traces = [t for t in comparison.traces if t.course == course.name]
    rows = comparison.courses[comparison.courses["course"] == course.name]
    pictures = []
    for what, draw, same in (
        ("ways from above", plots.paths, plots.groups(traces, poses=False)),
        ("speed and foot skate over time", plots.over_time, plots.groups(traces)),
    ):
        title = f"{course.name}: {what}"
        with figures.style(title):
            pictures += [figures.svg(draw(same, shades, comparison.ground), title)] if same else []
    return {
        "name": course.name,
        "description": course.description,
        "table": table(rows, shades),
        "pictures": pictures,
        "strips": _strips(comparison, traces, course.name),
    }


def families(traces: Sequence[Any]) -> list[tuple[list[list[Any]], list[list[Any]]]]:
    """Groups whose film strips are drawn, by family of systems: those shown at once, and those on demand.

    Those of a family that went the same way are a group; others may stand at one place in other poses. Shown
    at once are the first of each family, and `STRIPS` in any case.
    """
    members: dict[str, list[Any]] = {}
    for trace in traces:
        members.setdefault(colours.family(trace.system), []).append(trace)
    groups = [plots.groups(own, poses=False) for own in members.values()]
    more = max(STRIPS - len(groups), 0)
    out = []
    for own in groups:
        count = min(1 + more, len(own))
        more -= count - 1
        out.append((own[:count], own[count:]))
    return out


def _strips(comparison: Comparison, traces: Sequence[Any], course: str) -> list[dict[str, Any]]:
    """Title and SVG of film strips, by family, those shown at once and those on demand."""
    out, cell = [], strips.widest(traces) if traces else None
    for shown, others in families(traces):
        strip: dict[str, list[Any]] = {
            "shown": [],
            "others": [],
            "names": [plots.label(group) for group in others],
        }
        for kind, own in (("shown", shown), ("others", others)):
            for group in own:
                title = plots.label(group)
                with figures.style(f"{course} {title}"):
                    ground = comparison.ground or flat
                    picture = strips.figure(group[0], feet=comparison.feet, cell=cell, ground=ground)
                    svg = figures.svg(picture, f"{course}: film strip of {title}")
                strip[kind].append((title, [trace.system for trace in group], svg))
        out.append(strip)
    return out
