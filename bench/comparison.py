"""The comparison: every system over every course and seed, one row each, and one row a system."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from features import terrain
from features.terrain import Heightmap
from mm import courses as courses_
from mm import quality, speeds
from mm.control import System
from mm.course import Course
from mm.database import Database
from mm.driving import COURSES, SECONDS
from mm.grounded import on_ground
from motion import console, files
from motion.errors import NotFinite, UserError

from . import crowd as crowds
from . import intervals, kept, published, timing, verdict
from .entry import Entry, as_stored
from .kept import Kept
from .memory import allocations
from .pose_error import PoseErrors, held_by_all
from .runs import OnCourse, Run, Variant, Yardstick
from .systems import choose, without_legs

if TYPE_CHECKING:
    from lmm.models import AnyModel

TIMED_SECONDS, REPEATS = 5.0, 3  # of each course, and how often the clock runs over them
WORST = ("pop_cm", "path_max_cm", "stall_s")  # a row of several runs has the largest, of others the mean
DATA = "(the clips)"
TABLES = ("summary", "courses", "runs", "differences", "crowd", "published")
_SURE = re.compile(
    r"memory_|pose_|(frame|search)_bytes|(?!frame_mean).*_us$"
)  # columns that have no interval
BUSY = 0.5  # of a frame's mean, by which repeats differ where it is said that the machine was busy
IN_CROWDS = ("PSD", "constant")  # ways of models that stand for all others where crowds are measured


@dataclass(eq=False)
class Comparison:
    """What was measured.

    Attributes
    ----------
    summary : a row a system, and a first one for the clips themselves; columns end in their unit. NAME_ci95
        is half the width of the 95 % interval of the column NAME (see `bench.intervals`), where it has one.
    courses : a row a system and course, means over the seeds.
    traces : what the plots need, one a row of `courses`, of its first seed; none where that one broke.
    played : the courses as they were played, scaled.
    feet : indices of the foot joints.
    notes : what a reader must know: what was scaled, what was left out.
    database : name, fingerprint, size and speeds of the data, and what of the run was asked for.
    models : what the learned systems are made of: fingerprint, size and training by name.
    machine : see `bench.timing.machine`.
    ground : what all walked on, None where that was level.
    runs : a row a system, course and seed; broke is 1 where poses were no numbers any more, 0 elsewhere.
        Costs are of the first seed alone.
    differences : of each quality metric, what each system has more than `verdict.reference`, and whether that
        is significant: see `bench.intervals.differences`.
    crowd : a row a system and number of characters: see `bench.crowd.of_entries`; empty where none was asked.
    published : memory, microseconds and training of the sources' systems, and ours beside them: see
        `bench.published.beside`.
    verdict : the answer in words: see `bench.verdict.Verdict`.
    code : hash of the source that measured.
    """

    summary: pd.DataFrame
    courses: pd.DataFrame
    traces: list[quality.Trace]
    played: list[Course]
    feet: list[int]
    notes: list[str]
    database: dict[str, Any]
    models: dict[str, dict[str, Any]] = field(default_factory=dict)
    machine: dict[str, str] = field(default_factory=timing.machine)
    ground: Heightmap | None = None
    runs: pd.DataFrame = field(default_factory=pd.DataFrame)
    differences: pd.DataFrame = field(default_factory=pd.DataFrame)
    crowd: pd.DataFrame = field(default_factory=pd.DataFrame)
    published: pd.DataFrame = field(default_factory=pd.DataFrame)
    verdict: verdict.Verdict = field(default_factory=verdict.Verdict)
    code: str = field(default_factory=kept.code)

    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables by name that have rows."""
        return {name: table for name in TABLES if len(table := getattr(self, name))}


