"""Memory against error, both logarithmic, and memory by part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench import plots
from bench.learned import ENDINGS
from motion.figures import COLOURS, INK, figure

PANELS = (("training", "pose_cm", "front"), ("held-out", "pose_held_cm", "front_held"))
MARKERS = ("s", "o", "D", "^", "v")
ROOM, LETTER, GAP = 0.03, 0.0095, 0.012  # of the axes: between two labels, of a letter, beside a point


def against_error(systems: pd.DataFrame) -> Any:
    """What systems hold beside the error of their poses, a panel a part of the data.

    A line joins the Pareto front. Poses that are as they are in the data stand at the bottom. Hollow marks
    are errors after one step of a network of locomotion, in which no front is looked for.
    """
    panels = [panel for panel in PANELS if panel[2] in systems]
    picture, axes = figure(5.6 * len(panels), 5.2, len(panels))
    kinds = list(dict.fromkeys(systems["kind"]))
    errors = np.concatenate([systems[column] for _, column, _ in panels]).astype(float)
    labels: list[tuple[Any, NDArray, NDArray, list[str], NDArray, NDArray]] = []
    floor = np.nanmin(errors[errors > 0], initial=1.0) / 3
    for one, (part, column, front) in zip(axes, panels, strict=True):
        rows = systems[systems[column].notna()]
        memory, error = rows["memory_mb"].to_numpy(), np.maximum(rows[column].to_numpy(), floor)
        best = rows[front].to_numpy(bool)
        order = np.flatnonzero(best)[np.lexsort((error[best], memory[best]))]
        one.plot(memory[order], error[order], color=INK, linewidth=0.8, drawstyle="steps-post", zorder=1)
        for kind, colour, marker in zip(kinds, COLOURS, MARKERS, strict=False):
            for decoded, face in (("decoded", colour), ("one step", "none")):
                who = ((rows["kind"] == kind) & (rows["error"] == decoded)).to_numpy()
                if who.any():
                    title = kind if decoded == "decoded" else f"{kind}, after one step"
                    one.scatter(
                        memory[who], error[who], 22, edgecolors=colour, facecolors=face, marker=marker,
                        label=title, zorder=2,
                    )  # fmt: skip
        one.set_xscale("log")
        one.set_yscale("log")
        for axis in (one.xaxis, one.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
        one.set_xlabel("MB (10^6 bytes) held in all, of one character")
        one.set_ylabel(f"joint error, {part} clips, cm")
        one.grid(True, which="major")
        if (rows[column] == 0).any():
            one.axhline(floor, color=INK, linewidth=0.5, linestyle=(0, (4, 2)))
            across = one.get_yaxis_transform()
            one.text(0.01, floor, "as in the data", transform=across, va="bottom", fontsize=6)
        one.margins(0.12, 0.1)
        labels.append((one, memory, error, [_short(name) for name in rows["system"]], best, _named(rows)))
    handles = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    picture.legend(handles.values(), handles, loc="outside upper center", ncols=4, fontsize=7)
    picture.draw_without_rendering()  # so that it is known where points are
    for of_panel in labels:
        _label(*of_panel)
    return picture


def by_part(systems: pd.DataFrame) -> Any:
    """A bar a system, its parts stacked."""
    return plots.memory(systems)


def _short(name: str) -> str:
    name = name.removesuffix("-free").replace("mm-exact-", "").replace("mm-coded-", "coded ")
    return name.replace("features-", "").replace("quantised", "q").replace("keyframes", "key")


def _named(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Which systems bear their names besides those on the front: one of each kind and way."""
    names = rows["system"].str.removesuffix("-free")
    plain = names.isin(["mm-exact", "mm-exact-float16"]) | names.str.endswith("-D")
    networks = (rows["error"] == "one step") & ~names.str.endswith(tuple(filter(None, ENDINGS.values())))
    return (plain | networks).to_numpy()


def _label(axes: Any, x: NDArray, y: NDArray, names: list[str], best: NDArray, named: NDArray) -> None:
    """Names of points: of those on the front to the lower left, where nothing else is, of others to the
    right; moved down where they would lie on each other."""
    places = axes.transAxes.inverted().transform(axes.transData.transform(np.column_stack([x, y])))
    taken: list[tuple[float, float, float]] = []
    for i in np.argsort(-places[:, 1]):
        if not (best[i] or named[i]):
            continue
        width, (px, at) = LETTER * len(names[i]), places[i]
        left = px - GAP - width if best[i] and px - GAP - width > 0 else px + GAP
        at -= ROOM / 2 * best[i]
        while any(abs(at - y_) < ROOM and left < end and start < left + width for start, end, y_ in taken):
            at -= ROOM / 4
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
