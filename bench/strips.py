"""Film strips: stick figures of a walk at even times, for a person to look at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground, flat
from motion.marks import mark
from motion.skeleton import Skeleton
from motion.stick_figures import LEFT, MIDDLE, RIGHT, bone_colours, project

__all__ = ["LEFT", "MIDDLE", "RIGHT", "bone_colours", "draw", "figure", "project"]

Array = NDArray[np.floating]

WIDTH, NARROWEST = 11.0, 1.0  # of a figure, inches; of a pose's cell, metres
# Of the line of the ground under a figure: its points, and how far down it is shown, metres.
POINTS, DEEPEST = 25, -0.4


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
    ground: Ground = flat,
) -> None:
    """Draw poses [S, J, 3] (world) side by side on matplotlib axes, each seen by its own facing, yaws [S].

    view "side" looks from the character's right, so that it faces to the right of the page; "front" faces
    it; "top" looks down, the facing upwards. Feet that rest (low [S, C] of joints feet) bear a dot. Each
    stands on the ground, of which a line shows what lies under its middle, across the page. Strips that
    shall be compared are given the same cell, the metres from one pose to the next, and height, metres
    that are shown.
    """
    from matplotlib.collections import LineCollection

    colours = bone_colours(skeleton)
    stand = _heights(ground, poses[:, 0])
    page = np.stack([project(pose, yaw, view) for pose, yaw in zip(poses, yaws, strict=True)])
    if cell is None:
        cell = 1.15 * float(np.percentile(np.ptp(page[:, 1:], axis=1)[:, 0], 90)) + 0.1
    page[..., 0] += cell * np.arange(len(page))[:, None]
    lowest = 0.0
    if view != "top":
        page[..., 1] -= stand[:, None]
        lines = np.stack([_under(ground, p[0], yaw, view, cell) for p, yaw in zip(poses, yaws, strict=True)])
        lines += np.stack([cell * np.arange(len(page)), -stand], axis=-1)[:, None]
        axes.add_collection(LineCollection(list(lines), colors=MIDDLE, linewidths=0.6, zorder=0))
        lowest = max(float(lines[..., 1].min()), DEEPEST)
    bones = [(j, p) for j, p in enumerate(skeleton.parents) if p > 0]
    bones.sort(key=lambda bone: colours[bone[0]])  # bones of one colour make one element of a page
    shades = [colours[j] for j, _ in bones for _ in page]
    axes.add_collection(
        LineCollection([(pose[j], pose[p]) for j, p in bones for pose in page], colors=shades, linewidths=1.3)
    )
    for s, pose in enumerate(page):
        head = skeleton.roles.get("head")
        if head is not None:
            axes.plot(*pose[head], "o", color=MIDDLE, markersize=3.5)
        if low is not None and feet is not None and view != "top":
            under = _heights(ground, poses[s]) - stand[s]
            for c, joint in enumerate(feet):
                if low[s, c]:
                    axes.plot(pose[joint, 0], under[joint], "o", color=colours[joint], markersize=3)
        if times is not None:
            below = lowest - 0.06 * cell - 0.08
            axes.text(s * cell, below, f"{times[s]:.1f} s", ha="center", va="top", fontsize=7)
    axes.set_aspect("equal")
    axes.set_xlim(-0.7 * cell, (len(page) - 0.3) * cell)
    top, bottom = float(page[..., 1].max()), float(page[..., 1].min())
    bottom, top = min(bottom, lowest) - 0.25, top + 0.1
    if height is not None:
        bottom, top = (-height / 2, height / 2) if view == "top" else (-0.08 * height, 0.92 * height)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()


def _heights(ground: Ground, points: Array) -> Array:
    """Heights [..] of the ground beneath points [.., 3]."""
    return np.asarray(ground(points[..., 0], points[..., 2]), np.float64)


def _under(ground: Ground, root: Array, yaw: float, view: str, width: float) -> Array:
    """The line [K, 2] of the ground under a root [3] that faces yaw, across the page for so many metres."""
    across = np.linspace(-width / 2, width / 2, POINTS)
    right = (np.sin(yaw), np.cos(yaw)) if view == "side" else (np.cos(yaw), -np.sin(yaw))
    heights = ground(root[0] + across * right[0], root[2] + across * right[1])
    return np.stack([across, np.asarray(heights, np.float64)], axis=-1)


def widest(traces: Sequence[Any]) -> float:
    """The cell for strips of several traces, so that their poses of one time stand below each other."""
    spans = [
        np.ptp(project(pose, yaw, "side")[1:, 0])
        for trace in traces
        for pose, yaw in zip(trace.poses, trace.yaws, strict=True)
    ]
    return max(1.15 * float(np.percentile(spans, 90)) + 0.1, NARROWEST)


def figure(
    trace: Any,
    *,
    views: tuple[str, ...] = ("side", "front"),
    feet: list[int] | None = None,
    cell: float | None = None,
    ground: Ground = flat,
) -> Any:
    """A matplotlib figure with one strip a view of a `mm.quality.Trace`; cell as `draw` takes it."""
    from matplotlib.figure import Figure

    cell = widest([trace]) if cell is None else cell
    picture = Figure()
    every = np.atleast_1d(picture.subplots(len(views), 1))
    for axes, view in zip(every, views, strict=True):
        draw(
            axes,
            trace.skeleton,
            trace.poses,
            trace.yaws,
            times=trace.frames / trace.fps if view == views[-1] else None,
            low=trace.low,
            feet=feet,
            view=view,
            cell=cell,
            ground=ground,
        )
        between = float(np.diff(trace.frames).mean()) / trace.fps if len(trace.frames) > 1 else 0.0
        mark(axes, cursor=trace.course, seconds=between / cell)
    heights = [float(np.ptp(axes.get_ylim())) for axes in every]
    picture.set_size_inches(WIDTH, WIDTH * sum(heights) / float(np.ptp(every[0].get_xlim())))
    every[0].get_gridspec().set_height_ratios(heights)
    picture.subplots_adjust(0, 0, 1, 1, hspace=0)
    return picture
