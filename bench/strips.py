"""Film strips: stick figures of a walk at even times, for a person to look at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion.skeleton import Skeleton
from motion.stick_figures import LEFT, MIDDLE, RIGHT, bone_colours, project

__all__ = ["LEFT", "MIDDLE", "RIGHT", "bone_colours", "draw", "figure", "project"]

Array = NDArray[np.floating]


def draw(
    axes: Any,
    skeleton: Skeleton,
    poses: Array,
    yaws: Array,
    *,
    times: Array | None = None,
    low: NDArray[np.bool_] | None = None,
    feet: list[int] | None = None,
    view: str = "side",
    cell: float | None = None,
    height: float | None = None,
) -> None:
    """Draw poses [S, J, 3] (world) side by side on matplotlib axes, each seen by its own facing, yaws [S].

    view "side" looks from the character's right, so that it faces to the right of the page; "front" faces
    it; "top" looks down, the facing upwards. Feet that rest (low [S, C] of joints feet) bear a dot. Strips
    that shall be compared are given the same cell, the metres from one pose to the next, and height, metres
    that are shown.
    """
    from matplotlib.collections import LineCollection

    colours = bone_colours(skeleton)
    flat = np.stack([project(pose, yaw, view) for pose, yaw in zip(poses, yaws, strict=True)])
    if cell is None:
        cell = 1.15 * float(np.percentile(np.ptp(flat[:, 1:], axis=1)[:, 0], 90)) + 0.1
    bones = [(j, p) for j, p in enumerate(skeleton.parents) if p > 0]
    flat += np.stack([np.arange(len(flat)) * cell, np.zeros(len(flat))], axis=-1)[:, None]
    lines = [(pose[j], pose[p]) for pose in flat for j, p in bones]
    shades = [colours[j] for j, _ in bones] * len(flat)
    axes.add_collection(LineCollection(lines, colors=shades, linewidths=1.3))
    for s, pose in enumerate(flat):
        head = skeleton.roles.get("head")
        if head is not None:
            axes.plot(*pose[head], "o", color=MIDDLE, markersize=3.5)
        if low is not None and feet is not None and view != "top":
            for c, joint in enumerate(feet):
                if low[s, c]:
                    axes.plot(pose[joint, 0], 0, "o", color=colours[joint], markersize=3)
        if times is not None:
            axes.text(s * cell, -0.06 * cell - 0.08, f"{times[s]:.1f} s", ha="center", va="top", fontsize=7)
    if view != "top":
        axes.axhline(0, color=MIDDLE, linewidth=0.6, zorder=0)
    axes.set_aspect("equal")
    axes.set_xlim(-0.7 * cell, (len(flat) - 0.3) * cell)
    top, bottom = float(flat[..., 1].max()), float(flat[..., 1].min())
    bottom, top = min(bottom, 0) - 0.25, top + 0.1
    if height is not None:
        bottom, top = (-height / 2, height / 2) if view == "top" else (-0.08 * height, 0.92 * height)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()


def figure(trace: Any, *, views: tuple[str, ...] = ("side", "front"), feet: list[int] | None = None) -> Any:
    """A matplotlib figure with one strip a view of a `mm.quality.Trace`."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(11, 1.5 * len(views)))
    picture.subplots_adjust(0, 0, 1, 1, hspace=0)
    for axes, view in zip(np.atleast_1d(picture.subplots(len(views), 1)), views, strict=True):
        draw(
            axes,
            trace.skeleton,
            trace.poses,
            trace.yaws,
            times=trace.frames / trace.fps if view == views[-1] else None,
            low=trace.low,
            feet=feet,
            view=view,
        )
    return picture
