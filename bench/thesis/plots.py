"""The thesis's figures, of what was measured beside what it has (see `motion.figures` for their style)."""

from __future__ import annotations

from typing import Any

import numpy as np

from motion.figures import COLOURS, INK, figure

from . import published
from .measure import Thesis

NAMES = (*published.CONFIGURATIONS, published.MASKED)
COLOUR = dict(zip(NAMES, COLOURS, strict=False))


def laps(thesis: Thesis) -> Any:
    """Mean milliseconds a frame, lap by lap (Figure 5.1): measured, and the thesis's."""
    picture, (left, right) = figure(10, 3.4, 2)
    for name, rows in thesis.laps.groupby("configuration", sort=False):
        left.plot(rows["lap"], rows["mean_ms"], ".-", color=COLOUR[name], linewidth=1, label=name)
    for name, values in published.LAPS_MS.items():
        right.plot(1 + np.arange(len(values)), values, ".-", color=COLOUR[name], linewidth=1, label=name)
    _beside(left, right, "mean of a frame, ms")
    for axes in (left, right):
        axes.set_xlabel("lap")
        axes.set_xlim(0, None)
        axes.xaxis.get_major_locator().set_params(integer=True)
    _legend(picture, left, right)
    return picture


def lap_boxes(thesis: Thesis) -> Any:
    """The same as boxes over the laps (Figure 5.2)."""
    picture, (left, right) = figure(10, 3, 2)
    mine = {n: rows["mean_ms"].to_numpy() for n, rows in thesis.laps.groupby("configuration", sort=False)}
    _boxes(left, mine)
    _boxes(right, {name: np.array(values) for name, values in published.LAPS_MS.items()})
    _beside(left, right, "mean of a frame, ms; box: quartiles of the laps")
    return picture


def files(thesis: Thesis) -> Any:
    """Mean relative error of each file (Figure 5.6)."""
    picture, (axes,) = figure(10, 3.4)
    for name, rows in thesis.files.groupby("configuration", sort=False):
        at = np.arange(len(rows))
        axes.plot(at, 100 * rows["relative"], ".-", color=COLOUR[name], linewidth=1, markersize=4, label=name)
        held = rows["held_out"].to_numpy(bool)
        axes.plot(
            at[held], 100 * rows["relative"].to_numpy()[held], "o", color=COLOUR[name], fillstyle="none"
        )
    axes.plot([], [], "o", color=INK, fillstyle="none", label="held out")
    axes.set_xlabel("file, in the database's order")
    axes.set_ylabel("relative error, %")
    axes.set_ylim(bottom=0)
    axes.grid(True, axis="y")
    axes.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1), ncols=len(NAMES) + 1)
    return picture


def file_boxes(thesis: Thesis) -> Any:
    """The same as boxes over the files (Figure 5.8); the thesis's reach from the least to the greatest."""
    picture, (left, right) = figure(10, 3, 2)
    by_name = thesis.files.groupby("configuration", sort=False)
    _boxes(left, {name: 100 * rows["relative"].to_numpy() for name, rows in by_name})
    keys = ("whislo", "q1", "med", "q3", "whishi")
    theirs = [
        dict(zip(keys, (100 * value for value in box), strict=True)) | {"label": name, "fliers": []}
        for name, box in published.ACCURACY_BOX.items()
    ]
    right.bxp(theirs, widths=0.5, showfliers=False, medianprops={"color": COLOURS[1]})
    _beside(left, right, "relative error, %; box: quartiles of the files")
    return picture


def training(thesis: Thesis) -> Any:
    """Mean squared error of all outputs during training (Figure 5.11)."""
    picture, (left, right) = figure(10, 3.4, 2)
    for name, curve in thesis.training.items():
        left.plot(curve["epochs"], curve["mse"], color=COLOUR[name], linewidth=1.2, label=name)
    for name, points in published.TRAINING.items():
        right.plot(list(points), list(points.values()), color=COLOUR[name], linewidth=1.2, label=name)
    _beside(left, right, "mean squared error of the outputs")
    for axes in (left, right):
        axes.set_xlabel("epochs")
    left.set_xlabel("epochs: passes over the frames of the database")
    _legend(picture, left, right)
    return picture


def operations(thesis: Thesis) -> Any:
    """Milliseconds a frame by the number of operations, and the lines through them (Figure 6.1)."""
    picture, (axes,) = figure(10, 3.2)
    rows = thesis.summary.dropna(subset=["frame_ms", "operations"])
    theirs = thesis.summary.dropna(subset=["published_frame_ms", "published_operations"])
    for what, x, y, line, colour in (
        ("measured", rows["operations"], rows["frame_ms"], thesis.line, COLOURS[0]),
        (
            "the thesis",
            theirs["published_operations"],
            theirs["published_frame_ms"],
            published.LINE,
            COLOURS[1],
        ),
    ):
        axes.plot(x, y, "o", color=colour, label=what)
        named = thesis.summary.loc[x.index, "configuration"]
        for at in x.unique():  # who differs in training alone stands in one place
            here = x[x == at].index
            label, ms = ", ".join(named[here]), y[here].mean()
            axes.annotate(label, (at, ms), textcoords="offset points", xytext=(6, -3), fontsize=7)
        if line is not None and len(x):
            ends = np.array([0, 1.05 * x.max()])
            axes.plot(ends, line[0] * ends + line[1], color=colour, linewidth=0.9, linestyle="--")
    axes.set_xlabel("operations of the network (formula 6.1)")
    axes.set_ylabel("mean of a frame, ms")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(True)
    axes.legend(fontsize=7)
    return picture


def _boxes(axes: Any, series: dict[str, Any]) -> None:
    if series:
        axes.boxplot(list(series.values()), widths=0.5, medianprops={"color": COLOURS[1]})
        axes.set_xticks(1 + np.arange(len(series)), list(series))


def _beside(left: Any, right: Any, label: str) -> None:
    for axes, title in ((left, "measured"), (right, "the thesis")):
        axes.set_title(title, fontsize=9)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0)
        axes.grid(True, axis="y")


def _legend(picture: Any, *panels: Any) -> None:
    handles = {
        label: h for axes in panels for h, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    picture.legend(
        handles.values(), handles.keys(), loc="outside lower left", ncols=len(handles) or 1, fontsize=7
    )
