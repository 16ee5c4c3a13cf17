"""The report's figures (see `motion.figures` for their style, `bench.colours` for their colours)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.colours import mark as mark_of
from bench.memory.pareto import front
from features.terrain import Ground
from mm.quality import Trace
from motion.figures import INK, figure, thin
from motion.marks import mark

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
WIDE = 10  # times the least number is the greatest where an axis is logarithmic
SMALL = 0.01  # of the largest memory: parts that no system has more of are not told apart
POINTS = 800  # of a line over time, at most
ROOM, LETTER, GAP = 0.03, 0.0115, 0.014  # of the axes: between two labels, of a letter, beside a point
LONGEST = 48  # letters of a name in a legend of two columns
FEW = 12  # points of a figure that all bear their names
# What is wanted of a system beside what a frame of it costs.
WORTH = (
    ("real_cm", "distance from the nearest real pose, cm"),
    ("mm_near_cm", "distance from what mm-exact shows, cm"),
    ("path_cm", "distance from the commanded path, cm"),
    ("skate_cm_s", "foot skate, cm/s"),
)


def paths(groups: Sequence[Sequence[Trace]], colours: Mapping[str, str], ground: Ground | None = None) -> Any:
    """Where groups of systems that did the same walked, over what was commanded; lines of equal height."""
    first = groups[0][0]
    picture, (axes,) = figure(4.6, 4.2)
    mark(axes, zoom="xy", cursor=first.course, still=True)
    asked = first.path if first.path is not None else first.asked
    what = "commanded path" if first.path is not None else "the command obeyed to the letter"
    (line,) = axes.plot(*thin(asked, 2000).T, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label=what)
    mark(line, what, always=True)
    for group in groups:
        way = thin(group[0].walked, POINTS)
        step = -(-len(group[0].walked) // POINTS) / group[0].fps
        _line(axes, group, colours, *way.T, step=step, linewidth=1.2)
    axes.plot(*first.walked[0], "o", color=INK, markersize=4)
    if ground is not None:
        _relief(axes, ground, np.concatenate([asked, *(group[0].walked for group in groups)]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # looked at from above with +Z up the page, +X is on the left
    axes.set_xlabel("x, m")
    axes.set_ylabel("z, m")
    axes.legend(loc="upper left", bbox_to_anchor=(0, -0.12), fontsize=6, ncols=1 + (len(groups) > 6))
    return picture


def _line(
    axes: Any,
    group: Sequence[Trace],
    colours: Mapping[str, str],
    x: NDArray,
    y: NDArray,
    *,
    linewidth: float = 0.9,
    **facts: Any,
) -> None:
    """The line of a group of systems, in the colour of its first."""
    colour = colours[group[0].system]
    (line,) = axes.plot(x, y, color=colour, linewidth=linewidth, alpha=0.9, label=label(group))
    mark(line, *(trace.system for trace in group), **facts)


def _relief(axes: Any, ground: Ground, ways: NDArray) -> None:
    """Lines of equal height, faint, around ways [P, 2]."""
    low, high = ways.min(axis=0), ways.max(axis=0)
    low, high = low - MARGIN * (high - low).max(), high + MARGIN * (high - low).max()
    x, z = (np.linspace(a, b, RELIEF_POINTS) for a, b in zip(low, high, strict=True))
    heights = np.asarray(ground(*np.broadcast_arrays(x[:, None], z)), np.float64)
    if np.ptp(heights) > 0:
        lines = axes.contour(x, z, heights.T, levels=8, colors="#8888", linewidths=0.5, zorder=0)
        axes.clabel(lines, fmt="%.2g m", fontsize=5)


def over_time(
    groups: Sequence[Sequence[Trace]], colours: Mapping[str, str], ground: Ground | None = None
) -> Any:
    """Speed against what was commanded, and skate, over time on one course; the ground's height beneath."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(6.4, 4.2), layout="constrained")
    every = picture.subplots(2 if ground is None else 3, 1, sharex=True)
    speed, skate = every[:2]
    first = groups[0][0]
    asked = np.arange(len(first.asked_speed)) / first.fps, first.asked_speed
    dashed = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 2))}
    (line,) = speed.plot(*(thin(values, POINTS) for values in asked), label="commanded", **dashed)
    mark(line, "commanded", always=True)
    for group in groups:
        trace = group[0]
        time = np.arange(len(trace.speed)) / trace.fps
        _line(speed, group, colours, thin(time, POINTS), thin(trace.speed, POINTS))
        _line(skate, group, colours, thin(time[1:], POINTS), thin(trace.skate, POINTS))
        if ground is not None:
            heights = np.asarray(ground(trace.walked[:, 0], trace.walked[:, 1]))
            _line(every[2], group, colours, thin(time, POINTS), thin(heights, POINTS))
    picture.legend(*speed.get_legend_handles_labels(), loc="outside lower left", fontsize=7, ncols=2)
    speed.set_ylabel("speed, m/s")
    skate.set_ylabel("foot skate, cm/s")
    if ground is not None:
        every[2].set_ylabel("ground, m")
    every[-1].set_xlabel("time, s")
    for axes in (speed, skate):
        axes.set_ylim(bottom=0)
    for axes in every:
        mark(axes, zoom="x", cursor=first.course)
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
        bars = axes.barh(at, values, left=left, height=0.7, label=name)
        for bar, system, value in zip(bars, rows["system"], values, strict=True):
            mark(bar, system, name, say=f"{name}: {value:.3g} {unit.partition(',')[0]}")
        left += values
    for y, total in zip(at, left, strict=True):
        axes.text(total, y, f" {total:.3g}", va="center", fontsize=7)
    _name(axes, at, rows["system"])
    axes.set_xlabel(unit)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=-(-len(names) // lines), fontsize=7)
    return picture


def _name(axes: Any, at: NDArray, systems: Sequence[str]) -> None:
    """Write systems beside their bars."""
    axes.set_yticks(at, systems)
    axes.set_ylim(-0.7, len(at) - 0.3)
    for text, system in zip(axes.get_yticklabels(), systems, strict=True):
        mark(text, system, entry=True)


def costs(summary: pd.DataFrame) -> Any:
    """Mean microseconds a frame by stage."""
    rows = summary[summary["frame_us"].notna()]
    stages = [s for s in STAGES if f"{s}_us" in rows and rows[f"{s}_us"].notna().any()]
    if not stages:
        return stacked(rows, ["frame_mean_us"], ["whole frame"], "microseconds a frame, mean")
    names = [s.replace("_", " ") for s in stages]
    return stacked(rows, [f"{s}_us" for s in stages], names, "microseconds a frame, mean, one character")


def memory(summary: pd.DataFrame) -> Any:
    """MB by part; parts that are next to nothing of all systems are put together."""
    rows = summary[summary["memory_mb"].notna()]
    parts = [c for c in rows.columns if c.startswith("memory_") and c != "memory_mb"]
    small = [p for p in parts if rows[p].max() < SMALL * rows["memory_mb"].max()]
    large = [p for p in parts if p not in small]
    names = [p.removeprefix("memory_").removesuffix("_mb").replace("_", " ") for p in large]
    if len(small) > 1:
        rows, large, names = rows.assign(small=rows[small].sum(axis=1)), [*large, "small"], [*names, "other"]
    else:
        large, names = parts, [p.removeprefix("memory_").removesuffix("_mb").replace("_", " ") for p in parts]
    return stacked(rows, large, names, "MB (10^6 bytes)")


def skate_and_path(summary: pd.DataFrame, colours: Mapping[str, str]) -> Any:
    """Foot skate beside distance from the path, a bar a system."""
    picture, axes = figure(9, 0.7 + 0.2 * len(summary), 2)
    at = np.arange(len(summary))[::-1]
    for one, column, what in zip(
        axes,
        ("skate_cm_s", "path_cm"),
        ("foot skate, cm/s", "distance from the path, cm"),
        strict=True,
    ):
        shades = [colours.get(system, INK) for system in summary["system"]]
        bars = one.barh(at, summary[column].fillna(0), height=0.7, color=shades)
        for bar, y, system, value in zip(bars, at, summary["system"], summary[column], strict=True):
            mark(bar, system, say=f"{what}: {value:.3g}")
            if np.isfinite(value):
                one.text(value, y, f" {value:.3g}", va="center", fontsize=7)
        one.set_xlabel(what)
    _name(axes[0], at, summary["system"])
    axes[1].set_yticks([])  # the same systems
    return picture


def worth(summary: pd.DataFrame, colours: Mapping[str, str]) -> Any:
    """What is wanted of systems beside what a frame costs, a panel each; None where nothing is to compare.

    A line joins those that no cheaper one beats.
    """
    known = [c for c, _ in WORTH if c in summary and len(summary[["frame_mean_us", c]].dropna()) > 1]
    if not known:
        return None
    columns, rows = min(len(known), 2), -(-len(known) // 2)
    picture, grid = figure(5 * columns, 3.6 * rows, columns, rows=rows)
    for axes in grid[len(known) :]:
        axes.set_axis_off()
    labels = []
    for axes, column in zip(grid, known, strict=False):
        what = dict(WORTH)[column]
        these = summary[["system", "frame_mean_us", column]].dropna()
        best = front(these[["frame_mean_us", column]])
        line = these[best].sort_values(["frame_mean_us", column])
        axes.plot(
            line["frame_mean_us"], line[column], color=INK, linewidth=0.7, drawstyle="steps-post", zorder=1
        )
        for system, cost, value in these.itertuples(index=False):
            dot = axes.scatter([cost], [value], 26, color=colours[system], marker=mark_of(system), zorder=2)
            mark(dot, system, say=f"{what}: {value:.3g}\na frame: {cost:.3g} µs")
        axes.set_xlabel("microseconds a frame, mean")
        axes.set_ylabel(what)
        axes.grid(True)
        axes.margins(0.15, 0.1)
        logarithmic(axes, "x")
        if these[column].max() > WIDE * these[column].min() > 0:
            logarithmic(axes, "y")
        labels.append(
            (axes, *these[["frame_mean_us", column]].to_numpy(float).T, list(these["system"]), best)
        )
    picture.draw_without_rendering()  # so that it is known where points are
    for axes, cost, value, names, best in labels:
        name_points(axes, cost, value, names, best, best | (len(names) <= FEW))
    return picture


def logarithmic(axes: Any, which: str) -> None:
    """Make axes that have all their points logarithmic in x, y or xy, with round numbers along them."""
    from matplotlib.ticker import LogLocator, NullLocator

    for letter in which:
        getattr(axes, f"set_{letter}scale")("log")
        axis = getattr(axes, f"{letter}axis")
        low, high = axis.get_view_interval()
        # All tens, and of few of them what lies between.
        between: tuple[float, ...] = (1,)
        for span, these in ((500, (1, 2, 5)), (12, (1, 2, 3, 5)), (3, (1, 1.5, 2, 3, 4, 5, 6, 8))):
            between = these if high < span * low else between
        axis.set_major_locator(LogLocator(subs=between, numticks=20))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())


def name_points(
    axes: Any, x: NDArray, y: NDArray, names: Sequence[str], best: NDArray, named: NDArray
) -> None:
    """Write the names of the best and of the named points of a figure that was laid out.

    Those of the best stand to the lower left, where nothing else is, others, and those that have no room
    there, above to the right, since many are as good as the one beside them; they are moved where they would
    lie on each other.
    """
    places = axes.transAxes.inverted().transform(axes.transData.transform(np.column_stack([x, y])))
    taken: list[tuple[float, float, float]] = []
    for i in np.argsort(-places[:, 1]):
        if not (best[i] or named[i]):
            continue
        width, (px, at) = LETTER * len(names[i]), places[i]
        below = best[i] and px - GAP - width > 0
        left = px - GAP - width if below else px
        at += ROOM * (-0.5 if below else 0.8)
        while any(abs(at - y_) < ROOM and left < end and start < left + width for start, end, y_ in taken):
            at += ROOM / (-4 if below else 4)
        taken.append((left, left + width, at))
        far = abs(at - places[i, 1]) > ROOM
        axes.annotate(
            names[i],
            places[i],
            (left + width if left < px else left, at),
            "axes fraction",
            "axes fraction",
            fontsize=5.5,
            ha="right" if left < px else "left",
            va="center",
            fontweight="bold" if best[i] else "normal",
            arrowprops={"arrowstyle": "-", "linewidth": 0.3, "color": INK} if far else None,
        )


def crowd(rows: pd.DataFrame, colours: Mapping[str, str]) -> Any:
    """Microseconds a character and frame by number of characters (`bench.crowd`), both logarithmic."""
    picture, (axes,) = figure(9, 3.6)
    for system, own in rows.groupby("system", sort=False):
        x, y, style = own["characters"], own["us"], f"{mark_of(system)}-"
        (line,) = axes.plot(x, y, style, color=colours[system], markersize=4, linewidth=1.2, label=system)
        mark(line, system)
    logarithmic(axes, "xy")
    axes.set_xticks(counts := sorted(rows["characters"].unique()), [f"{count:,}" for count in counts])
    axes.set_xlabel("characters")
    axes.set_ylabel("microseconds a character and frame")
    axes.grid(True)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
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
    first, *others = [trace.system for trace in group]
    whole = " = ".join([first, *others])
    if len(others) < 2 and len(whole) <= LONGEST:
        return whole
    return f"{first} and {len(others)} other{'s' * (len(others) > 1)} alike" if others else first
