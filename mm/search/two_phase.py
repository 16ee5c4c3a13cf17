"""O3DE's search: a KD-tree's leaf chooses a thousand frames by pose, their full costs decide.

After O3DE's Motion Matching gem: the tree leaves out the trajectory and takes at most 48 columns; one
descent, no backtracking, hence approximate.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import brute
from .protocol import Exclusions, check, matrix, searchable, tag_bits
from .rows import costs_of
from .terms import of_schema

MOST_COLUMNS = 48


class TwoPhase:
    """Approximate, for any schema cost. `nbytes` counts the tree's nodes and its order of frames.

    Where the leaf holds no allowed frame, or fewer than k, all frames are looked at.
    Options: depth, most levels of the tree; leaf, least frames in a leaf.
    """

    name = "two-phase"
    OPTIONS = ("depth", "leaf")

    def __init__(
        self,
        features: ArrayLike,
        starts: ArrayLike,
        stops: ArrayLike,
        *,
        ignore_end: int = 20,
        tags: ArrayLike | None = None,
        schema: Any = None,
        depth: int = 15,
        leaf: int = 1000,
    ) -> None:
        self.features = matrix(features)
        self.frames = searchable(len(self.features), starts, stops, ignore_end)
        self.tags = tag_bits(tags, len(self.features))
        self.terms = of_schema(schema)
        pose = np.arange(self.features.shape[1]) if schema is None else np.asarray(schema.pose_columns())
        pose = pose if len(pose) else np.arange(self.features.shape[1])
        self.columns = pose[:MOST_COLUMNS]
        self.tree, order = grow(self.features[self.frames][:, self.columns], depth, leaf)
        self.order = self.frames[order]
        self.nbytes = sum(part.nbytes for part in self.tree) + self.order.nbytes + self.frames.nbytes

    def search(
        self,
        queries: ArrayLike,
        *,
        k: int = 1,
        bound: ArrayLike | None = None,
        exclude: Exclusions | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See `mm.search.Index`."""
        ask = check(self.features.shape[1], queries, k, bound, exclude)
        frames, costs = ask.empty()
        for n in range(len(ask)):
            limits = (ask.current[n], ask.radius, ask.required[n], ask.forbidden[n])
            leaf = self.order[descend(self.tree, ask.queries[n, self.columns])]
            totals = costs_of(self.features, leaf, ask.queries[n], self.terms)
            brute.rank(totals, leaf, self.tags, *limits, frames[n], costs[n])
            if frames[n, -1] < 0 and self._allowed(leaf, *limits) < k:
                frames[n], costs[n] = -1, ask.bound[n]
                totals = costs_of(self.features, self.frames, ask.queries[n], self.terms)
                brute.rank(totals, self.frames, self.tags, *limits, frames[n], costs[n])
        return frames, costs

    def _allowed(
        self, frames: NDArray[np.int32], current: int, radius: int, required: int, forbidden: int
    ) -> int:
        near = (np.abs(frames - current) < radius) & (current >= 0)
        bits = self.tags[frames]
        return int((~near & ((bits & required) == required) & ((bits & forbidden) == 0)).sum())


Tree = tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.int32]]


def grow(rows: NDArray[np.float32], depth: int, leaf: int) -> tuple[Tree, NDArray[np.int64]]:
    """A KD-tree over rows [T, C], split at the median of the column that varies most.

    Returns the tree and order [T], the rows leaf by leaf. The tree is a tuple of per-node arrays: split
    column, -1 in leaves; split value; for a leaf its span of order, for an inner node the second child's
    index (its first child is the next node).
    """
    columns: list[int] = []
    values: list[float] = []
    spans: list[tuple[int, int]] = []
    order = np.arange(len(rows))

    def split(low: int, high: int, level: int) -> None:
        node = len(columns)
        columns.append(-1)
        values.append(0.0)
        spans.append((low, high))
        if level >= depth or high - low < 2 * leaf:
            return
        part = rows[order[low:high]]
        column = int(part.var(axis=0).argmax())
        middle = (high - low) // 2
        ranked = np.argpartition(part[:, column], middle)
        order[low:high] = order[low:high][ranked]
        columns[node], values[node] = column, float(part[ranked[middle], column])
        split(low, low + middle, level + 1)
        spans[node] = (len(columns), 0)
        split(low + middle, high, level + 1)

    split(0, len(rows), 0)
    return (np.array(columns, np.int32), np.array(values, np.float32), np.array(spans, np.int32)), order


def descend(tree: Tree, point: NDArray[np.float32]) -> slice:
    """The span of order in the leaf where a point [C] falls."""
    columns, values, spans = tree
    node = 0
    while columns[node] >= 0:
        node = node + 1 if point[columns[node]] < values[node] else spans[node, 0]
    return slice(*spans[node])
