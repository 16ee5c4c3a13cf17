"""Search in features of 8 bits as they are stored, for who counts bytes: nothing is decoded beforehand.

Frames stand in blocks of 32 of one range, each with the least and largest codes of its columns. A block that
cannot hold a cheaper frame is left out, of the others rows are decoded one by one.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.errors import UserError

from ..search.protocol import Exclusions, check, spans
from ..search.rows import admitted, insert
from ..stages import plain
from .compressed import Compressed

BLOCK = 32  # frames


class CodedRows:
    """Features [T, F] of codes, decoded where they are asked for."""

    def __init__(self, compressed: Compressed) -> None:
        if compressed.codec.features != "8bit":
            raise UserError(
                f"features of {compressed.codec.features} have no search of codes",
                remedy="compress with --features 8bit, or take another index",
            )
        self.codes, self.low, self.step = (plain(compressed.coded[n]) for n in ("codes", "low", "step"))
        self.nbytes = self.codes.nbytes + self.low.nbytes + self.step.nbytes

    def __getitem__(self, frames: NDArray[np.integer]) -> NDArray[np.float32]:
        return self.low + self.codes[frames] * self.step


class Coded:
    """The index; brute's answers on what is decoded. `nbytes` counts the blocks.

    A schema whose cost is not squared Euclidean is a UserError.
    """

    name = "coded"
    OPTIONS = ()

    def __init__(self, compressed: Compressed, *, ignore_end: int = 20) -> None:
        if not compressed.schema.euclidean:
            raise UserError(
                "search index 'coded' cannot search the cost of this schema, which is not squared Euclidean",
                remedy="take the index exact",
            )
        self.rows = CodedRows(compressed)
        self.tags = plain(compressed.tags)
        first, last = spans(len(compressed), compressed.starts, compressed.stops, ignore_end)
        edges = [(s, min(s + BLOCK, b)) for a, b in zip(first, last, strict=True) for s in range(a, b, BLOCK)]
        self.blocks = np.array(edges, np.int32).reshape(-1, 2)
        self.boxes = np.empty((len(self.blocks), 2, self.rows.codes.shape[1]), np.uint8)
        for box, (start, stop) in zip(self.boxes, self.blocks, strict=True):
            box[0], box[1] = self.rows.codes[start:stop].min(axis=0), self.rows.codes[start:stop].max(axis=0)
        self.nbytes = self.blocks.nbytes + self.boxes.nbytes

    def search(
        self,
        queries: ArrayLike,
        *,
        k: int = 1,
        bound: ArrayLike | None = None,
        exclude: Exclusions | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See `mm.search.Index`."""
        rows = self.rows
        ask = check(rows.codes.shape[1], queries, k, bound, exclude)
        frames, costs = ask.empty()
        scan(
            rows.codes, rows.low, rows.step, self.tags, self.blocks, self.boxes, ask.queries, ask.current,
            ask.radius, ask.required, ask.forbidden, frames, costs,
        )  # fmt: skip
        return frames, costs


@numba.njit(cache=True, nogil=True)
def scan(codes, low, step, tags, blocks, boxes, queries, currents, radius, required, forbidden,
         frames, costs):  # fmt: skip
    """Update the k best frames [N, k] and costs [N, k] of queries [N, F].

    Decoding, differences, squares and their sum, column by column, never fall where a code rises, rounding
    included: so what a box says is never more than what one of its rows costs.
    """
    columns = codes.shape[1]
    for n in range(len(queries)):
        query, best = queries[n], costs[n]
        for b in range(len(blocks)):
            total = np.float32(0)
            for c in range(columns):
                least = low[c] + np.float32(boxes[b, 0, c]) * step[c]
                largest = low[c] + np.float32(boxes[b, 1, c]) * step[c]
                gap = max(least - query[c], query[c] - largest, np.float32(0))
                total += gap * gap
            if total >= best[-1]:
                continue
            for frame in range(blocks[b, 0], blocks[b, 1]):
                total = np.float32(0)
                for c in range(columns):
                    difference = query[c] - (low[c] + np.float32(codes[frame, c]) * step[c])
                    total += difference * difference
                if total < best[-1] and admitted(
                    frame, currents[n], radius, tags[frame], required[n], forbidden[n]
                ):
                    insert(frames[n], best, frame, total)
