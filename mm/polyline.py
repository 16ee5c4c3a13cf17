"""A way on the ground: straight pieces between points, by arc length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

Float = NDArray[np.float64]

SAME = 1e-6  # metres: arc lengths of many laps are only so exact


class Polyline:
    """Points [P, 2] (x, z, metres) joined by straight segments; a closed one ends where it begins.

    Arc lengths beyond the end of a closed one go round again; of an open one they stand for the end.

    Attributes
    ----------
    points : float64 [P, 2], the first repeated at the end when closed.
    arcs : float64 [P], arc length at every point.
    headings : float64 [P - 1], atan2(x, z) of every segment.
    """

    def __init__(self, points: ArrayLike, *, closed: bool = False) -> None:
        self.points = np.asarray(points, np.float64)
        self.closed = closed
        steps = np.diff(self.points, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        self.arcs = np.concatenate([[0.0], np.cumsum(lengths)])
        self.directions = steps / lengths[:, None]
        self.headings = np.arctan2(steps[:, 0], steps[:, 1])

    @property
    def length(self) -> float:
        return float(self.arcs[-1])

    def distance(self, positions: NDArray) -> Float:
        """Distance [N] of positions [N, 2] to the nearest point of the whole line."""
        best = np.full(len(positions), np.inf)
        for start, direction, length in zip(self.points, self.directions, np.diff(self.arcs), strict=False):
            away = positions - start
            along = np.clip(away @ direction, 0, length)
            best = np.minimum(best, np.linalg.norm(away - along[:, None] * direction, axis=-1))
        return best

    def at(self, arc: Float) -> tuple[Float, Float, NDArray[np.int64]]:
        """Point [N, 2], direction [N, 2] and segment [N] at arc lengths [N]; at a corner of what follows."""
        if self.closed:
            arc = arc % self.length
            arc = np.where(self.length - arc < SAME, 0.0, arc)
        arc = np.clip(arc, 0, self.length)
        segment = np.minimum(np.searchsorted(self.arcs, arc + SAME, side="right") - 1, len(self.arcs) - 2)
        direction = self.directions[segment]
        return self.points[segment] + direction * (arc - self.arcs[segment])[:, None], direction, segment


def spline(points: ArrayLike, *, closed: bool, spacing: float) -> tuple[Float, NDArray[np.int64]]:
    """Points [P, 2] at most spacing metres apart along a cubic spline through points [W, 2].

    Also the index [W] of each given point among them. The spline's parameter is the chord length.
    """
    points = np.asarray(points, np.float64)
    chords = np.hypot(*np.diff(points, axis=0).T)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    ends: Any = "periodic" if closed else "natural"
    curve = CubicSpline(knots, points, bc_type=ends)
    # An arc is longer than its chord, but not by half for anything that can be walked.
    counts = np.maximum(1, np.ceil(1.5 * chords / spacing)).astype(int)
    pieces = [np.linspace(knots[i], knots[i + 1], counts[i], endpoint=False) for i in range(len(counts))]
    where = np.concatenate([*pieces, knots[-1:]])
    return curve(where), np.concatenate([[0], np.cumsum(counts)])
