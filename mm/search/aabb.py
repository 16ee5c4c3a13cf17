"""The published scheme: boxes around 16 and 64 consecutive frames, scanned in order with early exit.

As in the public reference of Learned Motion Matching; the baseline that `exact` is measured against.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .protocol import Exclusions, check, matrix, spans, tag_bits
from .rows import admitted, insert

SMALL, LARGE = 16, 64


class Aabb:
    """Exact. `nbytes` counts both levels of boxes."""

    name = "aabb"
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
        self.starts, self.ends = spans(len(self.features), starts, stops, ignore_end)
        self.tags = tag_bits(tags, len(self.features))
        self.small = boxes(self.features, SMALL)
        self.large = boxes(self.features, LARGE)
        self.nbytes = self.small.nbytes + self.large.nbytes

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
        scan(
            self.features, self.small, self.large, self.starts, self.ends, self.tags,
            ask.queries, ask.current, ask.radius, ask.required, ask.forbidden, frames, costs,
        )  # fmt: skip
        return frames, costs


def boxes(features: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Lower and upper corners of every size rows [ceil(T / size), 2, F]."""
    steps = np.arange(0, len(features), size)
    if len(steps) == 0:
        return np.zeros((0, 2, features.shape[1]), np.float32)
    return np.stack(
        [np.minimum.reduceat(features, steps, axis=0), np.maximum.reduceat(features, steps, axis=0)], axis=1
    )


@numba.njit(cache=True, nogil=True, inline="always")
def box_beyond(query, box, limit):
    """Whether all of a box [2, F] lies at limit or beyond; stops at the column that decides."""
    total = np.float32(0.0)
    for c in range(query.shape[0]):
        nearest = min(max(query[c], box[0, c]), box[1, c])
        difference = query[c] - nearest
        total += difference * difference
        if total >= limit:
            return True
    return False


@numba.njit(cache=True, nogil=True)
def scan(
    features, small, large, starts, ends, tags, queries, currents, radius, required, forbidden, frames, costs
):
    """Update the k best frames [N, k] and costs [N, k] of all queries [N, F]."""
    for n in range(len(queries)):
        query, current, best = queries[n], currents[n], costs[n, -1]
        for r in range(len(starts)):
            frame, end = starts[r], ends[r]
            while frame < end:
                if box_beyond(query, large[frame // LARGE], best):
                    frame = (frame // LARGE + 1) * LARGE
                    continue
                large_end = min((frame // LARGE + 1) * LARGE, end)
                while frame < large_end:
                    if box_beyond(query, small[frame // SMALL], best):
                        frame = (frame // SMALL + 1) * SMALL
                        continue
                    small_end = min((frame // SMALL + 1) * SMALL, large_end)
                    while frame < small_end:
                        row, total = features[frame], np.float32(0.0)
                        for c in range(query.shape[0]):
                            difference = query[c] - row[c]
                            total += difference * difference
                            if total >= best:
                                break
                        else:
                            if admitted(frame, current, radius, tags[frame], required[n], forbidden[n]):
                                insert(frames[n], costs[n], frame, total)
                                best = costs[n, -1]
                        frame += 1
