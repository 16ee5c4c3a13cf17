"""The question of scale, measured: search indexes and systems by minutes of data, and how they grow."""

from __future__ import annotations

import gc
import hashlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench import queries, timing
from bench.comparison import compare, memory_mb
from bench.crowd import cost
from bench.driven import standard
from bench.entry import called
from bench.kept import Kept, code
from bench.systems import without_legs
from mm import courses, search
from mm.course import Course
from mm.database import Database
from mm.nearness import to_nearest
from mm.queries import record, residuals
from motion import console

from . import room
from .fits import power
from .lengths import Lengths, Taken

if TYPE_CHECKING:
    from lmm.models import AnyModel

MINUTES = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0)
COURSES = ("circle", "star", "start-stop", "random")
SOURCES = ("queries", "scale/measure", "scale/lengths")  # what measures besides `bench.kept.MODULES`

# What is fitted: table, column, title, unit.
QUANTITIES = (
    ("indexes", "median_us", "search", "µs"),
    ("indexes", "build_s", "index built", "s"),
    ("indexes", "memory_mb", "features and index", "MB"),
    ("systems", "memory_mb", "memory in all", "MB"),
    ("systems", "prepare_s", "data made", "s"),
    ("systems", "frame_mean_us", "frame", "µs"),
    ("systems", "unseen_cm", "unseen", "cm"),
    ("systems", "found_cm", "found", "cm"),
    ("systems", "path_cm", "way", "cm"),
    ("systems", "heading_deg", "facing", "degrees"),
)
WALKED = ("frame_us", "frame_mean_us", "frame_p99_us", "search_us", "path_cm", "heading_deg", "skate_cm_s")


@dataclass(frozen=True)
class Plan:
    """What is measured of each length.

    Attributes
    ----------
    indexes : by name. queries, repeats : see `bench.queries.table`.
    courses : what systems are driven over, seconds : of each, at most.
    """

    indexes: tuple[str, ...] = tuple(search.names())
    queries: int = 500
    repeats: int = 3
    courses: tuple[str, ...] = COURSES
    seconds: float = 20.0


QUICK = Plan(  # without what takes a minute to learn its codes
    indexes=tuple(name for name in search.names() if name != "faiss-pq"),
    queries=200,
    repeats=2,
    courses=("circle", "start-stop"),
    seconds=8.0,
)
QUICK_MINUTES = (1.0, 2.0, 5.0)


@dataclass(eq=False)
class Scale:
    """What was measured.

    Attributes
    ----------
    indexes : a row a length and search index: minutes, frames, and the columns of `bench.queries.table`;
        memory_mb is that of the features and the index, 10^6 bytes.
    systems : a row a length, of motion matching by exact search; see `of_length`.
    models : a row a system of a model, whose memory is that at any length; errors at its own minutes alone.
    fits : a row an index or system and quantity: exponent, its standard error, and ci95, half the width of
        its 95 % interval (`bench.scale.fits`).
    data : what the lengths are of. plan : what was measured. notes : what a reader must know.
    """

    indexes: pd.DataFrame
    systems: pd.DataFrame
    models: pd.DataFrame
    fits: pd.DataFrame
    data: dict[str, Any]
    plan: Plan
    notes: list[str]
    machine: dict[str, str] = field(default_factory=timing.machine)


