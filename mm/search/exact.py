"""Our exact index: brute's answers, by a tree of boxes in principal axes.

Rows are turned into principal axes, whose first columns carry most of the distance, and ordered into a tree
with 16 children a node and leaves of 32 rows. A search goes down nearest child first and leaves out every box
beyond the best cost known, which starts at the caller's bound. Boxes and rows stand column by column as half
floats, so that 16 are compared at once and little memory is touched. The few rows whose approximate distance
may beat the best are costed as `brute` does it. Rounding always errs towards looking once more than needed.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import tree
from .lanes import LANES, box_gaps, box_norms, lowest_bit, near_norms, near_rows, turn
from .protocol import Exclusions, Request, check, matrix, searchable, tag_bits
from .rows import admitted, insert, row_cost, terms_cost
from .terms import norms, of_schema

LEAF = tree.LEAF
MOST_LEVELS = 8  # 16^8 leaves
HALF_BYTES = 2


class Exact:
    """Exact. `nbytes` counts the tree: rows as half floats, boxes, frames and tags of the rows.

    Options: threads, among which a batch of queries is divided.
    """

    name = "exact"
    OPTIONS = ("threads",)

    def __init__(
        self,
        features: ArrayLike,
        starts: ArrayLike,
        stops: ArrayLike,
        *,
        ignore_end: int = 20,
        tags: ArrayLike | None = None,
        schema: Any = None,
        threads: int = 1,
    ) -> None:
        self.features = matrix(features)
        bits = tag_bits(tags, len(self.features))
        frames = searchable(len(self.features), starts, stops, ignore_end)
        rows = self.features[frames]
        terms = of_schema(schema)
        if terms is None:
            axes, ends = tree.principal_axes(rows), np.zeros(0, np.int64)
        else:
            axes, ends = norms(terms, rows.shape[1])
        grown = tree.grow(rows, axes, ends)
        places = np.where(grown.places < 0, len(frames), grown.places)
        leaf_frames = np.append(frames, np.int32(-1))[places]
        leaf_tags = np.append(bits[frames], np.uint32(0))[places]
        arrays = (
            grown.mean, grown.axes, grown.boxes.view(np.uint16), grown.rows.view(np.uint16), grown.errors,
            leaf_frames, leaf_tags,
        )  # fmt: skip
        self.nbytes = sum(array.nbytes for array in arrays)
        self.kernel = partial(descend, *arrays, None if terms is None else ends, terms, self.features)
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.threads = threads

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
        if self.pool is None or len(ask) < 2 * self.threads:
            self._descend(ask, frames, costs, 0, len(ask))
        else:
            cuts = np.linspace(0, len(ask), self.threads + 1).astype(int)
            jobs = [
                self.pool.submit(self._descend, ask, frames, costs, int(cuts[i]), int(cuts[i + 1]))
                for i in range(self.threads)
            ]
            for job in jobs:
                job.result()
        return frames, costs

    def _descend(self, ask: Request, frames: NDArray, costs: NDArray, start: int, stop: int) -> None:
        self.kernel(
            ask.queries, ask.current, ask.radius, ask.required, ask.forbidden, frames, costs, start, stop
        )


@numba.njit(cache=True, nogil=True, inline="always")
def any_tagged(tags, required, forbidden):
    """Whether any of the tags [n] has all that is required and none that is forbidden."""
    found = False
    for tag in tags:
        found |= (tag & required) == required and (tag & forbidden) == 0
    return found


@numba.njit(cache=True, nogil=True)
def descend(
    mean, axes, boxes, rows, errors, leaf_frames, leaf_tags, ends, terms, features,
    queries, currents, radius, required, forbidden, frames, costs, start, stop,
):  # fmt: skip
    """Update the k best frames [N, k] and costs [N, k] of the queries [N, F] from start to stop.

    The arrays up to errors are those of `tree.Tree`, half floats seen as integers; then each leaf's frames
    (-1 for padding) and tags, [leaves, 32]; ends and terms are those of `terms`, None for squared Euclidean.
    """
    width, columns, leaves = queries.shape[1], boxes.shape[1], len(rows)
    # Bounds of rounding: of costs, ours and brute's, relative; of a turned point, relative to the sum of its
    # columns (dense axes in one case; differences of two columns, each in three of them, in the other).
    rounding = np.float32(1 + (4 * columns + 16) * 2.0**-24)
    blur = (width + 4) * np.sqrt(columns) * 2.0**-24 if terms is None else 9 * 2.0**-24
    centered, point = np.empty(width, np.float32), np.empty(axes.shape[1], np.float32)
    gaps = np.empty((MOST_LEVELS, LANES), np.float32)
    # By level: its number of nodes, the first one's place in boxes, the node we are in, bits of its children
    # yet to visit.
    widths, first, node, left = np.empty((4, MOST_LEVELS), np.int64)
    levels = count_nodes(leaves, widths, first)
    box_bytes, leaf_bytes = columns * 2 * LANES * HALF_BYTES, columns * LEAF * HALF_BYTES

    for n in range(start, stop):
        query, current, need, avoid = queries[n], currents[n], required[n], forbidden[n]
        best_frames, best = frames[n], costs[n]
        length = np.float32(0)
        for c in range(width):
            centered[c] = query[c] - mean[c]
            length += abs(query[c]) + abs(mean[c])
        turn(centered.ctypes.data, width, axes.ctypes.data, axes.shape[1], point.ctypes.data)
        slack = np.float32(length * blur)
        limit, reach = widened(best[-1], rounding, slack, terms)

        level, child = -1, 0
        while True:
            # Enter a node of the next level.
            level += 1
            node[level] = child
            near = gaps.ctypes.data + level * LANES * 4
            box = boxes.ctypes.data + (first[level] + child) * box_bytes
            below = widths[level + 1] if level + 1 < levels else leaves
            present = (1 << min(LANES, below - child * LANES)) - 1
            at = point.ctypes.data
            if terms is None:
                left[level] = present & box_gaps(box, at, columns, limit, near)
            else:
                blocks = ends.ctypes.data, len(ends)
                left[level] = present & box_norms(box, at, *blocks, columns, limit, slack, near)

            # Take the nearest child that is left, here or further up.
            while level >= 0:
                nearest, gap, bits = -1, limit, left[level]
                while bits:
                    lane = lowest_bit(bits)
                    bits &= bits - 1
                    if gaps[level, lane] < gap:
                        nearest, gap = lane, gaps[level, lane]
                if nearest < 0:
                    level -= 1
                    continue
                left[level] &= ~(1 << nearest)
                child = node[level] * LANES + nearest
                if level + 1 < levels:
                    break
                if (need | avoid) != 0 and not any_tagged(leaf_tags[child], need, avoid):
                    continue
                leaf = rows.ctypes.data + child * leaf_bytes
                if terms is None:
                    around = reach + errors[child, 1]
                    bits = near_rows(leaf, at, columns, around * around)
                else:
                    blocks = ends.ctypes.data, len(ends)
                    slacks = slack + errors[child, 0], slack + errors[child, 1]
                    bits = near_norms(leaf, at, *blocks, columns, limit, *slacks)
                while bits:
                    row = lowest_bit(bits)
                    bits &= bits - 1
                    frame, tag = leaf_frames[child, row], leaf_tags[child, row]
                    if frame >= 0 and admitted(frame, current, radius, tag, need, avoid):
                        values = features[frame]
                        cost = row_cost(query, values) if terms is None else terms_cost(query, values, terms)
                        if cost < best[-1]:
                            insert(best_frames, best, frame, cost)
                            limit, reach = widened(best[-1], rounding, slack, terms)
            else:
                break


@numba.njit(cache=True, nogil=True)
def widened(cost, rounding, slack, terms):
    """The computed cost, and its root, at and beyond which what is bounded is surely no cheaper than a cost.

    For sums of norms without slack, which is taken away from what is compared.
    """
    if terms is None:
        reach = np.sqrt(cost) * rounding + slack
        return reach * reach, reach
    return cost * rounding, np.sqrt(cost)


@numba.njit(cache=True, nogil=True, inline="always")
def count_nodes(leaves, widths, first):
    """Fill in each level's number of nodes and where its first one stands, root first; returns the levels."""
    levels, nodes = 1, (leaves + LANES - 1) // LANES
    while nodes > 1:
        levels, nodes = levels + 1, (nodes + LANES - 1) // LANES
    below = leaves
    for level in range(levels - 1, -1, -1):
        below = (below + LANES - 1) // LANES
        widths[level] = below
    first[0] = 0
    for level in range(1, levels):
        first[level] = first[level - 1] + widths[level - 1]
    return levels
