"""Search indexes side by side: how often they find the best frame, at what cost, in what time."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from mm import search
from mm.search import Exclusions, Index

from . import timing

SAME = 1e-5  # relative difference of costs that count as equal
WARM = 20  # untimed searches before the timed ones


def compare_indexes(
    features: ArrayLike,
    starts: ArrayLike,
    stops: ArrayLike,
    queries: ArrayLike,
    current: ArrayLike,
    *,
    bound: ArrayLike | None = None,
    radius: int = 20,
    ignore_end: int = 20,
    tags: ArrayLike | None = None,
    schema: Any = None,
    names: Sequence[str] | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    k: int = 1,
    repeats: int = 3,
) -> pd.DataFrame:
    """Build indexes and put the same queries to each, one at a time, on one warm, pinned thread.

    Parameters
    ----------
    features, starts, stops, ignore_end, tags, schema : see `mm.search.build`.
    queries : float32 [M, F], normalised. current : int32 [M], the frames they come from.
    bound : float32 [M], what playing on costs. radius : of what is skipped around the current frames.
    names : which indexes; all when None. options : keyword options by index name.
    k : answers per query.
    repeats : passes over the queries; the indexes take turns, and a query's time is its least.

    Returns
    -------
    One row an index, columns: index; recall, the share of queries whose costs equal brute force's (ties
    count); cost_regret, the mean of cost / best cost - 1; median_us and p99_us of a query, the call from
    Python included; build_s, on all processors; bytes beyond the features.
    """
    features = np.ascontiguousarray(features, np.float32)
    queries = np.ascontiguousarray(queries, np.float32)
    current = np.ascontiguousarray(current, np.int32)
    bounds = None if bound is None else np.ascontiguousarray(bound, np.float32)
    names = search.names() if names is None else list(names)
    shared = {"ignore_end": ignore_end, "tags": tags, "schema": schema}

    def make(name: str) -> tuple[Index, float]:
        more = dict((options or {}).get(name, {}))
        # Once on a few rows before the clock runs: imports, compilation.
        few = {**shared, "tags": None, "ignore_end": 0}
        search.build(name, features[:64], [0], [len(features[:64])], **few, **more).search(queries[:1])
        begin = time.perf_counter()
        return search.build(name, features, starts, stops, **shared, **more), time.perf_counter() - begin

    built = {name: make(name) for name in names}
    truth = search.build("brute", features, starts, stops, **shared).search(
        queries, k=k, bound=bounds, exclude=Exclusions(current=current, radius=radius)
    )[1]
    seconds = {name: np.full(len(queries), np.inf) for name in names}
    costs: dict[str, NDArray[np.float32]] = {}
    with timing.single_thread():
        for _ in range(max(1, repeats)):
            for name, (index, _) in built.items():
                costs[name], taken = ask(index, queries, current, bounds, radius, k)
                np.minimum(seconds[name], taken, out=seconds[name])
    rows = []
    for name, (index, build_s) in built.items():
        recall, regret = quality(costs[name], truth)
        rows.append(
            {
                "index": name,
                "recall": recall,
                "cost_regret": regret,
                "median_us": float(1e6 * np.median(seconds[name])),
                "p99_us": float(1e6 * np.percentile(seconds[name], 99)),
                "build_s": build_s,
                "bytes": int(index.nbytes),
            }
        )
    return pd.DataFrame(rows)


def ask(
    index: Index,
    queries: NDArray[np.float32],
    current: NDArray[np.int32],
    bound: NDArray[np.float32] | None,
    radius: int,
    k: int,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Put queries to an index one by one; returns costs [M, k] and seconds [M]."""
    costs, seconds = np.empty((len(queries), k), np.float32), np.empty(len(queries))
    for n in [0] * WARM + list(range(len(queries))):
        query, limit = queries[n : n + 1], None if bound is None else bound[n : n + 1]
        exclude = Exclusions(current=current[n : n + 1], radius=radius)
        begin = time.perf_counter()
        _, found = index.search(query, k=k, bound=limit, exclude=exclude)
        taken = time.perf_counter() - begin
        costs[n], seconds[n] = found[0], taken
    return costs, seconds


def quality(costs: NDArray[np.float32], truth: NDArray[np.float32]) -> tuple[float, float]:
    """Recall and cost regret of costs [M, k] beside the true ones [M, k].

    A slot that neither fills counts as equal. The regret is that of the cheapest answer, over the queries for
    which both have one or a bound.
    """
    wide, best = costs.astype(np.float64), truth.astype(np.float64)
    same = np.isclose(wide, best, rtol=SAME, atol=0)
    wide, best = wide[:, 0], best[:, 0]
    both = np.isfinite(wide) & np.isfinite(best) & (best > 0)
    regret = float((wide[both] / best[both] - 1).mean()) if both.any() else 0.0
    return float(same.all(axis=1).mean()), regret
