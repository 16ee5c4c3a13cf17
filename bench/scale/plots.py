"""What grows with the data, on two logarithmic axes, with the fitted powers."""

from __future__ import annotations

from typing import Any

import numpy as np

from motion.figures import COLOURS, figure

from .fits import power
from .measure import Scale

# Panels: title, and the tables' columns with what they are called there.
SEARCH = (("median_us", "a search, µs"), ("build_s", "building the index, s"), ("memory_mb", "MB"))
MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">")
ERRORS = {"unseen_cm": "unseen poses", "found_cm": "future found", "path_cm": "way gone"}
LEAST_SPAN = 4.0  # from the bottom to the top of an axis


def search(found: Scale) -> Any:
    """Search time, build time and memory (features and index) of the indexes."""
    picture, panels = figure(12, 4.2, len(SEARCH))
    for axes, (column, label) in zip(panels, SEARCH, strict=True):
        for i, (name, rows) in enumerate(found.indexes.groupby("index", sort=False)):
            _grown(axes, rows, column, str(name), COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)])
        _dress(axes, found.indexes["minutes"], label)
    panels[2].set_title("features and index", loc="left", fontsize=8)
    handles, names = panels[0].get_legend_handles_labels()
    picture.legend(handles, names, loc="outside lower center", ncols=5, fontsize=7)
    return picture


def systems(found: Scale) -> Any:
    """Memory, cost of a frame and errors of motion matching; models as lines that no length bends."""
    picture, panels = figure(12, 4.2, 3)
    memory, cost, errors = panels
    name = str(found.systems["system"].iloc[0])
    for axes, column, label in ((memory, "memory_mb", "MB in all"), (cost, "frame_mean_us", "a frame, µs")):
        _grown(axes, found.systems, column, name, COLOURS[0], "o")
        for i, row in enumerate(found.models.to_dict("records")):
            colour = COLOURS[(i + 1) % len(COLOURS)]
            axes.axhline(row[column], color=colour, linewidth=1, linestyle=(0, (5, 2)), label=row["system"])
        _dress(axes, found.systems["minutes"], label)
    for i, (column, title) in enumerate(ERRORS.items()):
        if column not in found.systems:
            continue
        known = found.systems[found.systems[column].astype(float) > 0]
        if len(known):
            _grown(errors, known, column, title, COLOURS[i], MARKERS[i])
            for row in found.models.to_dict("records"):
                if row.get(column) and np.isfinite(row["minutes"]):
                    errors.plot(row["minutes"], row[column], MARKERS[i], color=COLOURS[i], fillstyle="none")
                    errors.annotate(
                        row["system"], (row["minutes"], row[column]), (3, 3), textcoords="offset points",
                        fontsize=5.5,
                    )  # fmt: skip
    _dress(errors, found.systems["minutes"], "cm")
    errors.set_title("from the data, and from what is asked", loc="left", fontsize=8)
    for axes in (memory, errors):
        axes.legend(fontsize=7)
    return picture


def _grown(axes: Any, rows: Any, column: str, name: str, colour: str, marker: str) -> None:
    """Marks of a column by minutes, and the fitted power, whose exponent the legend tells."""
    x, y = rows["minutes"].to_numpy(float), rows[column].to_numpy(float)
    fit = power(x, y)
    slope = f" ({fit.exponent:+.2f})" if np.isfinite(fit.exponent) and column != "build_s" else ""
    axes.plot(x, y, marker, color=colour, markersize=5, label=f"{name}{slope}")
    if np.isfinite(fit.exponent):
        ends = np.array([x.min(), x.max()])
        axes.plot(ends, fit.at(ends), color=colour, linewidth=0.9)


def _dress(axes: Any, minutes: Any, label: str) -> None:
    """Logarithmic axes, the lengths that were measured along the first, and a second that hides no scatter
    but enlarges none, either."""
    from matplotlib.ticker import FixedLocator, LogLocator, NullLocator

    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    spare = max(1.0, (LEAST_SPAN * low / high) ** 0.5)
    axes.set_ylim(low / spare, high * spare)
    axes.xaxis.set_major_locator(FixedLocator(sorted(set(minutes))))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter("{x:g}")
    axes.set_xlabel("minutes of data")
    axes.set_ylabel(label)
    axes.grid(True)
