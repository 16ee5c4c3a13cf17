"""A balanced tree over rows: leaves of 32, 16 children a node, boxes around all, for vector instructions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .lanes import LANES, UNROLL

LEAF = 2 * LANES
SAMPLE = 64  # rows that choose where to cut
FAR = 6e4  # where the padding lies; half floats end at 65504


@dataclass(eq=False)
class Tree:
    """Rows in other axes, as half floats, column by column.

    Node n of a level has the children LANES n to LANES n + 15 of the next; the children of the last level are
    the leaves. C is the number of columns, a multiple of UNROLL.

    Attributes
    ----------
    mean : float32 [F].
    axes : float32 [F, C rounded up to 16], zeros in what is added; coordinates are (row - mean) @ axes.
    boxes : float16 [nodes, C, 2, 16], lower and upper corners of each node's children, the root first, then
        level by level.
    rows : float16 [leaves, C, 32].
    errors : float32 [leaves, 2], largest distance of a row from its half floats: the sum over blocks of
        columns, and that of the columns behind the last block.
    places : int32 [leaves, 32], which of the given rows each is, -1 for padding.
    """

    mean: NDArray[np.float32]
    axes: NDArray[np.float32]
    boxes: NDArray[np.float16]
    rows: NDArray[np.float16]
    errors: NDArray[np.float32]
    places: NDArray[np.int32]


def grow(rows: NDArray[np.float32], axes: NDArray[np.float64], ends: NDArray[np.int64]) -> Tree:
    """A tree over rows [T, F] in axes [F, C], whose columns fall into blocks that end at ends [blocks].

    See `terms.norms`; without blocks the axes are an orthonormal basis.
    """
    count, columns = len(rows), -(-axes.shape[1] // UNROLL) * UNROLL
    mean = rows.sum(axis=0, dtype=np.float64) / max(1, count)
    mean = mean.astype(np.float32)
    axes = np.pad(axes, ((0, 0), (0, -axes.shape[1] % LANES)))
    points = (rows - mean.astype(np.float64)) @ axes[:, :columns]
    order = balance(points.astype(np.float32))

    leaves = max(1, -(-count // LEAF))
    places = np.full(leaves * LEAF, -1, np.int32)
    places[:count] = order
    padded = np.full((leaves * LEAF, columns), FAR)
    padded[:count] = points[order]
    stored = np.clip(padded, -FAR, FAR).astype(np.float16)
    squares = np.pad((padded - stored) ** 2, ((0, 0), (0, 1)))  # there may be nothing behind the last block
    squares = np.add.reduceat(squares, np.append(0, ends), axis=1)
    errors = np.stack([np.sqrt(squares[:, :-1]).sum(axis=1), np.sqrt(squares[:, -1])], axis=1)
    errors = errors.reshape(leaves, LEAF, 2).max(axis=1)

    # The padding of the last leaf must not widen its box.
    padded[count:] = padded[count - 1] if count else FAR
    corners = padded.reshape(leaves, LEAF, columns)
    levels = [stack(round_out(corners.min(axis=1), -1), round_out(corners.max(axis=1), +1))]
    while len(levels[0]) > 1:
        top = levels[0]
        levels.insert(0, stack(top[:, :, 0].min(axis=2), top[:, :, 1].max(axis=2)))
    return Tree(
        mean,
        np.ascontiguousarray(axes, np.float32),
        np.concatenate(levels),
        np.ascontiguousarray(stored.reshape(leaves, LEAF, columns).transpose(0, 2, 1)),
        np.nextafter(errors.astype(np.float32), np.float32(np.inf)),
        places.reshape(leaves, LEAF),
    )


def principal_axes(rows: NDArray[np.float32]) -> NDArray[np.float64]:
    """An orthonormal basis [F, F] whose first columns carry most variance of rows [T, F]."""
    if len(rows) == 0:
        return np.eye(rows.shape[1])
    centered = rows - rows.mean(axis=0, dtype=np.float64)
    return np.linalg.eigh(centered.T @ centered)[1][:, ::-1]


def balance(points: NDArray[np.float32]) -> NDArray[np.int64]:
    """An order of points [T, C] such that every 32 of them, every 32 * 16, and so on, lie close together.

    Halves again and again, across the column with the widest middle half (of a sample): the variance would
    heed the few rows far out, and give boxes that more queries must open. Cuts fall where nodes end.
    """
    columns = np.ascontiguousarray(points.T)
    order = np.arange(len(points))
    spans = [(0, len(points))]
    while spans:
        low, high = spans.pop()
        if high - low <= LEAF:
            continue
        node = LEAF
        while node * LANES < high - low:
            node *= LANES
        middle = low + -(-(high - low) // node) // 2 * node
        part = order[low:high]
        sample = columns[:, part[:: -(-len(part) // SAMPLE)]]
        quarter = sample.shape[1] // 4
        sample.partition((quarter, 3 * quarter), axis=1)
        widest = (sample[:, 3 * quarter] - sample[:, quarter]).argmax()
        order[low:high] = part[np.argpartition(columns[widest, part], middle - low)]
        spans += [(low, middle), (middle, high)]
    return order


def stack(lower: NDArray, upper: NDArray) -> NDArray[np.float16]:
    """Corners [n, C] of boxes as nodes [ceil(n / 16), C, 2, 16]; those missing are empty and far from all."""
    count, columns = lower.shape
    corners = np.empty((-(-count // LANES) * LANES, columns, 2), np.float16)
    corners[..., 0], corners[..., 1] = FAR, -FAR
    corners[:count, :, 0], corners[:count, :, 1] = lower, upper
    return np.ascontiguousarray(corners.reshape(-1, LANES, columns, 2).transpose(0, 2, 3, 1))


def round_out(values: NDArray[np.float64], direction: int) -> NDArray[np.float16]:
    """Half floats at values or beyond them in a direction, -1 or +1."""
    with np.errstate(over="ignore"):
        half = values.astype(np.float16)
    inside = (values - half) * direction > 0
    return np.where(inside, np.nextafter(half, np.float16(direction * np.inf)), half)
