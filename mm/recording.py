"""A run on file: what was asked, what was done, every pose; bench judges it, viewers play it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import config, console, files, quat
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

from .control import Command, System
from .course import Course
from .driver import Driver

KIND, VERSION = "recording", 1


@dataclass(eq=False, repr=False)
class Recording:
    """T frames of N characters of one system on one course.

    Attributes
    ----------
    system : name of the system.
    skeleton : J joints, joint 0 the ground root.
    fps : recorded frames per second.
    arrays : [T, N, ...] by name, what the system's `record` gave (below); also by ``recording["name"]``.
    course : what it was driven over, or None.
    path : float64 [P, 2] polyline of the course's way, or None.
    settings : the system's settings as plain data.
    schema : the feature schema as plain data, or None.
    database : fingerprint of the database, empty without one.
    step_seconds : float64 [T], wall time of the system's step.
    stages : names of the S stages that were timed, none when the system was not timed.
    stage_seconds : float64 [T, S], time of each stage in that step.

    Every recording has the poses and the commands; motion matching gives all of these, other systems those
    that they have a meaning for:

        command_velocity [T, N, 2] m/s, command_yaw [T, N], command_crouch [T, N]
        simulation_position [T, N, 2], simulation_velocity [T, N, 2], simulation_yaw [T, N]
        positions [T, N, J, 3], rotations [T, N, J, 4]: local transforms shown, joint 0 in the world
        contacts [T, N, C], locked [T, N, C]: feet on the ground by the data, feet held
        frame [T, N] the database's frame that plays, -1 where there is none
        searched, forced, transition [T, N]: a search was made, an abrupt command forced it, it made a jump
        query [T, N, F] normalised, of the last search; candidate [T, N] its best frame, -1 for none
        source [T, N] the frame around which that search left frames out, -1 for none
        required_tags, forbidden_tags [T, N] of what was asked, crouching among them
        cost_current, cost_candidate [T, N] of playing on and of the candidate, at the last search
        feature_costs [T, N, features of the schema] of the playing frame for the query
        trajectory [T, N, K, 3] predicted x, z, yaw in the world at the schema's times
    """

    system: str
    skeleton: Skeleton
    fps: float
    arrays: dict[str, NDArray]
    course: Course | None = None
    path: NDArray[np.float64] | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    schema: dict[str, Any] | None = None
    database: str = ""
    step_seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    stages: tuple[str, ...] = ()
    stage_seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))

    def __repr__(self) -> str:
        size = f"{len(self)} frames at {self.fps:g} fps, {self.count} x {len(self.skeleton)} joints"
        return f"Recording({self.system!r}, {size}, course {self.course and self.course.name!r})"

    def __len__(self) -> int:
        return len(self.arrays["positions"])

    def __getitem__(self, name: str) -> NDArray:
        return self.arrays[name]

    @property
    def count(self) -> int:
        return self.arrays["positions"].shape[1]

    @property
    def seconds(self) -> float:
        return len(self) / self.fps

    def roots(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Ground positions [T, N, 2] and yaws [T, N] of the characters."""
        return self.arrays["positions"][:, :, 0, [0, 2]], quat.yaw(self.arrays["rotations"][:, :, 0])

    def clip(self, character: int = 0) -> Clip:
        """One character's motion as a clip."""
        if not 0 <= character < self.count:
            raise UserError(
                f"no character {character}", remedy=f"the recording has {self.count}, counted from 0"
            )
        rotations = quat.normalize(self.arrays["rotations"][:, character].astype(np.float64))
        return Clip(
            f"{(self.course and self.course.name) or 'run'}_{character}",
            self.skeleton,
            self.fps,
            self.arrays["positions"][:, character].astype(np.float64),
            quat.unroll(rotations).astype(np.float64),
        )

    def save(self, path: str | os.PathLike[str]) -> str:
        """Write atomically; returns the fingerprint of the content."""
        metadata = {
            "system": self.system,
            "skeleton": self.skeleton.to_json(),
            "fps": self.fps,
            "course": self.course and self.course.to_dict(),
            "settings": self.settings,
            "schema": self.schema,
            "database": self.database,
            "stages": list(self.stages),
        }
        arrays = dict(self.arrays) | {"step_seconds": self.step_seconds, "stage_seconds": self.stage_seconds}
        if self.path is not None:
            arrays["path"] = self.path
        return files.save(path, KIND, VERSION, metadata, arrays)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Recording:
        """Read a recording, memory-mapped and read-only. Errors: see `motion.files.load`."""
        metadata, arrays, _ = files.load(path, KIND, VERSION)
        with files.content_of(path, KIND):
            recording = Recording(
                system=metadata["system"],
                skeleton=Skeleton.from_json(metadata["skeleton"]),
                fps=metadata["fps"],
                course=metadata["course"] and config.from_dict(Course, metadata["course"]),
                settings=metadata["settings"],
                schema=metadata["schema"],
                database=metadata["database"],
                stages=tuple(metadata["stages"]),
                path=arrays.pop("path", None),
                step_seconds=arrays.pop("step_seconds"),
                stage_seconds=arrays.pop("stage_seconds"),
                arrays=arrays,
            )
            recording.validate()
        return recording

    def validate(self) -> None:
        """A ValueError unless types and shapes agree with each other."""
        frames, count = self.arrays["positions"].shape[:2]
        files.check_shapes(
            self.arrays | {"step_seconds": self.step_seconds, "stage_seconds": self.stage_seconds},
            {
                "positions": ("float32", (frames, count, len(self.skeleton), 3)),
                "rotations": ("float32", (frames, count, len(self.skeleton), 4)),
                "command_velocity": ("float32", (frames, count, 2)),
                "command_yaw": ("float32", (frames, count)),
                "step_seconds": ("float64", (frames,)),
                "stage_seconds": ("float64", (frames, len(self.stages))),
            },
        )
        for name, array in self.arrays.items():
            if array.shape[:2] != (frames, count):
                raise ValueError(f"{name} are {array.shape}, expected {frames} frames of {count} characters")
        if self.path is not None and (self.path.ndim != 2 or self.path.shape[1] != 2):
            raise ValueError(f"its path is {self.path.shape}")
        if not 0 < self.fps <= 10_000:
            raise ValueError(f"{self.fps} frames per second")


