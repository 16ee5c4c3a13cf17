"""Kernels that indexes share: one row's cost, one frame's admission, the sorted list of the best so far."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

SQUARED, ABSOLUTE, PATH = range(3)  # kinds of terms


@numba.njit(cache=True, nogil=True, inline="always")
def row_cost(query: NDArray[np.float32], row: NDArray[np.float32]) -> np.float32:
    """Squared Euclidean distance, summed in column order so that every index returns the same bits."""
    total = np.float32(0.0)
    for c in range(query.shape[0]):
        difference = query[c] - row[c]
        total += difference * difference
    return total


@numba.njit(cache=True, nogil=True)
def terms_cost(query, row, terms):
    """Cost by the terms of a schema (see `terms.of_schema`), as `features.normalise.costs` defines it."""
    total = np.float32(0.0)
    for t in range(len(terms)):
        kind, start, stop = terms[t]
        square = np.float32(0.0)
        if kind == PATH:
            for c in range(start, stop, 2):
                x, z = query[c] - row[c], query[c + 1] - row[c + 1]
                total += np.sqrt(x * x + z * z)
                if c > start:
                    x, z = x - (query[c - 2] - row[c - 2]), z - (query[c - 1] - row[c - 1])
                    total += np.sqrt(x * x + z * z)
            continue
        for c in range(start, stop):
            difference = query[c] - row[c]
            square += difference * difference
        total += np.sqrt(square) if kind == ABSOLUTE else square
    return total


@numba.njit(cache=True, nogil=True, inline="always")
def admitted(frame, current, radius, tag, required, forbidden):
    """Whether a frame may be returned: away from the current one, all required tags, no forbidden one."""
    if current >= 0 and -radius < frame - current < radius:
        return False
    return (tag & required) == required and (tag & forbidden) == 0


@numba.njit(cache=True, nogil=True, inline="always")
def insert(frames, costs, frame, cost):
    """Put a frame that is cheaper than the last of the k best into its place, after those of equal cost."""
    slot = costs.shape[0] - 1
    while slot > 0 and costs[slot - 1] > cost:
        costs[slot] = costs[slot - 1]
        frames[slot] = frames[slot - 1]
        slot -= 1
    costs[slot] = cost
    frames[slot] = frame


@numba.njit(cache=True, nogil=True)
def sound(queries, bounds):
    """Whether queries [N, F] are finite and bounds [N] no NaN; for one query NumPy takes far longer."""
    for n in range(queries.shape[0]):
        if np.isnan(bounds[n]):
            return False
        for c in range(queries.shape[1]):
            if not np.isfinite(queries[n, c]):
                return False
    return True


@numba.njit(cache=True, nogil=True)
def costs_of(features, frames, query, terms):
    """Costs float32 [n] of the frames [n] to a query [F]; terms None: squared Euclidean."""
    costs = np.empty(len(frames), np.float32)
    for i in range(len(frames)):
        row = features[frames[i]]
        costs[i] = row_cost(query, row) if terms is None else terms_cost(query, row, terms)
    return costs
