"""The report's figures (see `motion.figures` for their style)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from features.terrain import Ground
from mm.quality import Trace
from motion.figures import COLOURS, INK, figure, thin

STAGES = (
    "prediction",
    "query",
    "projection",
    "stepping",
    "decompression",
    "inertialization",
    "synchronization",
    "foot_lock",
    "ground",
    "trajectory",
    "network",
    "pose",
)

ABREAST = 7  # names in a line of a legend, at most
MARGIN, RELIEF_POINTS = 0.05, 80  # of a way's extent drawn around it; points a side that tell its ground


def paths(traces: Sequence[Trace], labels: Sequence[str], ground: Ground | None = None) -> Any:
    """Where the systems walked on one course, over what was commanded; with lines of equal height."""
    picture, (axes,) = figure(4.6, 4.2)
    asked = traces[0].path if traces[0].path is not None else traces[0].asked
    what = "commanded path" if traces[0].path is not None else "the command obeyed to the letter"
    axes.plot(*thin(asked, 2000).T, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label=what)
    for trace, label in zip(traces, labels, strict=True):
        axes.plot(*thin(trace.walked, 1500).T, linewidth=1.2, label=label, alpha=0.9)
    axes.plot(*traces[0].walked[0], "o", color=INK, markersize=4)
    if ground is not None:
        _relief(axes, ground, np.concatenate([asked, *(trace.walked for trace in traces)]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # looked at from above with +Z up the page, +X is on the left
    axes.set_xlabel("x, m")
    axes.set_ylabel("z, m")
    axes.legend(loc="upper left", bbox_to_anchor=(0, -0.12), fontsize=7)
    return picture


def _relief(axes: Any, ground: Ground, ways: NDArray) -> None:
    """Lines of equal height, faint, around ways [P, 2]."""
    low, high = ways.min(axis=0), ways.max(axis=0)
    low, high = low - MARGIN * (high - low).max(), high + MARGIN * (high - low).max()
    x, z = (np.linspace(a, b, RELIEF_POINTS) for a, b in zip(low, high, strict=True))
    heights = np.asarray(ground(*np.broadcast_arrays(x[:, None], z)), np.float64)
    if np.ptp(heights) > 0:
        lines = axes.contour(x, z, heights.T, levels=8, colors="#8888", linewidths=0.5, zorder=0)
        axes.clabel(lines, fmt="%.2g m", fontsize=5)


def over_time(traces: Sequence[Trace], labels: Sequence[str], ground: Ground | None = None) -> Any:
    """Speed against what was commanded, and skate, over time on one course; the ground's height beneath."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(6.4, 4.2), layout="constrained")
    every = picture.subplots(2 if ground is None else 3, 1, sharex=True)
    speed, skate = every[:2]
    first = traces[0]
    speed.plot(
        thin(np.arange(len(first.asked_speed)) / first.fps, 1200),
        thin(first.asked_speed, 1200),
        color=INK,
        linewidth=0.9,
        linestyle=(0, (4, 2)),
        label="commanded",
    )
    for trace, label in zip(traces, labels, strict=True):
        time = np.arange(len(trace.speed)) / trace.fps
        speed.plot(thin(time, 1200), thin(trace.speed, 1200), linewidth=0.9, label=label, alpha=0.9)
        skate.plot(thin(time[1:], 1200), thin(trace.skate, 1200), linewidth=0.9, alpha=0.9)
        if ground is not None:
            heights = np.asarray(ground(trace.walked[:, 0], trace.walked[:, 1]))
            every[2].plot(thin(time, 1200), thin(heights, 1200), linewidth=0.9, alpha=0.9)
    picture.legend(*speed.get_legend_handles_labels(), loc="outside lower left", fontsize=7)
    speed.set_ylabel("speed, m/s")
    skate.set_ylabel("foot skate, cm/s")
    if ground is not None:
        every[2].set_ylabel("ground, m")
    every[-1].set_xlabel("time, s")
    for axes in (speed, skate):
        axes.set_ylim(bottom=0)
    for axes in every:
        axes.grid(True, axis="y")
    return picture


def stacked(rows: pd.DataFrame, columns: Sequence[str], names: Sequence[str], unit: str) -> Any:
    """A horizontal bar a system, its parts stacked."""
    lines = -(-len(names) // ABREAST)
    picture, (axes,) = figure(9, 0.7 + 0.2 * lines + 0.23 * len(rows))
    left = np.zeros(len(rows))
    at = np.arange(len(rows))[::-1]
    for column, name in zip(columns, names, strict=True):
        values = rows[column].fillna(0).to_numpy(float)
        axes.barh(at, values, left=left, height=0.7, label=name)
        left += values
    for y, total in zip(at, left, strict=True):
        axes.text(total, y, f" {total:.3g}", va="center", fontsize=7)
    axes.set_yticks(at, rows["system"])
    axes.set_xlabel(unit)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=-(-len(names) // lines), fontsize=7)
    return picture


def costs(summary: pd.DataFrame) -> Any:
    """Mean microseconds a frame by stage."""
    rows = summary[summary["frame_us"].notna()]
    stages = [s for s in STAGES if f"{s}_us" in rows and rows[f"{s}_us"].notna().any()]
    if not stages:
        return stacked(rows, ["frame_mean_us"], ["whole frame"], "microseconds a frame, mean")
    names = [s.replace("_", " ") for s in stages]
    return stacked(rows, [f"{s}_us" for s in stages], names, "microseconds a frame, mean, one character")


def memory(summary: pd.DataFrame) -> Any:
    """MB by part."""
    rows = summary[summary["memory_mb"].notna()]
    parts = [c for c in rows.columns if c.startswith("memory_") and c != "memory_mb"]
    return stacked(rows, parts, [p[7:-3].replace("_", " ") for p in parts], "MB (10^6 bytes)")


def skate_and_path(summary: pd.DataFrame) -> Any:
    """Foot skate beside distance from the path, a bar a system."""
    picture, axes = figure(9, 0.7 + 0.2 * len(summary), 2)
    at = np.arange(len(summary))[::-1]
    for one, column, label in zip(
        axes,
        ("skate_cm_s", "path_cm"),
        ("foot skate, cm/s", "distance from the commanded path, cm"),
        strict=True,
    ):
        one.barh(at, summary[column].fillna(0), height=0.7, color=COLOURS[0])
        for y, value in zip(at, summary[column], strict=True):
            if np.isfinite(value):
                one.text(value, y, f" {value:.3g}", va="center", fontsize=7)
        one.set_yticks(at, summary["system"])
        one.set_xlabel(label)
    return picture


def groups(traces: Sequence[Trace], *, poses: bool = True) -> list[list[Trace]]:
    """Traces of one course, those that did the very same together (see `Trace.same`)."""
    out: list[list[Trace]] = []
    for trace in traces:
        same = next((group for group in out if group[0].same(trace, poses=poses)), None)
        if same is None:
            out.append([trace])
        else:
            same.append(trace)
    return out


def label(group: Sequence[Trace]) -> str:
    """Names of systems that did the same, as a legend shows them."""
    names = [trace.system for trace in group]
    return (
        names[0]
        if len(names) == 1
        else f"{names[0]} = {', '.join(names[1:3])}"
        + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    )
