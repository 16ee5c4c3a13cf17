"""How well a model drives characters, beside motion matching under the same rules; and for how long."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground
from lmm.controller import controller
from lmm.model import Model
from mm import courses, metrics, quality, queries, recording
from mm.controller import Controller
from mm.course import Course
from mm.database import Database
from mm.driving import Clock, at_data_speeds, drive, natural_seconds
from mm.grounded import on_ground
from mm.nearness import RealPoses
from mm.settings import Settings
from motion import console, contacts
from motion.errors import NotFinite, UserError
from motion.pose import Poses

Array = NDArray[np.floating]

MIXED = ("circle", "start-stop", "random")  # courses of the table of all mixtures
MARGIN = 0.5  # of a column's range, that a state may lie beyond it
LOOSE_CM = 1.0  # that a bone may be longer or shorter than it ever is in the data
HASTE = 1.5  # times the fastest of the data that a root may move
WORST = ("pop_cm", "path_max_cm", "stall_s")  # of these a system's row has the largest of its courses


class Judge:
    """Drives systems over courses and judges what they do; one for all systems of a database.

    ground : what the systems that it is given have been put on, if they have.
    """

    def __init__(
        self, database: Database, names: Sequence[str], *, seconds: float, ground: Ground | None = None
    ) -> None:
        self._feet, self._real, self._ground = quality.Feet.of(database), RealPoses(database), ground
        self._scaled = partial(at_data_speeds, database=database)
        self.take(names, seconds=seconds)

    def take(self, names: Sequence[str], *, seconds: float) -> None:
        """Go on with other courses, each of so many seconds at most, at the speeds of the data."""
        if not seconds > 0:
            raise UserError(f"{seconds} seconds", remedy="give a number above 0")
        self.courses, self._seconds = [self._scaled(courses.load(name)) for name in names], seconds

    def judge(self, system: Controller, course: Course) -> dict[str, Any]:
        """A row: the metrics of `mm.quality.judge`, real_cm, the mean distance to the nearest real pose
        (`mm.nearness`), and frame_us, the median time of a step, by character. Where the course allows,
        the system's characters begin at other places or times, so that no two do the same.

        A system whose poses are no numbers any more has no metrics, and the row says that it broke; what
        else keeps it from going on is a UserError.
        """
        clock = Clock(course, system.count, system.fps, spread=True)
        seconds = min(self._seconds, natural_seconds(course))
        named: dict[str, Any] = {"system": system.name, "course": course.name}
        try:
            tape = recording.record(system, course, seconds=seconds, driver=clock, progress=console.silent)
        except NotFinite:  # where the character is, and with it the next command, is no number
            return named | {"broke": True}
        if not all(np.isfinite(tape[name]).all() for name in ("positions", "rotations")):
            return named | {"broke": True}
        row, _ = quality.judge(
            tape.arrays,
            system.skeleton,
            system.fps,
            self._feet,
            tape.path,
            course=course.name,
            ground=self._ground,
        )
        return named | {
            "seconds": len(tape) / system.fps,
            **row,
            "real_cm": self._real.of_run(tape),
            "frame_us": float(1e6 * np.median(tape.step_seconds) / system.count),
        }


@dataclass(frozen=True)
class Lost:
    """A system that cannot begin, for its networks put out no numbers: judged, it broke."""

    name: str
    count: int
    fps: float
    error: NotFinite

    def reset(self, *places: Array) -> None:
        raise self.error

    def memory(self) -> dict[str, float]:
        return {"unknown": float("nan")}


def systems(
    model: Model,
    database: Database,
    learned: Iterable[str],
    *,
    count: int = 1,
    latents: Array | None = None,
    locked: bool = True,
    ground: Ground | None = None,
) -> Iterator[Any]:
    """Characters driven by each mixture of stages: "PSD" is the model, "" motion matching, mm; on a ground.

    Feet are held where that is asked for and the skeleton has whole legs; else names end in -free. Those that
    cannot begin are `Lost`.
    """
    settings = Settings(foot_lock=locked and model.description.legs is not None)
    index = queries.index_of(database)
    for letters in learned:
        name = (f"lmm-{letters}" if letters else "mm") + ("" if settings.foot_lock else "-free")
        try:
            make = partial(
                controller,
                model,
                count=count,
                learned=letters,
                database=database,
                index=index,
                latents=latents,
                settings=settings,
                name=name,
            )
            yield on_ground(make, ground)
        except NotFinite as error:
            yield Lost(name, count, model.description.fps, error)


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row a system: means over its courses of what has a number there, of `WORST` the largest, and on how
    many it broke, if on any."""
    systems = list(dict.fromkeys(row["system"] for row in rows))
    out = []
    for system in systems:
        mine = [row for row in rows if row["system"] == system]
        numbers = dict.fromkeys(
            key for each in mine for key, value in each.items() if isinstance(value, float)
        )
        row: dict[str, Any] = {"system": system, "courses": len(mine)}
        row |= {key: metrics.nanmean([each.get(key, np.nan) for each in mine]) for key in numbers}
        for name in (name for name in WORST if any(name in each for each in mine)):
            some = [each[name] for each in mine if np.isfinite(each.get(name, np.nan))]
            row[name] = max(some, default=float("nan"))
        if broke := sum("broke" in each for each in mine):
            row["broke"] = broke
        out.append(row)
    return out


