"""The obvious index: look at every row. The truth that the others are tested against."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .protocol import Exclusions, check, matrix, searchable, tag_bits
from .rows import admitted, insert, row_cost, terms_cost
from .terms import of_schema


class Brute:
    """Exact, for any schema cost. `nbytes` counts the list of searchable frames."""

    name = "brute"
    OPTIONS = ()

    def __init__(
        self,
        features: ArrayLike,
        starts: ArrayLike,
        stops: ArrayLike,
        *,
        ignore_end: int = 20,
        tags: ArrayLike | None = None,
        schema: Any = None,
    ) -> None:
        self.features = matrix(features)
        self.frames = searchable(len(self.features), starts, stops, ignore_end)
        self.tags = tag_bits(tags, len(self.features))
        self.terms = of_schema(schema)
        self.nbytes = self.frames.nbytes

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
            scan(
                self.features,
                self.frames,
                self.tags,
                ask.queries[n],
                self.terms,
                *limits,
                frames[n],
                costs[n],
            )
        return frames, costs


@numba.njit(cache=True, nogil=True)
def scan(features, subset, tags, query, terms, current, radius, required, forbidden, frames, costs):
    """Update the k best frames [k] and costs [k] of one query [F] with the frames in subset."""
    for frame in subset:
        cost = (
            row_cost(query, features[frame]) if terms is None else terms_cost(query, features[frame], terms)
        )
        if cost < costs[-1] and admitted(frame, current, radius, tags[frame], required, forbidden):
            insert(frames, costs, frame, cost)


@numba.njit(cache=True, nogil=True)
def rank(totals, subset, tags, current, radius, required, forbidden, frames, costs):
    """Like `scan`, with the cost of each frame in subset given."""
    for i in range(len(subset)):
        frame = subset[i]
        if totals[i] < costs[-1] and admitted(frame, current, radius, tags[frame], required, forbidden):
            insert(frames, costs, frame, totals[i])
