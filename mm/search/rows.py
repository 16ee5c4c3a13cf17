"""Kernels that indexes share: one row's cost, one frame's admission, the sorted list of the best so far."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True, inline="always")
def row_cost(query: NDArray[np.float32], row: NDArray[np.float32]) -> np.float32:
    """Squared Euclidean distance, summed in column order so that every index returns the same bits."""
    total = np.float32(0.0)
    for c in range(query.shape[0]):
        difference = query[c] - row[c]
        total += difference * difference
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
def costs_of(features, frames, query):
    """Costs float32 [n] of the frames [n] to a query [F]."""
    costs = np.empty(len(frames), np.float32)
    for i in range(len(frames)):
        costs[i] = row_cost(query, features[frames[i]])
    return costs