def memory_mb(system: Controller) -> float:
    """All that a system holds, MB of 10^6 bytes."""
    return sum(system.memory().values()) / 1e6


class Extremes:
    """The furthest that states and poses of the steps seen so far went; see `endure`.

    low, high [K] are the ranges of the states in the data; spans [K], how wide they are, may be given apart.
    """

    def __init__(self, database: Database, low: Array, high: Array, spans: Array | None = None) -> None:
        self._low, self._high = low, high
        lengths = bone_lengths(database.poses.positions)
        self._shortest, self._longest = lengths.min(axis=0), lengths.max(axis=0)
        self._hips = np.array(database.skeleton.parents[1:]) == 0  # hung on the root by no bone
        velocity = database.poses.velocities[:, 0][:, [0, 2]]
        self.data_speed = float(np.linalg.norm(velocity, axis=-1).max())
        spans = high - low if spans is None else spans
        self._span = np.where(spans > 0, spans, np.inf).astype(np.float64)
        self.frames, self.broken, self.outside = 0, -1, -1
        self.below, self.above = np.full_like(self._low, np.inf), np.full_like(self._low, -np.inf)
        self.bone, self.hips, self.speed = 0.0, 0.0, 0.0
        self._before: Array | None = None

    def see(self, states: Array, poses: Poses, fps: float) -> bool:
        """Take a step in: states [N, K] and poses [N]; whether all of it are numbers."""
        self.frames += 1
        arrays = (states, *poses.arrays().values())
        if not all(np.isfinite(array).all() for array in arrays):
            self.broken = self.frames
            return False
        self.below = np.minimum(self.below, states.min(axis=0))
        self.above = np.maximum(self.above, states.max(axis=0))
        if self.outside < 0 and self.excess().max() > MARGIN:
            self.outside = self.frames
        lengths = bone_lengths(poses.positions)
        off = 100 * np.maximum(lengths - self._longest, self._shortest - lengths)
        self.hips = max(self.hips, float(off[:, self._hips].max(initial=0)))
        self.bone = max(self.bone, float(off[:, ~self._hips].max(initial=0)))
        root = poses.positions[:, 0][:, [0, 2]].astype(np.float64)
        if self._before is not None:
            self.speed = max(self.speed, fps * float(np.linalg.norm(root - self._before, axis=-1).max()))
        self._before = root
        return True

    def excess(self) -> NDArray[np.float64]:
        """How far states went beyond the range of each column [K], as a share of the range; 0: not."""
        beyond = np.maximum(self.above - self._high, self._low - self.below)
        return np.maximum(beyond, 0) / self._span


def bone_lengths(positions: Array) -> Array:
    """Lengths [..., J-1] of the bones to all joints but the ground root, of local positions [..., J, 3]."""
    return np.linalg.norm(positions[..., 1:, :], axis=-1)