def compare(
    database: Database,
    *,
    courses: Sequence[str | Course] = COURSES,
    systems: Sequence[str | Entry] | None = None,
    indexes: Sequence[str] | None = None,
    models: Mapping[str, AnyModel] | None = None,
    codecs: Sequence[str] = (),
    seconds: float = SECONDS,
    timed_seconds: float = TIMED_SECONDS,
    seed: int | None = None,
    repeats: int = 1,
    crowd: Sequence[int] = (),
    crowd_systems: Sequence[str] | None = None,
    crowd_seconds: float = TIMED_SECONDS,
    scale: bool = True,
    ground: Heightmap | None = None,
    name: str = "",
    work: str | os.PathLike[str] | None = None,
    training_hours: Mapping[str, float] | None = None,
    progress: bool = False,
) -> Comparison:
    """Drive every system over every course, and measure memory, time and motion.

    All do the same: a course lasts the same time for each system, starts at the same place, and is driven by
    the same rules; the same system on the same course does the same again.

    Parameters
    ----------
    courses : names, TOML files or courses; each lasts as long as it says, a way as long as it takes at its
        own speeds, but at most seconds.
    systems : names, families, patterns (see `bench.systems.choose`) or entries; all when None. Those that
        this database cannot have are left out with a note, unless none is left. Where legs are not whole
        those run that do not hold the feet; others, by name, are a UserError.
    indexes : search indexes of motion matching; all when None.
    models : trained ones by name (see `bench.learned`). codecs : those of databases (see `bench.small`).
        With either every system's poses are held against those of motion matching and of the data (see
        `bench.runs.Yardstick`), and what its Decompression makes of frames against these
        (`bench.pose_error`).
    timed_seconds : how much of each course the clock runs; the metrics are those of all of it.
    seed : of courses with a random user; their own when None.
    repeats : seeds of each course, as many as it has (see `bench.runs.Variant`).
    crowd : numbers of characters of whose crowds the cost is measured. crowd_systems : patterns of those of
        the systems that do; None is one of each kind: mm-exact, a way of each model, and every codec.
    scale : bring the courses' speeds to those of the data.
    ground : what all walk on; those that do not know of grounds are put on it (`mm.grounded`).
    name : of the database, for the report.
    work : a folder that keeps what is found, and has what was found before of the same database, models,
        settings, code and machine: a comparison that was interrupted goes on. The database has to have been
        saved.
    training_hours : of models by name, for the table beside what is published.

    An unknown course, system or index is a UserError that lists the choices.
    """
    if not (math.isfinite(seconds) and seconds > 0):
        raise UserError(f"{seconds} seconds", remedy="give a number above 0")
    if repeats < 1:
        raise UserError(f"{repeats} repeats", remedy="give a number of at least 1")
    if work is not None and not database.fingerprint:
        raise UserError("results of a database without a fingerprint cannot be kept", remedy="save it first")
    walk, run = speeds.of_database(database)
    played = _named_apart([_prepared(c, walk, run, seed, scale) for c in courses])
    why, notes = without_legs(database), []
    chosen = _chosen(systems, indexes, models, codecs, legs=why is None)
    in_crowds = _in_crowds(chosen, crowd_systems) if crowd else []
    inexact = any(entry.decoder is not as_stored for entry in chosen) or bool(models)
    if why is not None:
        if any(entry.locked for entry in chosen):
            raise why
        against = ", held against mm-exact-free" if inexact else ""
        notes.append(f"only systems that do not hold the feet run{against}: {why.what}")
    if scale and walk > 0:
        notes.append(
            f"course speeds are scaled to the data: the fastest walk to {walk:.2f} m/s, "
            f"the fastest run to {run:.2f} m/s"
        )
    if ground is not None:
        notes.append(f"all walk on {terrain.told(ground.facts())}")
    feet = quality.Feet.of(database)
    held_out = held_by_all(model.held_out for model in (models or {}).values())
    jobs = _Jobs(
        database,
        chosen,
        [variant for course in played for variant in Variant.of(course, repeats)],
        feet=feet,
        seconds=seconds,
        timed_seconds=timed_seconds,
        ground=ground,
        yardstick=Yardstick(database, ground, legs=why is None) if inexact else None,
        errors=PoseErrors(database, held_out) if inexact else None,
        kept=Kept(None if work is None else Path(work), _of(database, ground, inexact, sorted(held_out))),
    )
    shown = console.progress if progress else console.silent
    found = jobs.runs(shown)
    notes += jobs.notes
    runs = pd.DataFrame([run.row for run in found])
    traces = [run.trace for run in found if run.trace is not None]
    if ground is not None and traces:
        notes += _beyond(ground, traces)
    costs: dict[str, list[timing.Cost]] = {}
    for one in found:
        if one.cost is not None:
            costs.setdefault(one.row["system"], []).append(one.cost)
    summary = _summary(runs, costs, quality.of_data(database, feet, on_ground=ground is not None))
    summary = _beside_learned(summary, chosen)
    notes += _busy(summary)
    there = set(runs["system"])
    crowded = crowds.of_entries(
        database,
        [entry for entry in in_crowds if entry.name in there],
        counts=crowd or (1,),
        seconds=crowd_seconds,
        kept=jobs.kept,
        progress=shown,
    )
    crowd_table = pd.DataFrame(crowded)
    measured = verdict.Measured(summary[summary["system"] != DATA], runs, crowd_table)
    return Comparison(
        summary,
        _by_course(runs),
        traces,
        played,
        feet.joints,
        notes,
        {
            "name": name,
            "fingerprint": database.fingerprint,
            "frames": len(database),
            "fps": database.fps,
            "minutes": database.seconds / 60,
            "ranges": len(database.starts),
            "mirrored_ranges": int(database.mirrored.sum()),
            "joints": len(database.skeleton),
            "features": database.features.shape[1],
            "walk_mps": walk,
            "run_mps": run,
            "foot_rest_height_m": [float(h) for h in feet.rest],
            "foot_joints": [database.skeleton.names[j] for j in feet.joints],
            "seconds": seconds,
            "seed": seed,
            "repeats": repeats,
        },
        {name: _about(model) for name, model in (models or {}).items()},
        ground=ground,
        runs=runs,
        differences=measured.differences,
        crowd=crowd_table,
        published=pd.DataFrame(published.beside(database, summary, models or {}, training_hours)),
        verdict=verdict.of(measured),
    )


