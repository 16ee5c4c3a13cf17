"""Memory against error, both logarithmic, and memory by part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench import colours, plots
from bench.learned import ENDINGS
from motion.figures import INK, figure
from motion.marks import mark

PANELS = (("training", "pose_cm", "front"), ("held-out", "pose_held_cm", "front_held"))


def against_error(systems: pd.DataFrame) -> Any:
    """What systems hold beside the error of their poses, a panel a part of the data.

    A line joins the Pareto front, a thin one the formats in which the weights of one network are held.
    Poses that are as they are in the data stand at the bottom. Hollow marks are errors after one step of a
    network of locomotion, in which no front is looked for.
    """
    panels = [panel for panel in PANELS if panel[2] in systems]
    picture, axes = figure(5.6 * len(panels), 5.2, len(panels))
    kinds, shades = list(dict.fromkeys(systems["kind"])), colours.of(systems["system"])
    errors = np.concatenate([systems[column] for _, column, _ in panels]).astype(float)
    labels: list[tuple[Any, NDArray, NDArray, list[str], NDArray, NDArray]] = []
    floor = np.nanmin(errors[errors > 0], initial=1.0) / 3
    for one, (part, column, front) in zip(axes, panels, strict=True):
        rows = systems[systems[column].notna()]
        memory, error = rows["memory_mb"].to_numpy(), np.maximum(rows[column].to_numpy(), floor)
        best = rows[front].to_numpy(bool)
        order = np.flatnonzero(best)[np.lexsort((error[best], memory[best]))]
        one.plot(memory[order], error[order], color=INK, linewidth=0.8, drawstyle="steps-post", zorder=1)
        for kind in kinds:
            for decoded in ("decoded", "one step"):
                who = rows[(rows["kind"] == kind) & (rows["error"] == decoded)]
                title = kind if decoded == "decoded" else f"{kind}, after one step"
                for row in who.to_dict("records"):
                    name, colour = row["system"], shades[row["system"]]
                    dot = one.scatter(
                        row["memory_mb"], max(row[column], floor), 22, marker=colours.mark(name),
                        edgecolors=colour, facecolors=colour if decoded == "decoded" else "none", zorder=2,
                        label=title,
                    )  # fmt: skip
                    mark(dot, name, say=f"{row['memory_mb']:.3g} MB\n{row[column]:.3g} cm, {part} clips")
        for curve in _formats(rows):
            held = curve["memory_mb"], np.maximum(curve[column], floor)
            one.plot(*held, color=shades[curve["system"].iloc[0]], linewidth=0.8, alpha=0.6, zorder=1)
        one.set_xlabel("MB (10^6 bytes) held in all, of one character")
        one.set_ylabel(f"joint error, {part} clips, cm")
        one.grid(True, which="major")
        if (rows[column] == 0).any():
            one.axhline(floor, color=INK, linewidth=0.5, linestyle=(0, (4, 2)))
            across = one.get_yaxis_transform()
            one.text(0.01, floor, "as in the data", transform=across, va="bottom", fontsize=6)
        one.margins(0.12, 0.1)
        plots.logarithmic(one, "xy")
        labels.append((one, memory, error, [_short(name) for name in rows["system"]], best, _named(rows)))
    handles = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    picture.legend(handles.values(), handles, loc="outside upper center", ncols=4, fontsize=7)
    picture.draw_without_rendering()  # so that it is known where points are
    for of_panel in labels:
        plots.name_points(*of_panel)
    return picture


def by_part(systems: pd.DataFrame) -> Any:
    """A bar a system, its parts stacked."""
    return plots.memory(systems)


def _short(name: str) -> str:
    name = name.removesuffix("-free").replace("mm-exact-", "").replace("mm-coded-", "coded ")
    return name.replace("features-", "").replace("quantised", "q").replace("keyframes", "key")


def _formats(rows: pd.DataFrame) -> list[pd.DataFrame]:
    """Of each network that runs in one way the formats of its weights, by memory."""
    if "way" not in rows:
        return []
    of_networks = rows[rows["way"].fillna("") != ""].sort_values("memory_mb")
    return [own for _, own in of_networks.groupby(["source", "way"], sort=False) if len(own) > 1]


def _named(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Which systems bear their names besides those on the front: one of each kind and way, or of each model
    where there are several of a kind."""
    names = rows["system"].str.removesuffix("-free")
    alone = "-D" if names.str.endswith("-D").sum() == 1 else "-PSD"
    plain = names.isin(["mm-exact", "mm-exact-float16"]) | names.str.endswith(alone)
    networks = (rows["error"] == "one step") & ~names.str.endswith(tuple(filter(None, ENDINGS.values())))
    twins = rows["system"].str.endswith("-free") & names.isin(rows["system"])  # at the place of who is named
    return ((plain | networks) & ~twins).to_numpy()
