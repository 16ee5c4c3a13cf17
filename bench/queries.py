"""How the search indexes do on the searches that a driven controller really makes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import course as courses
from mm import search
from mm.controller import build_index
from mm.database import Database
from mm.driving import at_data_speeds
from mm.queries import SETTINGS, Queries, record
from motion.errors import UserError

from . import timing

COURSE, CHARACTERS = "random", 8
BUDGET = 10.0  # seconds of an index's passes after which no further one starts
WARM = 20  # queries before each pass


def table(
    database: Database,
    *,
    count: int = 1000,
    indexes: Sequence[str] | None = None,
    k: int = 1,
    repeats: int = 3,
) -> list[dict[str, Any]]:
    """A row an index: recall, cost_regret, median_us, p99_us, ratio_to_aabb, build_s, bytes.

    The queries are recorded ones. Recall is the share of queries whose k costs equal those of brute force
    (relative 1e-5, so that ties count), cost regret the mean of cost / best cost - 1 (REFERENCE 6); where no
    frame beats playing on, its cost is what playing on costs. Each query is searched alone, with the bound
    and the exclusions that the controller gave, by one pinned thread; the indexes take turns, and of each
    query the least of repeats passes counts (fewer for an index whose passes last 10 s together).
    ratio_to_aabb is aabb's median over the index's; build_s on all processors; bytes beyond the features.
    """
    known = search.names()
    for name in indexes or ():
        if name not in known:
            raise UserError(f"no search index {name!r}", remedy=f"choose from {', '.join(known)}")
    k = min(k, len(database))
    course = at_data_speeds(courses.load(COURSE), database)
    queries = record(database, count, characters=CHARACTERS, course=course)
    shown = {}
    for name in indexes or known:
        try:
            shown[name] = _built(database, name)
        except UserError:
            if indexes:
                raise
    timed = {name: index for name, (index, _) in shown.items()}
    if "aabb" not in timed:
        with contextlib.suppress(UserError):  # it cannot search every schema's cost
            timed["aabb"] = build_index(database, "aabb", SETTINGS)
    truth = _search(build_index(database, "brute", SETTINGS), queries, k)
    micro = {name: 1e6 * seconds for name, seconds in _seconds(timed, queries, k, repeats).items()}
    # Infinite where a clip ended and nothing may follow: equal for all, no regret.
    known_best = np.isfinite(truth) & (truth > 0)
    rows = []
    for name, (index, build_s) in shown.items():
        found = _search(index, queries, k)
        same = np.isclose(found, truth, rtol=1e-5, atol=0) | (found == truth)
        median = float(np.median(micro[name]))
        rows.append(
            {
                "index": name,
                "recall": float(same.all(axis=1).mean()),
                "cost_regret": float((found[known_best] / truth[known_best] - 1).mean()),
                "median_us": median,
                "p99_us": float(np.percentile(micro[name], 99)),
                "ratio_to_aabb": float(np.median(micro["aabb"])) / median if "aabb" in micro else None,
                "build_s": build_s,
                "bytes": int(index.nbytes),
            }
        )
    return rows


def _built(database: Database, name: str) -> tuple[search.Index, float]:
    """An index and the seconds that building it took, imports and compilation left out."""
    few = np.ascontiguousarray(database.features[:64])
    search.build(name, few, [0], [len(few)], ignore_end=0, schema=database.schema).search(few[:1])
    start = time.perf_counter()
    index = build_index(database, name, SETTINGS)
    return index, time.perf_counter() - start


def _search(index: search.Index, queries: Queries, k: int) -> NDArray[np.float64]:
    """Costs [M, k] of all queries at once."""
    found = index.search(queries.features, k=k, bound=queries.bound, exclude=queries.exclusions())
    return found[1].astype(np.float64)


def _seconds(
    indexes: Mapping[str, search.Index], queries: Queries, k: int, repeats: int
) -> dict[str, NDArray[np.float64]]:
    """Seconds [M] of each query alone, the least of several passes after one short one to warm up."""
    each = (queries.take(slice(i, i + 1)) for i in range(len(queries)))
    alone = [(one.features, one.bound, one.exclusions()) for one in each]
    least = {name: np.full(len(alone), np.inf) for name in indexes}
    spent = dict.fromkeys(indexes, 0.0)
    with timing.single_thread():
        for turn in range(repeats):
            for name, index in indexes.items():
                if turn and spent[name] > BUDGET:
                    continue
                for features, bound, exclude in alone[:WARM]:
                    index.search(features, k=k, bound=bound, exclude=exclude)
                for i, (features, bound, exclude) in enumerate(alone):
                    start = time.perf_counter()
                    index.search(features, k=k, bound=bound, exclude=exclude)
                    took = time.perf_counter() - start
                    spent[name] += took
                    least[name][i] = min(least[name][i], took)
    return least
