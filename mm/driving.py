"""Driving a system over a course for exactly as long as is measured, and keeping what it was asked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import quat

from .control import Command, System
from .course import Course
from .driver import Driver

# What systems are judged on, and how long at most each course lasts.
COURSES = ("thesis", "circle", "star", "start-stop", "turn-180", "strafe", "random")
SECONDS = 40.0


class Clock(Driver):
    """A driver that goes on when all have arrived, so that every system is judged over the same time.

    `commands` keeps what was asked since the last reset, and `seen` where the characters were then: a system
    that gets the commands again does the same again.
    """

    def __init__(
        self, course: Course, count: int, fps: float, *, spread: bool = False, begin: float = 0.0
    ) -> None:
        self.commands: list[Command] = []
        self.seen: list[tuple[NDArray, NDArray]] = []
        self.begin = begin
        super().__init__(course, count, fps, spread=spread, begin=begin)

    def reset(self) -> None:
        super().reset()
        self.commands.clear()
        self.seen.clear()

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        command = super().command(time, positions, yaws)
        self.done = False
        self.commands.append(command)
        self.seen.append((positions, yaws))
        return command


class Replay(Clock):
    """Asks what an earlier run was asked, wherever the system goes."""

    def __init__(self, before: Clock) -> None:
        self._before = before
        super().__init__(before.course, before.count, before.fps, begin=before.begin)

    @property
    def frames(self) -> int:
        return len(self._before.commands)

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        self.commands.append(self._before.commands[len(self.commands)])
        return self.commands[-1]


class Diverged(Exception):
    """A system left the way of an earlier run."""


class Again(Replay):
    """Asks what an earlier run was asked, as long as the system goes the very same way; else `Diverged`.

    A driver sees only where the characters are: who goes where the other went would have been asked the
    same, and need not wait for the driver.
    """

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        there, facing = self._before.seen[len(self.commands)]
        if not (np.array_equal(positions, there) and np.array_equal(yaws, facing)):
            raise Diverged
        return super().command(time, positions, yaws)


def drive(system: System, clock: Clock) -> Iterator[int]:
    """Step a system from the start of the course on, without end; yields the number of steps made."""
    clock.reset()
    clock.know(system)
    system.reset(clock.starts, clock.yaws)
    positions, yaws = clock.starts, clock.yaws
    frame = 0
    while True:
        poses = system.step(clock.command(frame / system.fps, positions, yaws))
        positions, yaws = poses.positions[:, 0, [0, 2]], quat.yaw(poses.rotations[:, 0])
        frame += 1
        yield frame


def at_data_speeds(course: Course, database: Any) -> Course:
    """A course at the walking and running speed of a database, if it moves at all."""
    from . import speeds

    walk, run = speeds.of_database(database)
    return course.scaled(walk=walk, run=run) if walk > 0 else course


def natural_seconds(course: Course) -> float:
    """How long a course lasts: a script's length, or the time that a way takes at its own speeds."""
    if course.seconds is not None:
        return course.seconds * (1 if course.waypoints else course.laps)
    points = [w.position for w in course.waypoints]
    targets = [*course.waypoints[1:], *course.waypoints[: course.closed]]
    legs = zip([*points, points[0]], targets, strict=False)
    return course.laps * sum(math.dist(here, target.position) / target.speed for here, target in legs)
