"""The page's figures (see `motion.figures` for their style)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from numpy.typing import NDArray

from features import normalise
from motion.figures import COLOURS, INK, figure

from . import features, reach
from .analyse import Analysis
from .costs import Run

Array = NDArray[np.floating]

ABREAST = 6  # histograms in a row
CELLS = 72  # of the map of components, along its width
SHOWN = (0.1, 99.9)  # percentiles that histograms reach to
REACHED = (0.02, 99.98)  # and maps
SIGNED = LinearSegmentedColormap.from_list(
    "signed", [(0, "#2e86abff"), (0.5, "#2e86ab00"), (0.5, "#d1495b00"), (1, "#d1495bff")]
)
MARKS = {"cost": ("v", COLOURS[1]), "pop": ("^", COLOURS[4]), "slip": ("s", COLOURS[3])}


def histograms(found: Analysis) -> Any:
    """A histogram a column, in its unit; below it a box: quartiles, median, 1 to 99 %."""
    from matplotlib.figure import Figure

    table = found.columns
    rows = -(-len(table) // ABREAST)
    picture = Figure(figsize=(12, 1.35 * rows))
    grid = np.atleast_1d(picture.subplots(rows, ABREAST)).ravel()
    picture.subplots_adjust(0.005, 0.2 / rows, 0.995, 1 - 0.12 / rows, wspace=0.05, hspace=0.45)
    for axes in grid:
        axes.set_axis_off()
    colours = _by_feature(found)
    for i, (axes, row) in enumerate(zip(grid, table.itertuples(), strict=False)):
        low, high = np.percentile(found.values[:, i], SHOWN)
        if not high > low:
            low, high = low - 1, high + 1
        counts, edges = np.histogram(found.values[:, i], 60, (low, high))
        axes.set_axis_on()
        axes.stairs(counts / counts.max(initial=1), edges, fill=True, color=colours[i], alpha=0.75)
        axes.plot([row.p1, row.p99], [-0.14, -0.14], color=INK, linewidth=0.7)
        axes.plot([row.p25, row.p75], [-0.14, -0.14], color=INK, linewidth=3.5, solid_capstyle="butt")
        axes.plot(row.p50, -0.14, "o", color=COLOURS[1], markersize=2.5)
        axes.set_title(f"{row.column}{', ' * bool(row.unit)}{row.unit}", fontsize=6.5, loc="left", pad=2)
        axes.set_ylim(-0.26, 1.05)
        axes.set_xlim(low, high)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.tick_params(labelsize=6, length=2)
        axes.locator_params(axis="x", nbins=4)
    return picture


def boxes(found: Analysis) -> Any:
    """A box a column as the search sees it, normalised and weighted: quartiles, 1 to 99 %, extremes."""
    table, database = found.columns, found.database
    picture, (axes,) = figure(12, 4.4)
    names = ("min", "p1", "p25", "p50", "p75", "p99", "max")
    values = np.stack([table[name].to_numpy(float) for name in names])
    low, whisker, q1, middle, q3, other, high = normalise.normalise(values, database.offset, database.scale)
    for i, colour in enumerate(_by_feature(found)):
        axes.plot([i, i], [whisker[i], other[i]], color=colour, linewidth=1)
        axes.bar(i, q3[i] - q1[i], bottom=q1[i], color=colour, width=0.6)
        axes.plot([i - 0.3, i + 0.3], [middle[i], middle[i]], color=INK, linewidth=1)
        axes.plot([i, i], [low[i], high[i]], ".", color=colour, markersize=3)
    axes.set_xticks(range(len(table)), table["column"], rotation=90, fontsize=6.5)
    axes.set_xlim(-0.6, len(table) - 0.4)
    axes.set_yscale("symlog", linthresh=4)
    axes.set_yticks(ticks := [-20, -10, -4, -2, 0, 2, 4, 10, 20], [str(tick) for tick in ticks])
    axes.set_ylabel("normalised and weighted (beyond 4: logarithmic)")
    axes.grid(True, axis="y")
    return picture


def _by_feature(found: Analysis) -> list[str]:
    """A colour a column, one for each feature."""
    order = list(dict.fromkeys(found.columns["feature"]))
    return [COLOURS[order.index(name) % len(COLOURS)] for name in found.columns["feature"]]


def correlations(found: Analysis) -> Any:
    """Correlation of every two columns; pairs that say the same have a frame."""
    values, names = found.correlations.to_numpy(), list(found.correlations.columns)
    size = 2.2 + 0.21 * len(names)
    picture, (axes,) = figure(size + 0.6, size)
    image = axes.imshow(values, cmap=SIGNED, vmin=-1, vmax=1, interpolation="none")
    picture.colorbar(image, ax=axes, pad=0.01, shrink=0.6)
    for i, j in np.argwhere(np.abs(values) > features.SAME):
        if i != j:
            axes.plot(j + _SQUARE[0], i + _SQUARE[1], color=INK, linewidth=1)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=6.5)
    axes.set_yticks(range(len(names)), names, fontsize=6.5)
    axes.spines[:].set_visible(False)
    return picture


_SQUARE = 0.5 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])


def variance(found: Analysis) -> Any:
    """Share of the variance by component, and of all until it."""
    share = 100 * found.components.share
    picture, (axes,) = figure(5, 3.2)
    at = np.arange(1, len(share) + 1)
    axes.bar(at, share, color=COLOURS[0], label="of each")
    axes.plot(
        at, np.cumsum(share), ".-", color=COLOURS[1], linewidth=1, markersize=4, label="of all until it"
    )
    axes.axhline(95, color=INK, linewidth=0.6, linestyle=(0, (4, 3)))
    axes.set_xlabel("component")
    axes.set_ylabel("% of the variance")
    axes.set_ylim(0, 102)
    axes.legend(fontsize=7, loc="center right")
    return picture


def component_map(found: Analysis) -> Any:
    """The first two components: how many frames lie where, how fast they go, of how many clips they are."""
    picture, grid = figure(12, 3.9, 3)
    x, y = found.components.scores.T
    edges = [_edges(x), _edges(y)]
    counts = np.histogram2d(x, y, edges)[0]
    speed = np.histogram2d(x, y, edges, weights=found.states[:, 0])[0] / np.maximum(counts, 1)
    extent = (edges[0][0], edges[0][-1], edges[1][0], edges[1][-1])
    share, frame = 100 * found.components.share[:2], 1 / found.database.fps
    density: Any = {"norm": LogNorm(frame, frame * max(counts.max(), 2)), "cmap": "viridis"}
    several: Any = {"norm": LogNorm(1, max(2, len(found.clips.names))), "cmap": "cividis"}
    for axes, values, title, colours in (
        (grid[0], counts * frame, "density, seconds", density),
        (grid[1], speed, "mean speed, m/s", {"cmap": "plasma", "vmin": 0}),
        (grid[2], _clips_in(found, x, y, edges), "clips that come here", several),
    ):
        shown = np.ma.masked_where(counts == 0, values).T
        place: Any = {"origin": "lower", "extent": extent, "aspect": "auto", "interpolation": "none"}
        picture.colorbar(axes.imshow(shown, **place, **colours), ax=axes, pad=0.01)
        axes.set_title(title, loc="left", fontsize=9)
        axes.set_xlabel(f"component 1, {share[0]:.0f} %")
    grid[0].set_ylabel(f"component 2, {share[1]:.0f} %")
    return picture


def _edges(values: Array) -> Array:
    low, high = np.percentile(values, REACHED)
    return np.linspace(low - 1e-6, high + 1e-6, CELLS + 1)


def _clips_in(found: Analysis, x: Array, y: Array, edges: list[Array]) -> NDArray[np.integer]:
    """How many clips have a frame in each cell; a mirrored copy is its original's clip."""
    cells = [np.clip(np.digitize(v, e) - 1, 0, CELLS - 1) for v, e in zip((x, y), edges, strict=True)]
    names = list(dict.fromkeys(found.database.names))
    clip = np.array([names.index(name) for name in found.database.names])[found.database.ranges()]
    met = np.unique(np.ravel_multi_index((*cells, clip), shape := (CELLS, CELLS, len(names))))
    return np.bincount(met // shape[-1], minlength=CELLS * CELLS).reshape(CELLS, CELLS)


def speeds(found: Analysis) -> Any:
    """Seconds of data by speed, by direction of travel and by turn."""
    table = found.speeds
    picture, (left, right) = figure(12, 2.6, 2)
    for axes, names, title in ((left, reach.DIRECTIONS, "travel"), (right, reach.TURNS, "turning")):
        width = 0.8 / len(names)
        for i, name in enumerate(names):
            at = np.arange(len(table)) + (i - (len(names) - 1) / 2) * width
            axes.bar(
                at, table[name].clip(lower=1e-3), width=width, color=COLOURS[i], label=name.replace("_", " ")
            )
        axes.set_yscale("log")
        axes.set_ylim(0.05, 2 * max(1, table[[*names]].max(axis=None)))
        axes.axhline(reach.ENOUGH, color=INK, linewidth=0.6, linestyle=(0, (4, 3)))
        bands = zip(table["from_mps"], table["to_mps"], strict=True)
        axes.set_xticks(range(len(table)), [f"{low:g}–{high:g}" for low, high in bands], fontsize=6.5)
        axes.set_xlabel("speed, m/s")
        axes.set_title(title, loc="left", fontsize=9)
        axes.legend(fontsize=7, ncols=len(names), loc="upper right")
    left.set_ylabel("seconds")
    return picture


def nearest(found: Analysis) -> Any:
    """How far the nearest frame elsewhere is, over the bound of what is the same; and where it is in time."""
    twice = found.twice
    picture, (left, right) = figure(12, 2.8, 2)
    times = twice.times[np.isfinite(twice.times) & (twice.times > 0)]
    low, high = np.percentile(times, REACHED) if len(times) else (0.5, 2.0)
    left.hist(
        times, np.geomspace(low, high, 80), color=COLOURS[0], weights=np.full(len(times), 1 / found.clips.fps)
    )
    left.axvline(1, color=COLOURS[1], linewidth=1)
    left.set_xscale("log")
    left.set_xlabel("cost of the nearest frame elsewhere, over that of what is the same")
    left.set_ylabel("seconds")
    minutes = np.arange(len(twice.near)) / found.clips.fps / 60
    for values, colour, label in (
        (twice.near, COLOURS[0], "there twice"),
        (twice.spare, COLOURS[1], "spare"),
    ):
        whole = np.add.reduceat(values, starts := np.arange(0, len(values), max(1, len(values) // 400)))
        share = 100 * whole / np.diff(np.append(starts, len(values)))
        right.fill_between(
            minutes[starts], share, step="post", color=colour, alpha=0.7, linewidth=0, label=label
        )
    right.set_xlabel("minutes of the database, mirrored copies aside")
    right.set_ylabel("% of the frames")
    right.set_ylim(0, 100)
    right.set_xlim(0, minutes[-1])
    right.legend(fontsize=7, loc="upper right")
    return picture


def run(found: Run) -> Any:
    """Cost by feature over time with searches' jumps and glitches, pops, and slips."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(12, 6.6), layout="constrained")
    cost, pop, slip = picture.subplots(3, 1, sharex=True, height_ratios=[3, 1, 1])
    time = np.arange(len(found)) / found.fps
    at = np.append(np.flatnonzero(found.searched), len(found) - 1)
    below = np.zeros(len(at))
    for i, name in enumerate(found.features):
        above = below + found.costs[at, i]
        cost.fill_between(
            time[at], below, above, step="post", color=COLOURS[i % len(COLOURS)], linewidth=0, label=name
        )
        below = above
    top = 1.15 * max(float(below.max(initial=0)), found.bounds.cost if _any(found, "cost") else 0.0, 1e-3)
    jumps = time[found.transition]
    cost.plot(
        jumps,
        np.full(len(jumps), -0.03 * top),
        "|",
        color=INK,
        markersize=5,
        markeredgewidth=0.5,
        label="jump",
    )
    pop.plot(time, found.pops, color=COLOURS[8], linewidth=0.5)
    for stance in found.stances.itertuples():
        ends = [stance.start / found.fps, stance.stop / found.fps]
        slip.plot(ends, [stance.slip_cm] * 2, color=COLOURS[8], linewidth=1)
    for kind, axes, bound in (
        ("cost", cost, found.bounds.cost),
        ("pop", pop, found.bounds.pop_cm),
        ("slip", slip, found.bounds.slip_cm),
    ):
        marker, colour = MARKS[kind]
        those = found.moments[found.moments["kind"] == kind]
        axes.plot(
            those["at_s"], those["value"], marker, color=colour, markersize=4, fillstyle="none", label=kind
        )
        axes.axhline(bound, color=colour, linewidth=0.7, linestyle=(0, (4, 3)))
        axes.grid(True, axis="y")
    cost.set_ylim(-0.06 * top, top)
    for axes in (pop, slip):
        axes.set_ylim(bottom=0)
    cost.set_ylabel("cost by feature")
    pop.set_ylabel("pop, cm")
    slip.set_ylabel("slip, cm")
    slip.set_xlabel("time, s")
    slip.set_xlim(0, max(time[-1], 1 / found.fps))
    picture.legend(*cost.get_legend_handles_labels(), loc="outside upper left", ncols=5, fontsize=7)
    return picture


def _any(found: Run, kind: str) -> bool:
    return bool((found.moments["kind"] == kind).any())
