"""The comparison: every system over every course, one row each, and one row a system."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from features import terrain
from features.terrain import Ground, Heightmap
from mm import course as courses_
from mm import quality, recording, speeds
from mm.control import System
from mm.course import Course
from mm.database import Database
from mm.driving import COURSES, SECONDS, Again, Clock, Diverged, Replay, natural_seconds
from mm.grounded import on_ground
from mm.nearness import RealPoses, difference
from motion import console
from motion.errors import UserError

from . import timing
from .entry import Entry, as_stored, called
from .pose_error import PoseErrors, held_by_all
from .systems import choose, without_legs

if TYPE_CHECKING:
    from lmm.models import AnyModel

TIMED_SECONDS, REPEATS = 5.0, 3
WORST = ("pop_cm", "path_max_cm", "stall_s")  # a system's row has the largest, of other metrics the mean
DATA = "(the clips)"
NEAR_SECONDS = 0.5  # by which two walks may be out of step
KEPT = 8  # ways of a course, the last ones, that are tried before the driver is asked


@dataclass(eq=False)
class Comparison:
    """What was measured.

    Attributes
    ----------
    summary : a row a system, and a first one for the clips themselves; columns end in their unit.
    courses : a row a system and course.
    traces : what the plots need, one a row of `courses`.
    played : the courses as they were played, scaled.
    feet : indices of the foot joints.
    notes : what a reader must know: what was scaled, what was left out.
    database : name, fingerprint, size and speeds of the data.
    models : what the learned systems are made of: fingerprint, size and training by name.
    machine : see `bench.timing.machine`.
    ground : what all walked on, None where that was level.
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
    scale: bool = True,
    ground: Heightmap | None = None,
    name: str = "",
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
        `_Yardstick`), and what its Decompression makes of frames against these (`bench.pose_error`).
    timed_seconds : how much of each course the clock runs; the metrics are those of all of it.
    seed : of courses with a random user; their own when None.
    scale : bring the courses' speeds to those of the data.
    ground : what all walk on; those that do not know of grounds are put on it (`mm.grounded`).
    name : of the database, for the report.

    An unknown course, system or index is a UserError that lists the choices.
    """
    if not (math.isfinite(seconds) and seconds > 0):
        raise UserError(f"{seconds} seconds", remedy="give a number above 0")
    walk, run = speeds.of_database(database)
    played = [_prepared(c, walk, run, seed, scale) for c in courses]
    why, notes = without_legs(database), []
    chosen = _chosen(systems, indexes, models, codecs, legs=why is None)
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
    rows, traces = [], []
    costs: dict[str, list[timing.Cost]] = {}
    yardstick = _Yardstick(database, ground, legs=why is None) if inexact else None
    errors = PoseErrors(database, held_by_all(model.held_out for model in (models or {}).values()))
    runs = [_Runs(course, feet, seconds, yardstick, ground) for course in played]
    jobs = [(entry, on_course) for entry in chosen for on_course in runs]
    system: System | None = None
    built: tuple[Any, ...] = ()
    absent: set[str] = set()
    for entry, on_course in console.progress(jobs, label="compare", unit="runs") if progress else jobs:
        if entry.name in absent:
            continue
        course = on_course.course
        obstacles = course.obstacles()
        if built != (entry.name, obstacles.tobytes()):
            try:
                make = partial(entry.make, database, 1, obstacles=obstacles)
                system = on_ground(make, ground, sees=entry.sees_ground)
            except UserError as error:
                absent.add(entry.name)
                if len(absent) == len(chosen):
                    raise
                notes.append(f"{entry.name} is left out: {error}")
                continue
            system.name, built = entry.name, (entry.name, obstacles.tobytes())
        assert system is not None
        frames = max(1, round(timed_seconds * system.fps))
        with timing.single_thread():  # libraries that start threads for one query take longer
            clock, searched, metrics, trace = on_course.judge(system)
            cost = timing.frame_cost(system, clock, frames, searched=searched, repeats=REPEATS)
        row = {"system": entry.name, "course": course.name, "seconds": len(trace.walked) / system.fps}
        poses = errors.of(entry.decoder) if inexact else {}
        rows.append(row | memory_mb(system) | cost.microseconds() | poses | metrics)
        traces.append(trace)
        costs.setdefault(entry.name, []).append(cost)
    if ground is not None:
        notes += _beyond(ground, traces)
    table = pd.DataFrame(rows)
    return Comparison(
        _summary(table, costs, quality.of_data(database, feet, on_ground=ground is not None)),
        table,
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
        },
        {name: _about(model) for name, model in (models or {}).items()},
        ground=ground,
    )


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


class _Yardstick:
    """What the data holds and what motion matching shows, to hold the poses of a system against.

    Poses are compared root-aligned, by the mean distance of their joints in cm:

        real_cm: to the nearest pose of the database, of evenly spread frames of the run;
        mm_cm: to what mm-exact shows at the same frame under the same commands;
        mm_near_cm: to the nearest pose that it shows within half a second.

    The commands are those that mm-exact was asked on its own run over the course, and a system gets them
    again whatever it does with them: so all systems are asked the very same, and held against the same
    poses. Commands come from where a character is, so that each its own would not be the same; and those of
    the judged system would be other ones, and easier to match, in every row. Both walk blindly, but poses are
    not compared by where they are. Two walks that differ in anything are soon out of step, which is most of
    mm_cm: what the rows of approximate searches have is what being out of step makes.
    """

    def __init__(self, database: Database, ground: Ground | None, *, legs: bool) -> None:
        self._database, self.real, self._ground = database, RealPoses(database), ground
        self._matching = choose([called("mm-exact", legs)])[0]

    def matching(self, course: Course) -> System:
        """The motion matching that others are held against."""
        make = partial(self._matching.make, self._database, 1, obstacles=course.obstacles())
        return on_ground(make, self._ground)

    def matched_cm(self, tape: recording.Recording, matched: recording.Recording) -> dict[str, float]:
        """Of two runs that were asked the same."""
        poses, others = _local(tape), _local(matched)
        window = round(NEAR_SECONDS * tape.fps)
        return {
            "mm_cm": float(difference(poses, others).mean()),
            "mm_near_cm": float(difference(poses, others, window=window).mean()),
        }


def _local(tape: recording.Recording) -> NDArray[np.floating]:
    """Joints [T, J-1, 3] of the first character in the space of its ground root."""
    return quality.in_root_space(tape.skeleton, tape["positions"][:, 0], tape["rotations"][:, 0])


class _Runs:
    """The runs of all systems over one course. What was done before is not done again.

    Systems that go the same way are asked the same (see `mm.driving.Again`), and those that show the same
    poses are judged once: exact indexes all find the same frames.
    """

    def __init__(
        self,
        course: Course,
        feet: quality.Feet,
        seconds: float,
        yardstick: _Yardstick | None,
        ground: Ground | None,
    ) -> None:
        self.course, self._feet, self._seconds = course, feet, min(seconds, natural_seconds(course))
        self._yardstick, self._ground = yardstick, ground
        self._matched: tuple[Clock, recording.Recording] | None = None
        self._ways: deque[Clock] = deque(maxlen=KEPT)
        self._judged: dict[bytes, tuple[dict[str, float], quality.Trace]] = {}

    def judge(
        self, system: System
    ) -> tuple[Clock, NDArray[np.bool_] | None, dict[str, float], quality.Trace]:
        """Drive a system: what it was asked, which steps searched (if it tells), its metrics and trace."""
        if self._yardstick and self._matched is None:
            self._matched = self._drive(self._yardstick.matching(self.course))
        clock, tape = self._drive(system)
        key = hashlib.blake2b()
        for name in ("positions", "rotations", "transition"):
            if name in tape.arrays:
                key.update(tape[name].tobytes())
        if key.digest() not in self._judged:
            self._judged[key.digest()] = self._judge(system, clock, tape)
        metrics, trace = self._judged[key.digest()]
        searched = np.any(tape["searched"], axis=1) if "searched" in tape.arrays else None
        return clock, searched, metrics, replace(trace, system=system.name)

    def _judge(
        self, system: System, clock: Clock, tape: recording.Recording
    ) -> tuple[dict[str, float], quality.Trace]:
        metrics, trace = quality.judge(
            tape.arrays,
            system.skeleton,
            system.fps,
            self._feet,
            tape.path,
            course=self.course.name,
            ground=self._ground,
        )
        if self._yardstick and self._matched:
            asked, matched = self._matched
            again = tape if clock is asked else self._record(system, Replay(asked))
            metrics |= {"real_cm": self._yardstick.real.of_run(tape)}
            metrics |= self._yardstick.matched_cm(again, matched)
        return metrics, trace

    def _drive(self, system: System) -> tuple[Clock, recording.Recording]:
        for before in reversed(self._ways):
            if (before.count, before.fps) != (system.count, system.fps):
                continue
            with contextlib.suppress(Diverged):
                return before, self._record(system, Again(before))
        clock = Clock(self.course, system.count, system.fps)
        self._ways.append(clock)
        return clock, self._record(system, clock)

    def _record(self, system: System, clock: Clock) -> recording.Recording:
        return recording.record(
            system, self.course, seconds=self._seconds, driver=clock, progress=console.silent
        )


def memory_mb(system: System) -> dict[str, float]:
    """Memory by part, MB of 10^6 bytes, and their sum."""
    parts = {name: nbytes / 1e6 for name, nbytes in system.memory().items()}
    return {"memory_mb": sum(parts.values())} | {
        f"memory_{n.replace(' ', '_')}_mb": v for n, v in parts.items()
    }


def _summary(
    table: pd.DataFrame, costs: dict[str, list[timing.Cost]], data: dict[str, float]
) -> pd.DataFrame:
    """A row a system: means over the courses, the largest pop, and the cost over all timed frames."""
    rows: list[dict[str, Any]] = [{"system": DATA} | data] if data else []
    for name, group in table.groupby("system", sort=False):
        numbers = group.drop(columns=["system", "course"])
        row = numbers.mean().to_dict() | {key: numbers[key].max() for key in WORST}
        row["seconds"] = numbers["seconds"].sum()
        cost = timing.Cost.joined(costs[str(name)])
        rows.append({"system": name, "courses": len(group)} | row | cost.microseconds())
    columns = ["system", "courses", *table.columns[2:]]
    return pd.DataFrame(rows).reindex(columns=columns)


def plain(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table for JSON: NaN becomes None."""
    return [
        {key: None if _missing(value) else _python(value) for key, value in row.items()}
        for row in table.to_dict("records")
    ]


def _missing(value: Any) -> bool:
    return isinstance(value, float | np.floating) and not math.isfinite(value)


def _python(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