def endure(
    model: Model,
    database: Database,
    *,
    seconds: float = 600.0,
    characters: int = 16,
    seed: int = 1,
    progress: Callable[..., Iterator[int]] = console.silent,
) -> dict[str, Any]:
    """Let a random user drive characters by the model alone for a long time: does anything diverge?

    state_excess : the furthest that a state's column went beyond its range in the training data, as a share
        of that range; at most 0.5 passes, and outside_s is when it was first exceeded.
    bone_excess_cm, hips_excess_cm : the most that a bone was longer or shorter, and that the hips were
        further from the root on the ground or nearer to it, than ever in the data; at most 1 cm passes.
    speed_mps : the fastest of any root, at most 1.5 times that of the data, data_speed_mps.
    stall_s : see `mm.metrics.longest_stall`.
    finite : whether all states and poses were numbers; broken_s, when they were not.
    """
    settings = Settings(foot_lock=model.description.legs is not None)
    driven: Any = controller(model, count=characters, settings=settings)
    return last(
        driven,
        database,
        states=lambda: driven.state.values,  # of a `lmm.stages.LatentState`
        ranges=(model.state_low, model.state_high),
        columns=[_column(model, column) for column in range(len(model.state_low))],
        seconds=seconds,
        seed=seed,
        progress=progress,
    )


def last(
    driven: Any,
    database: Database,
    *,
    states: Callable[[], Array],
    ranges: tuple[Array, ...],
    columns: Sequence[str],
    hips_loose_cm: float = LOOSE_CM,
    seconds: float = 600.0,
    seed: int = 1,
    progress: Callable[..., Iterator[int]] = console.silent,
) -> dict[str, Any]:
    """What `endure` finds, of any system that tells its poses.

    states gives what the system goes on from, [N, K], ranges what `Extremes` needs of it, columns its names.
    The hips may be hips_loose_cm further from the ground, or nearer to it, than in the data.
    """
    characters, skeleton = driven.count, driven.skeleton
    course = queries.random_user(database, seconds * characters, seed=seed)
    seen = Extremes(database, *ranges)
    frames = max(1, round(seconds * driven.fps))
    clock = Clock(course, characters, driven.fps, spread=True)
    joints, points = contacts.touching_points(skeleton, database.contact_roles)
    feet = np.zeros((frames, characters, len(joints), 3), np.float32)
    root = np.zeros((frames, characters, 2), np.float32)
    steps = drive(driven, clock)
    for frame in progress(iter(range(frames)), label="endurance", total=frames, unit="frames"):
        next(steps)
        poses = driven.poses()
        if not seen.see(states(), poses, driven.fps):
            break
        world = quality.world_transforms(skeleton, poses.positions, poses.rotations)
        feet[frame] = contacts.place_points(*world, joints, points)
        root[frame] = poses.positions[:, 0][:, [0, 2]]
    excess, done = seen.excess(), len(clock.commands)
    asked = np.stack([command.velocity for command in clock.commands])
    finite = seen.broken < 0
    return {
        "minutes": seen.frames / driven.fps / 60,
        "characters": characters,
        "finite": finite,
        "broken_s": None if finite else seen.broken / driven.fps,
        "outside_s": None if seen.outside < 0 else seen.outside / driven.fps,
        "state_excess": float(excess.max()),
        "state_excess_column": columns[int(excess.argmax())],
        "bone_excess_cm": seen.bone,
        "hips_excess_cm": seen.hips,
        "speed_mps": seen.speed,
        "data_speed_mps": seen.data_speed,
        "stall_s": metrics.longest_stall(feet[:done], root[:done], asked, driven.fps),
        "passed": bool(
            finite
            and excess.max() <= MARGIN
            and seen.bone <= LOOSE_CM
            and seen.hips <= hips_loose_cm
            and seen.speed <= HASTE * seen.data_speed
        ),
    }


def _column(model: Model, column: int) -> str:
    names = model.description.schema.columns
    return names[column] if column < len(names) else f"latent {column - len(names)}"
