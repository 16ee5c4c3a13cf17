"""SciPy's KD-tree."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import overfetch
from .protocol import Exclusions, check, matrix, searchable, tag_bits

_NODE_BYTES = 72  # of SciPy's ckdtreenode


class KdTree:
    """Exact. `nbytes` counts SciPy's float64 copy of the rows, its permutation of them and its nodes.

    Options: leaf, rows in a leaf.
    """

    name = "kdtree"
    OPTIONS = ("leaf",)

    def __init__(
        self,
        features: ArrayLike,
        starts: ArrayLike,
        stops: ArrayLike,
        *,
        ignore_end: int = 20,
        tags: ArrayLike | None = None,
        schema: Any = None,
        leaf: int = 32,
    ) -> None:
        from scipy.spatial import cKDTree

        self.features = matrix(features)
        self.frames = searchable(len(self.features), starts, stops, ignore_end)
        self.tags = tag_bits(tags, len(self.features))
        self.tree = cKDTree(self.features[self.frames], leafsize=leaf)
        arrays = (self.tree.data, self.tree.indices, self.frames)
        self.nbytes = sum(array.nbytes for array in arrays) + self.tree.size * _NODE_BYTES

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
            # A little beyond the bound: the tree computes in double precision, the costs in single.
            reach = float(ask.bound[n]) ** 0.5 * 1.0001 + 1e-6
            overfetch.answer(
                partial(self._nearest, ask.queries[n], reach),
                self.features, self.frames, self.tags, ask, n, 0, frames[n], costs[n],
            )  # fmt: skip
        return frames, costs

    def _nearest(self, query: NDArray[np.float32], reach: float, count: int) -> NDArray[np.integer]:
        if count == 0:
            return np.zeros(0, np.int64)
        _, places = self.tree.query(query, k=count, distance_upper_bound=reach)
        places = np.atleast_1d(places)
        return places[places < len(self.frames)]