def record(
    system: System,
    course: Course,
    *,
    seconds: float | None = None,
    every: int = 1,
    characters: int | None = None,
    spread: bool = False,
    driver: Driver | None = None,
    progress: Callable[..., Iterator[int]] = console.progress,
) -> Recording:
    """Drive a system over a course, from the start until all have arrived or time is up.

    Parameters
    ----------
    seconds : stop after this time at the latest.
    every : keep every so-manieth frame; what happened in between (searches, transitions: the bool arrays)
        counts for the next one kept.
    characters : keep the first so many only, to save memory.
    spread : see `mm.driver.Driver`.
    driver : one that was made for this course; by default a new one with this spread.
    progress : wraps the loop over frames.
    """
    if seconds is not None and not (np.isfinite(seconds) and seconds > 0):
        raise UserError(f"a run of {seconds} seconds", remedy="give a number above 0")
    driver = driver or Driver(course, system.count, system.fps, spread=spread)
    driver.reset()
    driver.know(system)
    frames = driver.frames if seconds is None else min(driver.frames, max(1, round(seconds * system.fps)))
    recorder = Recorder(system, frames=frames, every=every, characters=characters)
    steps, label = _frames(frames, driver), course.name or "run"
    for frame in progress(steps, label=label, total=frames, unit="frames"):
        if frame == 0:
            system.reset(driver.starts, driver.yaws)
            positions, yaws = driver.starts, driver.yaws
        command = driver.command(frame / system.fps, positions, yaws)
        start = time.perf_counter()
        poses = system.step(command)
        took = time.perf_counter() - start
        positions, yaws = poses.positions[:, 0, [0, 2]], quat.yaw(poses.rotations[:, 0])
        recorder.take(command, poses, seconds=took)
    return recorder.finish(course=course, path=driver.path)