def measure(
    lengths: Lengths,
    minutes: Sequence[float],
    *,
    plan: Plan | None = None,
    models: Mapping[str, AnyModel] | None = None,
    work: Path | None = None,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> Scale:
    """Measure lengths of data, in minutes, and fit how what they take grows.

    work : a folder that keeps what is found of each length, and has what was found before of the same data by
        the same plan, code and machine.

    A length that does not fit into memory is a UserError, before anything is measured.
    """
    plan = plan or Plan()
    room.check(lengths, minutes, plan.indexes)
    walk, run = lengths.speeds()
    loaded = [courses.load(name) for name in (queries.COURSE, *plan.courses)]
    asked, *played = (course.scaled(walk=walk, run=run) if walk > 0 else course for course in loaded)
    sources = [(Path(__file__).parents[1] / f"{name}.py").read_bytes() for name in SOURCES]
    shared = {
        "lengths": lengths.facts(),
        "plan": asdict(plan),
        "played": [course.to_dict() for course in played],
        "asked": asked.to_dict(),
        "code": [code(), hashlib.blake2b(b"\0".join(sources), digest_size=16).hexdigest()],
        "machine": timing.machine(),
    }
    kept = Kept(work, shared)
    found: dict[str, list[dict[str, Any]]] = {"indexes": [], "systems": []}
    unseen = lengths.unseen()
    for length in progress(sorted(minutes), label="scale", unit="lengths"):
        of = {"system": f"{length:g}-minutes", "minutes": length}
        before = kept.find(of)
        if before is None:
            rows, row = of_length(lengths, length, plan, played, asked, unseen, progress)
            # Pairs, since what is kept forgets the order of columns.
            pairs = {"indexes": [list(one.items()) for one in rows], "systems": [list(row.items())]}
            kept.keep(of, pairs, {})
        else:
            pairs = before[0]
        for name, of_table in found.items():
            of_table += [dict(one) for one in pairs[name]]
    tables = {name: pd.DataFrame(rows) for name, rows in found.items()}
    return Scale(
        tables["indexes"],
        tables["systems"],
        pd.DataFrame(of_models(lengths, models or {}, played, plan)),
        fitted(tables),
        {"name": lengths.name, "walk_mps": walk, "run_mps": run, "fps": lengths.fps} | lengths.facts(),
        plan,
        _notes(tables["systems"], unseen is not None),
    )


def of_length(
    lengths: Lengths,
    minutes: float,
    plan: Plan,
    played: Sequence[Course],
    asked: Course,
    unseen: Any,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Rows of the indexes of a length, and its system's row.

    The latter has memory_mb and its parts; the cost of a frame (one character, one pinned thread); prepare_s,
    the seconds that making the data took; and how far what is shown is from what was asked:

        unseen_cm: mean distance of the joints of poses that are not in the data from the nearest in it;
        found_cm: mean distance of the future places of what a search finds from those that it was asked for;
        path_cm, heading_deg: from the way and the facing of the courses.

    All lengths are asked for the same speeds, whether they have them or not.
    """
    start = time.perf_counter()
    database = lengths.of(minutes, progress)
    prepared = time.perf_counter() - start
    about = {"minutes": minutes, "frames": len(database)}
    features = database.features.nbytes
    rows: list[dict[str, Any]] = []
    for row in queries.table(
        database,
        count=plan.queries,
        indexes=[name for name in search.names(database.schema) if name in plan.indexes],
        repeats=plan.repeats,
        course=asked,
        progress=progress,
    ):
        rows.append(about | row | {"memory_mb": (features + row["bytes"]) / 1e6})
    gc.collect()
    name = called("mm-exact", without_legs(database) is None)
    summary = compare(database, courses=played, systems=[name], seconds=plan.seconds, scale=False).summary
    found = summary[summary["system"] == name].iloc[0]
    memory = {c: float(found[c]) for c in summary if c.startswith("memory_")}
    system = {"system": name, **about, **memory, "prepare_s": prepared}
    system |= {column: float(found[column]) for column in WALKED if column in found}
    system["unseen_cm"] = float("nan") if unseen is None else float(to_nearest(database, unseen).mean())
    system["found_cm"] = found_cm(database, asked, plan.queries)
    return rows, system


def found_cm(database: Database, asked: Course, count: int) -> float:
    """Mean distance of the future places of the nearest frames from those that searches ask for, cm."""
    layout = database.schema.trajectory()
    first = layout.position_columns[(layout.times > 0) & (layout.position_columns >= 0)]
    if not len(first):
        return float("nan")
    columns = np.stack([first, first + 1], axis=-1)
    made = record(database, count, characters=queries.CHARACTERS, course=asked)
    apart = residuals(database, made)[:, columns] * database.scale[columns]
    return float(100 * np.linalg.norm(apart, axis=-1).mean())


def of_models(
    lengths: Lengths, models: Mapping[str, AnyModel], played: Sequence[Course], plan: Plan
) -> list[dict[str, Any]]:
    """Rows of models: memory and cost, which no length changes, and errors on the data that they are of."""
    if not models:
        return []
    from bench.learned import learned

    if isinstance(lengths, Taken):
        database = lengths.database
        chosen = [entry for entry in standard(database, models) if entry.source]
        summary = compare(
            database, courses=played, systems=chosen, models=models, seconds=plan.seconds, scale=False
        ).summary
        summary = summary[summary["system"].isin([entry.name for entry in chosen])]
        wanted = [c for c in summary if c in WALKED or c.startswith("memory_")]
        own = len(database) / database.fps / 60 / lengths.copies
        return [
            {"system": row["system"], "minutes": own} | {name: float(row[name]) for name in wanted}
            for row in summary.to_dict("records")
        ]
    rows = []
    for entry in learned(models):
        if entry.alone and entry.locked and not entry.asked:
            system = entry.make(None, 1)
            frames = round(5.0 * system.fps)
            found = cost(system, played[0], frames, plan.repeats).microseconds()
            rows.append({"system": entry.name, "minutes": float("nan")} | memory_mb(system) | found)
    return rows


def fitted(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """A row an index or system and quantity: exponent, how sure it is, the fit at an hour, and points."""
    rows = []
    for table, column, title, unit in QUANTITIES:
        found = tables[table]
        if column not in found:
            continue
        for name, own in found.groupby("index" if table == "indexes" else "system", sort=False):
            fit = power(own["minutes"], own[column].astype(float))
            rows.append(
                {
                    "quantity": title,
                    "unit": unit,
                    "of": name,
                    "exponent": fit.exponent,
                    "standard_error": fit.error,
                    "ci95": fit.half,
                    "at_an_hour": float(fit.at(60.0)),
                    "points": fit.points,
                    "table": table,
                    "column": column,
                }
            )
    return pd.DataFrame(rows)


def _notes(systems: pd.DataFrame, unseen: bool) -> list[str]:
    notes = []
    if len(systems) < 3:
        notes.append("exponents of less than three lengths have no interval")
    if not unseen:
        notes.append("no clip could be spared to tell how far unseen poses are")
    return notes
