"""A schema's cost as a sum of terms over columns, for kernels and for lower bounds.

Every residual is made of norms of linear functions of the difference: "squared" is |d|^2 and "absolute" |d|
of a feature's columns, "path" the |d| of each sample and of each step between samples. So with the right
linear functions a cost is a sum of norms and one squared norm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema

from .rows import ABSOLUTE, PATH, SQUARED

_KINDS = {"squared": SQUARED, "absolute": ABSOLUTE, "path": PATH}


def of_schema(schema: Schema | None) -> NDArray[np.int32] | None:
    """Kind, first column, and one past the last column of each feature, int32 [features, 3].

    None for the squared Euclidean distance: kernels are then compiled without the other costs.
    """
    if schema is None or schema.euclidean:
        return None
    rows = [
        (_KINDS[f.residual], schema.slices[f.name].start, schema.slices[f.name].stop) for f in schema.features
    ]
    return np.array(rows, np.int32)


def norms(terms: NDArray[np.int32], width: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Linear functions of F columns that make a cost a sum of norms and one squared norm.

    Returns a matrix [F, C] and ends [blocks]: with p = d @ matrix, the cost of a difference d [F] is the sum
    of the norms of p[0 : ends[0]], p[ends[0] : ends[1]], ..., and |p[ends[-1] :]|^2.
    """
    columns: list[NDArray[np.float64]] = []
    ends: list[int] = []
    one = np.eye(width)

    def block(*vectors: NDArray[np.float64]) -> None:
        columns.extend(vectors)
        ends.append(len(columns))

    for kind, start, stop in terms:
        if kind == ABSOLUTE:
            block(*one[start:stop])
        elif kind == PATH:
            for c in range(start, stop, 2):
                block(one[c], one[c + 1])
                if c > start:
                    block(one[c] - one[c - 2], one[c + 1] - one[c - 1])
    for kind, start, stop in terms:
        if kind == SQUARED:
            columns.extend(one[start:stop])
    return np.stack(columns, axis=1), np.array(ends, np.int64)
