"""Exclusions and bounds for libraries that know neither: ask for more neighbours, keep the allowed ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .brute import rank
from .protocol import Request
from .rows import costs_of

EUCLIDEAN = None  # in place of a schema's terms


def answer(
    nearest: Callable[[int], NDArray[np.integer]],
    features: NDArray[np.float32],
    subset: NDArray[np.int32],
    tags: NDArray[np.uint32],
    ask: Request,
    n: int,
    spare: int,
    frames: NDArray[np.int32],
    costs: NDArray[np.float32],
) -> bool:
    """Answer query n of a request into frames [k] and costs [k]; returns whether neighbours ran out.

    `nearest(count)` gives places in subset, nearest first, fewer than count when there are no more. First
    k + spare are asked for, then twice as many until k of them are allowed or the rest is beyond the bound.
    Neighbours ran out when fewer than asked for came back and fewer than k of them are allowed.
    """
    query, count = ask.queries[n], ask.k + spare
    limits = (ask.current[n], ask.radius, ask.required[n], ask.forbidden[n])
    while True:
        count = min(count, len(subset))
        found = subset[nearest(count)]
        true_costs = costs_of(features, found, query, EUCLIDEAN)
        frames[:], costs[:] = -1, ask.bound[n]
        rank(true_costs, found, tags, *limits, frames, costs)
        if frames[-1] >= 0 or len(found) == len(subset) or (len(found) and true_costs[-1] >= ask.bound[n]):
            return False
        if len(found) < count:
            return True
        count *= 2
