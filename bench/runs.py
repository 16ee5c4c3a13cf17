"""One system on one course: driven, judged and timed; what is the same of several is done once."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground
from mm import quality, recording
from mm.control import System
from mm.course import Course
from mm.database import Database
from mm.driving import Again, Clock, Diverged, Replay, natural_seconds
from mm.grounded import on_ground
from mm.nearness import RealPoses, difference
from motion import console
from motion.errors import NotFinite
from motion.skeleton import Skeleton

from . import timing
from .entry import called
from .systems import choose

NEAR_SECONDS = 0.5  # by which two walks may be out of step
KEPT = 8  # ways of a course, the last ones, that are tried before the driver is asked
GOLDEN = (math.sqrt(5) - 1) / 2  # multiples of it lie evenly in [0, 1), however many there are


@dataclass(frozen=True)
class Variant:
    """A course as a seed has it: seed 0 is the course itself.

    Others begin elsewhere on a closed way or in a script, begin being the share of it; a random user is
    another one. An open way has no other seeds.
    """

    course: Course
    seed: int = 0
    begin: float = 0.0

    @staticmethod
    def of(course: Course, repeats: int) -> list[Variant]:
        """So many of a course, or all there are."""
        out = [Variant(course)]
        for seed in range(1, repeats):
            if course.random is not None:
                user = replace(course.random, seed=(course.random.seed + seed) % 2**32)
                out.append(Variant(replace(course, random=user), seed))
            elif course.closed or not course.waypoints:
                out.append(Variant(course, seed, seed * GOLDEN % 1))
        return out

    def facts(self) -> dict[str, Any]:
        """What tells it from all others, as plain data."""
        return {
            "course": self.course.name,
            "played": self.course.to_dict(),
            "seed": self.seed,
            "begin": self.begin,
        }


@dataclass(eq=False)
class Run:
    """What is found of a system on a course: row has the metrics; cost and trace are those of seed 0."""

    row: dict[str, Any]
    cost: timing.Cost | None = None
    trace: quality.Trace | None = None

    def packed(self) -> tuple[dict[str, Any], dict[str, NDArray]]:
        """As data for JSON and arrays."""
        row = {name: v.item() if isinstance(v, np.generic) else v for name, v in self.row.items()}
        data: dict[str, Any] = {"row": row}
        arrays: dict[str, NDArray] = {}
        if self.cost is not None:
            data["stages"] = list(self.cost.stages)
            arrays |= {f"stage_{i}": times for i, times in enumerate(self.cost.stages.values())}
            arrays |= {name: getattr(self.cost, name) for name in ("whole", "searched", "means")}
        if self.trace is not None:
            data["trace"] = {}
            for name, value in vars(self.trace).items():
                if isinstance(value, np.ndarray):
                    arrays[f"trace_{name}"] = value
                else:
                    data["trace"][name] = value.to_json() if isinstance(value, Skeleton) else value
        return data, arrays

    @staticmethod
    def unpacked(data: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Run:
        cost = trace = None
        if "stages" in data:
            stages = {name: arrays[f"stage_{i}"] for i, name in enumerate(data["stages"])}
            cost = timing.Cost(arrays["whole"], stages, arrays["searched"], arrays["means"])
        if "trace" in data:
            values = {**data["trace"], "skeleton": Skeleton.from_json(data["trace"]["skeleton"])}
            values |= {n.removeprefix("trace_"): a for n, a in arrays.items() if n.startswith("trace_")}
            trace = quality.Trace(**values)
        return Run(dict(data["row"]), cost, trace)


class Yardstick:
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


class OnCourse:
    """The runs of all systems over one course. What was done before is not done again.

    Systems that go the same way are asked the same (see `mm.driving.Again`), and those that show the same
    poses are judged once: exact indexes all find the same frames.
    """

    def __init__(
        self,
        variant: Variant,
        feet: quality.Feet,
        seconds: float,
        yardstick: Yardstick | None,
        ground: Ground | None,
    ) -> None:
        self.variant, self.course, self._feet = variant, variant.course, feet
        self.seconds = min(seconds, natural_seconds(self.course))
        self._yardstick, self._ground = yardstick, ground
        self._matched: tuple[Clock, recording.Recording] | None = None
        self._ways: deque[Clock] = deque(maxlen=KEPT)
        self._judged: dict[bytes, tuple[dict[str, float], quality.Trace]] = {}

    def run(self, system: System, *, timed: int, repeats: int) -> Run:
        """Drive and judge a system, and time the first so many frames of it, if any.

        One whose poses are no numbers any more has broken: its row says no more than that.
        """
        row: dict[str, Any] = {"system": system.name, "course": self.course.name, "seed": self.variant.seed}
        with timing.single_thread():  # libraries that start threads for one query take longer
            try:
                clock, searched, metrics, trace = self._judge(system)
                frames = len(trace.walked)
                cost = None
                if timed:
                    cost = timing.frame_cost(system, clock, timed, searched=searched, repeats=repeats)
            except NotFinite:
                return Run(row | {"broke": 1.0})
        row |= {"seconds": frames / system.fps, "broke": 0.0} | metrics
        return Run(row, cost, trace if self.variant.seed == 0 else None)

    def _judge(
        self, system: System
    ) -> tuple[Clock, NDArray[np.bool_] | None, dict[str, float], quality.Trace]:
        """What a system was asked, which steps searched (if it tells), its metrics and trace."""
        if self._yardstick and self._matched is None:
            self._matched = self._drive(self._yardstick.matching(self.course))
        clock, tape = self._drive(system)
        key = hashlib.blake2b()
        for name in ("positions", "rotations", "transition"):
            if name in tape.arrays:
                key.update(tape[name].tobytes())
        if key.digest() not in self._judged:
            self._judged[key.digest()] = self._metrics(system, clock, tape)
        metrics, trace = self._judged[key.digest()]
        searched = np.any(tape["searched"], axis=1) if "searched" in tape.arrays else None
        return clock, searched, metrics, replace(trace, system=system.name)

    def _metrics(
        self, system: System, clock: Clock, tape: recording.Recording
    ) -> tuple[dict[str, float], quality.Trace]:
        if not all(np.isfinite(tape[name]).all() for name in ("positions", "rotations")):
            raise NotFinite(f"{system.name} shows poses that are no numbers")
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
        clock = Clock(self.course, system.count, system.fps, begin=self.variant.begin)
        self._ways.append(clock)
        return clock, self._record(system, clock)

    def _record(self, system: System, clock: Clock) -> recording.Recording:
        return recording.record(
            system, self.course, seconds=self.seconds, driver=clock, progress=console.silent
        )