class _Jobs:
    """All that is to be run: systems on courses."""

    def __init__(
        self,
        database: Database,
        chosen: Sequence[Entry],
        variants: Sequence[Variant],
        *,
        feet: quality.Feet,
        seconds: float,
        timed_seconds: float,
        ground: Heightmap | None,
        yardstick: Yardstick | None,
        errors: PoseErrors | None,
        kept: Kept,
    ) -> None:
        self.kept, self.notes = kept, list[str]()
        self._database, self._ground, self._errors = database, ground, errors
        self._timed_seconds = timed_seconds
        courses = [OnCourse(variant, feet, seconds, yardstick, ground) for variant in variants]
        self._jobs = [(entry, on_course) for entry in chosen for on_course in courses]
        self._absent: dict[str, str] = {}
        self._allocated: dict[str, dict[str, float]] = {}
        self._chosen = chosen
        self._built: tuple[Any, ...] = ()
        self._system: System | None = None

    def runs(self, progress: Any) -> list[Run]:
        """The runs in the order of systems, courses and seeds, those that were kept among them."""
        of = [self._of(*job) for job in self._jobs]
        found = [self._before(entry, mark) for (entry, _), mark in zip(self._jobs, of, strict=True)]
        missing = [i for i, run in enumerate(found) if run is None]
        first = len(found) - len(missing)
        for i in progress(missing, label="compare", total=len(found), first=first, unit="runs"):
            found[i] = run = self._run(*self._jobs[i])
            if run is not None and self._jobs[i][0].made_of is not None:
                self.kept.keep(of[i], *run.packed())
        self.notes += [f"{name} is left out: {why}" for name, why in self._absent.items()]
        out = [run for run in found if run is not None and run.row["system"] not in self._absent]
        broke = dict.fromkeys(run.row["system"] for run in out if run.row["broke"])
        self.notes += [f"{name} broke: its poses were no numbers any more on a course" for name in broke]
        return out

    def _of(self, entry: Entry, on_course: OnCourse) -> dict[str, Any]:
        """All that a run follows from, but for what `_of` tells of all."""
        timed = self._timed_seconds if on_course.variant.seed == 0 else 0.0
        return {
            "system": entry.name,
            "made_of": entry.made_of,
            **on_course.variant.facts(),
            "seconds": on_course.seconds,
            "timed_seconds": timed,
        }

    def _before(self, entry: Entry, of: Mapping[str, Any]) -> Run | None:
        found = None if entry.made_of is None else self.kept.find(of)
        return None if found is None else Run.unpacked(*found)

    def _run(self, entry: Entry, on_course: OnCourse) -> Run | None:
        """None where the database cannot have the system, which is an error where it can have none."""
        if entry.name in self._absent:
            return None
        obstacles = on_course.course.obstacles()
        if self._built != (entry.name, obstacles.tobytes()):
            make = partial(entry.make, self._database, 1, obstacles=obstacles)
            try:
                self._system = on_ground(make, self._ground, sees=entry.sees_ground)
            except UserError as error:
                self._absent[entry.name] = str(error)
                if len(self._absent) == len(self._chosen):
                    raise
                return None
            self._system.name, self._built = entry.name, (entry.name, obstacles.tobytes())
        assert self._system is not None
        system = self._system
        timed = max(1, round(self._timed_seconds * system.fps)) if on_course.variant.seed == 0 else 0
        run = on_course.run(system, timed=timed, repeats=REPEATS)
        named = {
            name: run.row.pop(name) for name in ("system", "course", "seed", "seconds") if name in run.row
        }
        cost = run.cost.microseconds() if run.cost else {}
        poses = self._errors.of(entry.decoder) if self._errors else {}
        run.row = named | memory_mb(system) | cost | self._allocations(system) | poses | run.row
        return run

    def _allocations(self, system: System) -> dict[str, float]:
        """What a frame of a system allocates; of one that breaks as far as it got to be known."""
        if system.name not in self._allocated:
            self._allocated[system.name] = {}
            with contextlib.suppress(NotFinite):
                found = allocations.of_steps(system, allocations.wander(1))
                self._allocated[system.name] = {
                    "frame_bytes": found.frame_bytes,
                    "search_bytes": found.search_bytes,
                }
        return self._allocated[system.name]