def _frames(frames: int, driver: Driver) -> Iterator[int]:
    for frame in range(frames):
        if driver.done:
            return
        yield frame


class Recorder:
    """Keeps what a system does in a loop of one's own; `record` is such a loop over a course.

        recorder = Recorder(system, frames=600)
        for _ in range(600):
            recorder.take(command, system.step(command))
        recorder.finish().save("run.rec")

    Parameters
    ----------
    frames : steps that will be taken at most.
    every, characters : see `record`.
    """

    def __init__(self, system: System, *, frames: int, every: int = 1, characters: int | None = None) -> None:
        if min(frames, every, 1 if characters is None else characters) < 1:
            what = f"{frames} frames, every {every}, {characters} characters"
            raise UserError(what, remedy="give numbers of at least 1")
        self._system, self._every, self._characters = system, every, characters
        self._frames, self._frame = frames, 0
        self._length = -(-frames // every)
        # Arrays for all frames, made at the first one, when their shapes are known.
        self._arrays: dict[str, NDArray] = {}
        self._flags: dict[str, NDArray] = {}
        self._seconds = np.zeros(self._length)
        self._stages: tuple[str, ...] = ()
        self._stage_seconds = np.zeros((self._length, 0))

    def take(self, command: Command, poses: Poses, *, seconds: float = 0.0) -> None:
        """Keep the step that the system has just made: what it was asked, its poses, how long it took."""
        if self._frame == self._frames:
            raise ValueError(f"more steps than the {self._frames} that this recorder was made for")
        system = self._system
        stages = getattr(system, "stage_seconds", {}) if getattr(system, "timed", False) else {}
        done = {name: array[: self._characters] for name, array in step(system, command, poses).items()}
        if self._frame == 0:
            # Memory that is never written is never used: time that is not needed costs nothing.
            self._arrays = {n: np.empty((self._length, *a.shape), a.dtype) for n, a in done.items()}
            self._stages = tuple(stages)
            self._stage_seconds = np.zeros((self._length, len(stages)))
        for name, array in done.items():
            if array.dtype == bool:
                self._flags[name] = array | self._flags[name] if name in self._flags else array.copy()
        row, between = divmod(self._frame, self._every)
        self._frame += 1
        if between:
            return
        for name, array in done.items():
            self._arrays[name][row] = self._flags.pop(name) if name in self._flags else array
        self._seconds[row] = seconds
        self._stage_seconds[row] = [stages[name] for name in self._stages]

    def finish(self, *, course: Course | None = None, path: NDArray[np.float64] | None = None) -> Recording:
        """The recording; course and path are what the system was driven over, where it was."""
        if not self._frame:
            raise ValueError("nothing was recorded: take a step first")
        rows = slice(-(-self._frame // self._every))
        return Recording(
            fps=self._system.fps / self._every,
            arrays={name: array[rows] for name, array in self._arrays.items()},
            course=course,
            path=path,
            step_seconds=self._seconds[rows],
            stages=self._stages,
            stage_seconds=self._stage_seconds[rows],
            **about(self._system),
        )


def step(system: System, command: Command, poses: Poses) -> dict[str, NDArray]:
    """What a step was asked, the poses it made, and what the system tells of it, arrays [N, ...] by name."""
    return {
        "command_velocity": command.velocity,
        "command_yaw": command.yaw,
        "command_crouch": command.crouch,
        "positions": poses.positions,
        "rotations": poses.rotations,
    } | system.record()


def about(system: System) -> dict[str, Any]:
    """What a recording says of its system: arguments of `Recording`."""
    return {
        "system": system.name,
        "skeleton": system.skeleton,
        "settings": _plain(getattr(system, "settings", None)),
        "schema": _schema(system),
        "database": getattr(getattr(system, "description", None), "fingerprint", ""),
    }


def _plain(settings: Any) -> dict[str, Any]:
    if is_dataclass(settings) and not isinstance(settings, type):
        return asdict(settings)
    return dict(settings or {})


def _schema(system: System) -> dict[str, Any] | None:
    schema = getattr(getattr(system, "description", None), "schema", None)
    return None if schema is None else schema.to_dict()
