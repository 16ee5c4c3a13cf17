"""Whoever drives characters over a course: from the time and where they are to what they are asked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.trajectory import directions_to_world
from motion.springs import wrap

from .commands import from_stick, from_velocity
from .control import Command, System, lag_of
from .course import Course, StickKey
from .polyline import Polyline, spline

Float = NDArray[np.float64]

LOOKAHEAD = 0.75  # seconds; a character that follows with the default half-lives then stays on a curve
SPACING = 0.1  # metres between points of a smooth way
GAIT_HALFLIFE = 0.1  # seconds in which a stick's gait goes half the way to another (REFERENCE 2.5)


class Driver:
    """Commands for N characters over a course; deterministic.

    Ways of waypoints: each character's progress along the way is the nearest point to it, which only moves
    forward. It is sent to the point that lies lookahead seconds of its speed further on, but not beyond a
    waypoint before it is within the waypoint's radius: so straight ways are followed into their corners.
    Before a corner it is slowed over the same distance (`Course.corner_speed`), before the end of an open way
    to a stand. Smooth ways are not slowed, and tell the rate at which they turn; on them characters are sent
    the way that they shall go when they have obeyed.

    Parameters
    ----------
    course, count, fps : the course, N, and steps a second.
    spread : start characters evenly along a closed way, and shift a script evenly in time (it is played
        round), so that no two do the same; otherwise all do the same.
    begin : share of a closed way, or of a script, at which the first of them starts.
    lookahead : seconds of travel to the point aimed at. A character that obeys at once keeps to a curve the
        better the smaller it is.
    required_tags, forbidden_tags : tag bits that every command asks for and avoids (`Database.tag_mask`).

    Attributes
    ----------
    starts : float32 [N, 2], yaws : float32 [N]; where to reset the system to.
    path : float64 [P, 2] polyline of the way, first point repeated when closed; None for scripts.
    nominal : seconds that the course should take.
    limit : seconds after which it is over in any case: the course's own, or twice nominal and ten more.
    done : all have arrived, or the last command was the last within limit.
    lag : seconds [N] after which characters go the way that they are asked to (`know`); by default half of
        lookahead, by which the way to the point ahead is ahead of a curve.
    """

    def __init__(
        self,
        course: Course,
        count: int = 1,
        fps: float = 60.0,
        *,
        spread: bool = False,
        begin: float = 0.0,
        lookahead: float = LOOKAHEAD,
        required_tags: int = 0,
        forbidden_tags: int = 0,
    ) -> None:
        if count < 1 or not fps > 0 or not lookahead > 0:
            raise ValueError(f"count {count}, fps {fps}, lookahead {lookahead}: expected positive numbers")
        self.course, self.count, self.fps = course, count, fps
        self._masks, self._lookahead = (required_tags, forbidden_tags), lookahead
        self.lag = np.full(count, lookahead / 2)
        self._part: _Way | _Script
        shares = begin + np.arange(count) / count * spread
        if course.waypoints:
            self._part = _Way(course, shares, lookahead)
        else:
            self._part = _Script(course, shares)
        self.path, self.nominal = self._part.path, self._part.nominal
        self.limit = course.seconds * course.laps if course.seconds else 2 * self.nominal + 10
        self.reset()

    @property
    def frames(self) -> int:
        """Steps until time is up."""
        return max(1, round(self.limit * self.fps))

    @property
    def laps(self) -> Float:
        """Rounds of the way, or of the script, that each character has gone, [N], fractions included."""
        return self._part.laps(self._time)

    def know(self, *systems: System) -> None:
        """Who is driven: one system for all characters, or one for each, of which some tell their lag."""
        known = [lag_of(system) for system in systems]
        self.lag[:] = [self._lookahead / 2 if lag is None else lag for lag in known]

    def reset(self) -> None:
        """Back to the start; the same calls give the same commands again."""
        self.done, self._time = False, 0.0
        starts, yaws = self._part.reset()
        if self.course.start is not None:
            starts = np.tile(self.course.start, (self.count, 1))
        if self.course.facing is not None:
            yaws = np.full(self.count, np.arctan2(*self.course.facing))
        self.starts, self.yaws = starts.astype(np.float32), yaws.astype(np.float32)
        self._last_yaw = self.yaws

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        """What the characters at positions [N, 2], facing yaws [N], are asked at a time (seconds, rising)."""
        self._time = time
        command, arrived = self._part.command(time, positions, yaws, self._last_yaw, self.lag)
        self._last_yaw = command.yaw
        command.required_tags[:], command.forbidden_tags[:] = self._masks
        self.done = arrived or time >= self.limit - 1.5 / self.fps
        return command

    def remember(self) -> Any:
        """How far the characters are, for `recall`."""
        return self._time, self._last_yaw, self.done, self._part.remember()

    def recall(self, remembered: Any) -> None:
        """Be again where this driver was."""
        self._time, self._last_yaw, self.done, part = remembered
        self._part.recall(part)


class _Way:
    """Follows waypoints. A leg leads to a waypoint; legs and arc lengths count on through the laps."""

    def __init__(self, course: Course, shares: Float, lookahead: float) -> None:
        self._count, self._lookahead, self._smooth = len(shares), lookahead, course.smooth
        points = np.array([w.position for w in course.waypoints])
        if course.closed:
            points = np.vstack([points, points[:1]])
        ends = np.arange(len(points))
        if course.smooth:
            points, ends = spline(points, closed=course.closed, spacing=SPACING)
        self._line = line = Polyline(points, closed=course.closed)
        self.path = line.points

        # Tables by leg. One lap more than asked, for those who start within the first one, and one leg more,
        # to stand in for those who have arrived.
        targets = [*course.waypoints[1:], *course.waypoints[: course.closed]]
        rounds, legs = course.laps + course.closed, len(targets)

        def table(values: list) -> Float:
            return np.array([*values * rounds, values[-1]], np.float64)

        marks = line.arcs[ends[1:]]
        self._marks = np.append((marks + line.length * np.arange(rounds)[:, None]).reshape(-1), np.inf)
        self._speeds = table([w.speed for w in targets])
        self._facings = table([w.facing or (0.0, 0.0) for w in targets])
        self._radii = table([w.reach for w in targets])
        self._crouches = table([w.gait == "crouch" for w in targets]) > 0
        self._shares = table(list(_corner_shares(course, line)))
        # Where the aim may go to at most: a corner; smooth ways have none but an open one's end.
        self._barriers = self._marks
        if course.smooth:
            self._barriers = np.full(len(self._marks), np.inf if course.closed else line.length)
            self._radii[: legs - (not course.closed)] = 0
            self._radii[legs:] = 0

        self._begin = shares % 1 * line.length if course.closed else np.zeros(len(shares))
        self._first = np.searchsorted(self._marks, self._begin, side="right")
        self._last = self._first + legs * course.laps
        self.nominal = float(np.sum(np.diff(marks, prepend=0.0) / self._speeds[:legs])) * course.laps

    def reset(self) -> tuple[Float, Float]:
        self._progress, self._leg = self._begin.copy(), self._first.copy()
        positions, direction, _ = self._line.at(self._begin)
        facing = self._facings[self._leg]
        facing = np.where(np.any(facing != 0, axis=1, keepdims=True), facing, direction)
        return positions, np.arctan2(facing[:, 0], facing[:, 1])

    def remember(self) -> Any:
        return self._progress, self._leg  # of which others are made every time

    def recall(self, remembered: Any) -> None:
        self._progress, self._leg = remembered

    def laps(self, time: float) -> Float:
        return (self._progress - self._begin) / self._line.length

    def command(
        self, time: float, positions: NDArray, yaws: NDArray, last: NDArray, lag: Float
    ) -> tuple[Command, bool]:
        arrived = self._advance(positions)
        leg, progress, line = self._leg, self._progress, self._line
        speed, barrier = self._speeds[leg], self._barriers[leg]
        reach = self._lookahead * speed
        aim = np.minimum(progress + reach, barrier)
        target, _, segment = line.at(np.where(arrived, progress, aim))
        way = target - positions
        distance = np.hypot(way[:, 0], way[:, 1])
        share = self._shares[leg]
        share = share + (1 - share) * np.clip((barrier - progress) / reach, 0, 1)
        speed = np.where(arrived, 0.0, speed * share)
        rate: Float = np.zeros(self._count)
        if self._smooth:
            turn = wrap(line.headings[segment] - line.headings[line.at(progress)[2]])
            strafes = np.any(self._facings[leg] != 0, axis=1)
            rate = np.where(strafes, 0.0, turn / reach * speed)
            # The chord to the aim has turned half as far as the way there does.
            way = directions_to_world(way[:, None], turn * (lag / self._lookahead - 0.5))[:, 0]
            # Inside of a tight bend the nearest point can stop: the aim stays ahead all the same.
            push = np.where(arrived, 0.0, np.clip(reach / 2 - distance, 0, None))
            self._progress = np.minimum(progress + push, self._marks[leg])
        velocity = way * (speed / np.maximum(distance, 1e-6))[:, None]
        command = from_velocity(velocity, self._facings[leg], last_yaw=last, turn_rate=rate)
        command.crouch[:] = self._crouches[leg]
        return command, bool(arrived.all())

    def _advance(self, positions: NDArray) -> NDArray[np.bool_]:
        """Move progress and legs on to where the characters are; which have arrived, bool [N]."""
        mark = np.where(self._leg < self._last, self._marks[self._leg], self._progress)
        here, direction, _ = self._line.at(self._progress)
        # At the nearest point the rest is perpendicular to the way: one Newton step a frame.
        along = np.einsum("nc,nc->n", positions - here, direction)
        progress = np.clip(self._progress + along, self._progress, mark)
        left = positions - self._line.at(mark)[0]
        reached = (np.hypot(left[:, 0], left[:, 1]) < self._radii[self._leg]) | (progress >= mark - 1e-6)
        self._progress = np.where(reached, mark, progress)
        self._leg = np.minimum(self._leg + reached, self._last)
        return self._leg >= self._last


def _corner_shares(course: Course, line: Polyline) -> Float:
    """Share of the speed left at each leg's end: all where it goes straight on, none at an open way's end."""
    legs = len(course.waypoints) - (not course.closed)
    shares = np.ones(legs)
    if not course.smooth:
        turn = np.abs(wrap(np.roll(line.headings, -1) - line.headings))
        sharp = np.clip((turn - np.pi / 4) / (3 * np.pi / 4), 0, 1)
        shares = 1 - (1 - course.corner_speed) * sharp
    if not course.closed:
        shares[-1] = 0
    return shares


class _Script:
    """Plays the keys of a stick or of a velocity."""

    path = None

    def __init__(self, course: Course, shares: Float) -> None:
        assert course.seconds is not None  # scripts have a length
        self._course, self._count = course, len(shares)
        self._seconds, self.nominal = course.seconds, course.seconds * course.laps
        self._offsets = shares % 1 * self._seconds
        keys = course.script()
        self._sticks = bool(keys)
        self._times = np.array([k.time for k in keys or course.velocity])
        self._crouches = np.array([k.gait == "crouch" for k in keys or course.velocity])
        if keys:
            self._values = np.array([k.move for k in keys])
            self._cameras, self._rates = _cameras(keys)
            self._strafes = np.array([k.strafe for k in keys])
            self._runs = np.array([k.gait == "run" for k in keys], np.float64)
            self._gaits = _blended(self._runs, self._times)
        else:
            self._values = np.array([k.velocity for k in course.velocity])
            self._facings = np.array([k.facing or (0.0, 0.0) for k in course.velocity])

    def reset(self) -> tuple[Float, Float]:
        return np.zeros((self._count, 2)), np.zeros(self._count)

    def remember(self) -> Any:
        return None  # all follows from the time

    def recall(self, remembered: Any) -> None:
        pass

    def laps(self, time: float) -> Float:
        return np.full(self._count, time / self._seconds)

    def command(
        self, time: float, positions: NDArray, yaws: NDArray, last: NDArray, lag: Float
    ) -> tuple[Command, bool]:
        time = min(time, self.nominal - 1e-6)  # whoever asks later gets what was asked last
        clock = (time + self._offsets) % self._seconds
        key = np.searchsorted(self._times, clock + 1e-9, side="right") - 1
        since = clock - self._times[key]
        values = self._values[key]
        if self._course.interpolate == "linear":
            after = np.minimum(key + 1, len(self._times) - 1)
            span = np.maximum(self._times[after] - self._times[key], 1e-9)
            values = values + (self._values[after] - values) * np.clip(since / span, 0, 1)[:, None]
        if not self._sticks:
            command = from_velocity(values, self._facings[key], last_yaw=last)
            command.crouch[:] = self._crouches[key]
            return command, False
        gait = self._runs[key] + (self._gaits[key] - self._runs[key]) * 0.5 ** (since / GAIT_HALFLIFE)
        command = from_stick(
            values,
            self._cameras[key] + self._rates[key] * since,
            yaw=yaws,
            last_yaw=last,
            camera_rate=self._rates[key],
            strafe=self._strafes[key],
            gait=gait,
            speeds=self._course.speeds,
            deadzone=0.0,
        )
        command.crouch[:] = self._crouches[key]
        return command, False


def _cameras(keys: tuple[StickKey, ...]) -> tuple[Float, Float]:
    """Where the camera looks at each key, and how fast it turns from there, radians."""
    rates = np.radians([k.camera_rate_deg for k in keys])
    yaws = np.zeros(len(keys))
    for i, key in enumerate(keys):
        if key.camera_deg is not None:
            yaws[i] = np.radians(key.camera_deg)
        elif i:
            yaws[i] = yaws[i - 1] + rates[i - 1] * (key.time - keys[i - 1].time)
    return yaws, rates


def _blended(targets: Float, times: Float) -> Float:
    """Share of running at each key, which lags behind its target by `GAIT_HALFLIFE`."""
    shares = targets[:1].repeat(len(targets))
    for i in range(1, len(targets)):
        left = 0.5 ** ((times[i] - times[i - 1]) / GAIT_HALFLIFE)
        shares[i] = targets[i - 1] + (shares[i - 1] - targets[i - 1]) * left
    return shares