def _of(database: Database, ground: Heightmap | None, inexact: bool, held_out: list[str]) -> dict[str, Any]:
    """What all results of a comparison follow from."""
    walked = None
    if ground is not None:
        placed = {"spacing": ground.spacing, "origin": ground.origin}
        walked = files.fingerprint({"heights": ground.heights}, placed)
    return {
        "database": database.fingerprint,
        "ground": walked,
        "held_against": inexact,
        "held_out": held_out,
        "code": kept.code(),
        "machine": timing.machine(),
    }


def _busy(summary: pd.DataFrame) -> list[str]:
    """A line if the machine did so much else that costs cannot be trusted."""
    if "frame_spread_us" not in summary:
        return []
    share = float((summary["frame_spread_us"] / summary["frame_mean_us"]).max())
    if not share > BUSY:
        return []
    return [
        "the machine did other things, too: times of the same frames differed from one repeat to the next by "
        f"up to {100 * share:.0f} % of their mean, so costs may be too high"
    ]


def _in_crowds(chosen: Sequence[Entry], patterns: Sequence[str] | None) -> list[Entry]:
    """Those of the systems whose crowds are measured."""
    import fnmatch

    if patterns is not None:
        out = [e for e in chosen if any(fnmatch.fnmatchcase(e.name, p) or e.family == p for p in patterns)]
        if not out:
            names = ", ".join(entry.name for entry in chosen)
            what = f"none of the systems is called {', '.join(patterns)}"
            raise UserError(what, remedy=f"choose from {names}")
        return out
    sources: dict[str, list[Entry]] = {}
    for entry in chosen:
        sources.setdefault(entry.source, []).append(entry)
    return [
        next((e for e in own if e.way in IN_CROWDS or e.name.startswith("mm-exact")), own[0])
        for own in sources.values()
    ]


def _beyond(ground: Heightmap, traces: Sequence[quality.Trace]) -> list[str]:
    """A line if any went over the edges of a ground."""
    ways = np.concatenate([trace.walked for trace in traces])
    share = 100 * float(1 - ground.covers(ways[:, 0], ways[:, 1]).mean())
    if share == 0:
        return []
    return [f"{share:.0f} % of the ways lie beyond the edges of the ground, which goes on as it is there"]


