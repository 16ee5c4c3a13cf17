"""How the search indexes do on the searches that a driven controller really makes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import courses, search
from mm.controller import build_index
from mm.course import Course
from mm.database import Database
from mm.driving import at_data_speeds
from mm.queries import SETTINGS, Queries, record
from motion import console
from motion.errors import UserError

from . import timing

COURSE, CHARACTERS = "random", 8
BUDGET = 10.0  # seconds of an index's passes after which no further one starts
WARM = 20  # queries before each pass
BUILDS, SHORT = 3, 0.5  # times that an index is built while that took no more seconds in all

# What of approximate indexes trades time for recall, and the values tried besides their own.
SWEPT: dict[str, tuple[str, tuple[int, ...]]] = {
    "two-phase": ("leaf", (100, 300, 3000, 10_000, 30_000)),
    "faiss-ivf": ("probes", (1, 2, 4, 8, 16, 64)),
    "faiss-hnsw": ("effort", (4, 8, 16, 32, 128, 256)),
    "faiss-pq": ("rerank", (1, 4, 16, 256, 1024)),
}


@dataclass(eq=False)
class Subject:
    """An index that is measured.

    Attributes
    ----------
    name : of its kind. options : those that it is searched with, where they are not its own.
    index : it. build_s : seconds that building it took.
    """

    name: str
    index: search.Index
    build_s: float
    options: dict[str, int] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return ", ".join([self.name, *(f"{name} {value}" for name, value in self.options.items())])


def table(
    database: Database,
    *,
    count: int = 1000,
    indexes: Sequence[str] | None = None,
    k: int = 1,
    repeats: int = 3,
    sweep: bool = False,
    course: Course | None = None,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> list[dict[str, Any]]:
    """A row an index: recall, cost_regret, median_us, p99_us, ratio_to_aabb, build_s, bytes.

    The queries are recorded ones, over a course as it is (a random user's at the data's speeds when None).
    Recall is the share of queries whose k costs equal those of brute force (relative 1e-5, so that ties
    count), cost regret the mean of cost / best cost - 1 (REFERENCE 6); where no frame beats playing on, its
    cost is what playing on costs. Each query is searched alone, with the bound and the exclusions that the
    controller gave, by one pinned thread; the indexes take turns, and of each query the least of repeats
    passes counts (fewer for an index whose passes last 10 s together). ratio_to_aabb is aabb's median over
    the index's; build_s is one pinned thread's, too; bytes are those beyond the features.

    With sweep there is a row more for each way in which an approximate index trades recall for time
    (`SWEPT`), which the columns option and value tell (None: the index as it comes).
    """
    known = search.names()
    for name in indexes or ():
        if name not in known:
            raise UserError(f"no search index {name!r}", remedy=f"choose from {', '.join(known)}")
    k = min(k, len(database))
    course = course or at_data_speeds(courses.load(COURSE), database)
    queries = record(database, count, characters=CHARACTERS, course=course)
    shown: list[Subject] = []
    for name in progress(indexes or known, label="build", unit="indexes"):
        try:
            shown += _subjects(database, name, sweep=sweep)
        except UserError:
            if indexes:
                raise
    timed = {subject.title: subject.index for subject in shown}
    if "aabb" not in timed:
        with contextlib.suppress(UserError):  # it cannot search every schema's cost
            timed["aabb"] = build_index(database, "aabb", SETTINGS)
    truth = _search(build_index(database, "brute", SETTINGS), queries, k)
    seconds = _seconds(timed, queries, k, repeats, progress)
    micro = {title: 1e6 * spent for title, spent in seconds.items()}
    # Infinite where a clip ended and nothing may follow: equal for all, no regret.
    known_best = np.isfinite(truth) & (truth > 0)
    rows = []
    for subject in shown:
        found = _search(subject.index, queries, k)
        same = np.isclose(found, truth, rtol=1e-5, atol=0) | (found == truth)
        median = float(np.median(micro[subject.title]))
        option, value = next(iter(subject.options.items()), (None, None))
        row: dict[str, Any] = {"index": subject.name}
        if sweep:
            row["option"], row["value"] = option, value
        rows.append(
            row
            | {
                "recall": float(same.all(axis=1).mean()),
                "cost_regret": float((found[known_best] / truth[known_best] - 1).mean()),
                "median_us": median,
                "p99_us": float(np.percentile(micro[subject.title], 99)),
                "ratio_to_aabb": float(np.median(micro["aabb"])) / median if "aabb" in micro else None,
                "build_s": subject.build_s,
                "bytes": int(subject.index.nbytes),
            }
        )
    return rows


def _subjects(database: Database, name: str, *, sweep: bool) -> list[Subject]:
    """An index as it comes, and with sweep in all ways to search it."""
    own = _built(database, name)
    option, values = SWEPT[name] if sweep and name in SWEPT else ("", ())
    others = []
    for value in values:
        searching: Any = getattr(own.index, "searching", None)
        other = (
            _built(database, name, **{option: value})
            if searching is None
            else Subject(name, searching(**{option: value}), own.build_s)
        )
        other.options = {option: value}
        others.append(other)
    return [own, *others]


def _built(database: Database, name: str, **options: Any) -> Subject:
    """An index and the seconds that building it took, the least of a few where they are short; imports and
    compilation left out."""
    few = np.ascontiguousarray(database.features[:64])
    search.build(name, few, [0], [len(few)], ignore_end=0, schema=database.schema).search(few[:1])
    spent: list[float] = []
    with timing.single_thread():
        while not spent or (len(spent) < BUILDS and sum(spent) < SHORT):
            start = time.perf_counter()
            index = build_index(database, name, SETTINGS, **options)
            spent.append(time.perf_counter() - start)
    return Subject(name, index, min(spent))


def _search(index: search.Index, queries: Queries, k: int) -> NDArray[np.float64]:
    """Costs [M, k] of all queries at once."""
    found = index.search(queries.features, k=k, bound=queries.bound, exclude=queries.exclusions())
    return found[1].astype(np.float64)


def _seconds(
    indexes: Mapping[str, search.Index],
    queries: Queries,
    k: int,
    repeats: int,
    progress: Callable[..., Iterator[Any]],
) -> dict[str, NDArray[np.float64]]:
    """Seconds [M] of each query alone, the least of several passes after one short one to warm up."""
    each = (queries.take(slice(i, i + 1)) for i in range(len(queries)))
    alone = [(one.features, one.bound, one.exclusions()) for one in each]
    least = {name: np.full(len(alone), np.inf) for name in indexes}
    spent = dict.fromkeys(indexes, 0.0)
    passes = [(turn, name) for turn in range(repeats) for name in indexes]
    for turn, name in progress(passes, label="search", unit="passes"):
        if turn and spent[name] > BUDGET:
            continue
        index = indexes[name]
        with timing.single_thread():
            for features, bound, exclude in alone[:WARM]:
                index.search(features, k=k, bound=bound, exclude=exclude)
            for i, (features, bound, exclude) in enumerate(alone):
                start = time.perf_counter()
                index.search(features, k=k, bound=bound, exclude=exclude)
                took = time.perf_counter() - start
                spent[name] += took
                least[name][i] = min(least[name][i], took)
    return least
