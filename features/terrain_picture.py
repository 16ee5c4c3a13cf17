"""A picture of a ground in perspective, with the feet and the bodies that went over it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import figures, files, stick_figures
from motion.skeleton import Skeleton

from .terrain import Ground

MARGIN, GRID = 0.5, 90  # metres around what is shown; lines of the ground's mesh along the longer side
BODIES = 8
CONTACT, SWING, WAY = "#d1495b", "#7a8288", "#0f0e0d"
_LIGHT = np.array([-0.5, 0.75, -0.45])  # from where it comes: x, y, z


def save(path: Path, *args: Any, **options: Any) -> None:
    """Write a PNG of `figure`; whole or not at all."""
    with figures.style("terrain"), files.atomic(path) as stream:
        stream.write(figures.png(figure(*args, **options)))


def figure(
    ground: Ground,
    feet: NDArray,
    contacts: NDArray,
    *,
    skeleton: Skeleton | None = None,
    positions: NDArray | None = None,
    way: NDArray | None = None,
    title: str = "",
    azimuth: float = 30.0,
) -> Any:
    """A matplotlib figure of a ground around feet [T, C, 3], in metres; red dots are contacts [T, C].

    positions [T, J, 3] of a skeleton's joints show some bodies, way [T, S, 2] lines on the ground (x, z).
    azimuth is where it is seen from, degrees.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    picture = Figure(figsize=(10, 7))
    axes = picture.add_subplot(projection="3d", computed_zorder=False)
    low, high = feet.reshape(-1, 3).min(axis=0) - MARGIN, feet.reshape(-1, 3).max(axis=0) + MARGIN
    heights = _mesh(axes, ground, low, high)
    down = np.asarray(contacts) != 0
    for c in range(feet.shape[1]):
        axes.plot(*_page(feet[:, c]), color=SWING, linewidth=0.7, zorder=3)
    axes.scatter(*_page(feet[down]), color=CONTACT, s=5, depthshade=False, zorder=4)
    for line in () if way is None else np.moveaxis(way, 1, 0):
        lifted = np.stack([line[:, 0], ground(line[:, 0], line[:, 1]) + 0.005, line[:, 1]], axis=-1)
        axes.plot(*_page(lifted), color=WAY, linewidth=0.8, linestyle=":", zorder=2)
    top = max(heights.max(), feet[..., 1].max())
    if skeleton is not None and positions is not None:
        _bodies(axes, skeleton, positions)
        top = max(top, positions[..., 1].max())
    bottom = min(heights.min(), feet[..., 1].min())
    axes.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]), zlim=(bottom, top))
    axes.set(xlabel="x, m", ylabel="z, m", zlabel="y, m", title=title)
    axes.set_box_aspect((high[0] - low[0], high[2] - low[2], top - bottom), zoom=1.15)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(5))
    axes.view_init(elev=25, azim=azimuth)
    axes.invert_xaxis()  # the page's axes x, z, y would show a mirror image
    picture.subplots_adjust(0, 0, 1, 0.96)
    return picture


def _mesh(axes: Any, ground: Ground, low: NDArray, high: NDArray) -> NDArray:
    """The ground between corners, shaded by its slope; returns its heights."""
    spacing = max(high[0] - low[0], high[2] - low[2]) / GRID
    x, z = np.meshgrid(
        np.arange(low[0], high[0] + spacing, spacing),
        np.arange(low[2], high[2] + spacing, spacing),
        indexing="ij",
    )
    y = np.asarray(ground(x, z), np.float64)
    normal = np.stack([-np.gradient(y, spacing, axis=0), np.ones_like(y), -np.gradient(y, spacing, axis=1)])
    light = np.tensordot(_LIGHT, normal / np.linalg.norm(normal, axis=0), axes=1)
    colour = np.clip(0.35 + 0.6 * light, 0, 1)[..., None] * np.array([0.86, 0.9, 0.8])
    axes.plot_surface(x, z, y, facecolors=colour, rstride=1, cstride=1, linewidth=0, shade=False, zorder=1)
    return y


def _bodies(axes: Any, skeleton: Skeleton, positions: NDArray) -> None:
    """Some bodies [T, J, 3] as sticks."""
    colours = stick_figures.bone_colours(skeleton)
    for pose in positions[np.linspace(0, len(positions) - 1, BODIES).round().astype(int)]:
        for joint, parent in enumerate(skeleton.parents):
            if parent >= 0 and "root" not in (skeleton.names[joint], skeleton.names[parent]):
                axes.plot(*_page(pose[[parent, joint]]), color=colours[joint], linewidth=1.2, zorder=5)


def _page(points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Points [.., 3] in the order of the axes drawn: x, z and, upwards, y."""
    return points[..., 0], points[..., 2], points[..., 1]