def _about(model: AnyModel) -> dict[str, Any]:
    return {
        "fingerprint": model.fingerprint,
        "database": model.database,
        "parameters": model.parameters,
        "weights": {name: network.weight_type for name, network in model.networks.items()},
        "held_out": list(model.held_out),
        "training": model.training,
    }


def _prepared(course: str | Course, walk: float, run: float, seed: int | None, scale: bool) -> Course:
    course = course if isinstance(course, Course) else courses_.load(course)
    if seed is not None and course.random is not None:
        course = replace(course, random=replace(course.random, seed=seed))
    return course.scaled(walk=walk, run=run) if scale and walk > 0 else course


def _named_apart(courses: Sequence[Course]) -> list[Course]:
    """Courses, of which none is called as one before it."""
    out: list[Course] = []
    for course in courses:
        name, count = course.name, 1
        while name in {other.name for other in out}:
            count += 1
            name = f"{course.name} {count}"
        out.append(course if count == 1 else replace(course, name=name))
    return out


def _chosen(
    systems: Sequence[str | Entry] | None,
    indexes: Sequence[str] | None,
    models: Mapping[str, AnyModel] | None,
    codecs: Sequence[str],
    *,
    legs: bool,
) -> list[Entry]:
    if systems is None or all(isinstance(s, str) for s in systems):
        return choose(systems, indexes=indexes, models=models, codecs=codecs, legs=legs)  # type: ignore[arg-type]
    if not all(isinstance(s, Entry) for s in systems):
        raise TypeError("give systems by name or as entries, not both")
    return list(systems)  # type: ignore[arg-type]


def memory_mb(system: System) -> dict[str, float]:
    """Memory by part, MB of 10^6 bytes, and their sum."""
    parts = {name: nbytes / 1e6 for name, nbytes in system.memory().items()}
    return {"memory_mb": sum(parts.values())} | {
        f"memory_{n.replace(' ', '_')}_mb": v for n, v in parts.items()
    }


def _beside_learned(summary: pd.DataFrame, chosen: Sequence[Entry]) -> pd.DataFrame:
    """With of_lmm_memory and of_lmm_mean, how many times as much each takes as the first system all of whose
    stages are learned; without them where there is none."""
    learned = [entry.name for entry in chosen if entry.way == "PSD"]
    rows = summary[summary["system"].isin(learned)]
    if rows.empty:
        return summary
    out = summary.copy()
    for column, share in (("memory_mb", "of_lmm_memory"), ("frame_mean_us", "of_lmm_mean")):
        if column in out:
            out.insert(out.columns.get_loc(column) + 1, share, out[column] / rows.iloc[0][column])
    return out


def _by_course(runs: pd.DataFrame) -> pd.DataFrame:
    """A row a system and course: means over the seeds, of `WORST` the largest."""
    groups = runs.drop(columns="seed").groupby(["system", "course"], sort=False)
    table = groups.mean()
    worst = [column for column in WORST if column in table]
    table[worst] = groups[worst].max()
    return table.reset_index()


def _summary(runs: pd.DataFrame, costs: dict[str, list[timing.Cost]], data: dict[str, float]) -> pd.DataFrame:
    """A row a system: means over the courses with their intervals, the largest pop, and the cost over all
    timed frames."""
    table = _by_course(runs)
    metrics = [c for c in table.columns[2:] if c not in (*WORST, "seconds", "broke") and not _SURE.match(c)]
    rows: list[dict[str, Any]] = [{"system": DATA} | data] if data else []
    for name, group in table.groupby("system", sort=False):
        own = runs[runs["system"] == name]
        numbers = group.drop(columns=["system", "course"])
        row = numbers.mean().to_dict() | {key: numbers[key].max() for key in WORST if key in numbers}
        row["seconds"] = own["seconds"].sum()
        if str(name) in costs:
            row |= timing.Cost.joined(costs[str(name)]).microseconds()
        for metric in metrics:
            found = intervals.of_runs(own, metric)
            row[f"{metric}{intervals.CI}"] = math.nan if found.nothing else found.half
        rows.append({"system": name, "courses": len(group), "runs": len(own)} | row)
    columns = ["system", "courses", "runs", *table.columns[2:], *(f"{m}{intervals.CI}" for m in metrics)]
    return pd.DataFrame(rows).reindex(columns=columns)
