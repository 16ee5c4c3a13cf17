"""What is remembered of one character, step by step: the last minute of a live one, or all of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm.recording import Recording
from motion import quat
from motion.errors import UserError
from motion.skeleton import Skeleton

SECONDS = 60.0  # that are remembered of who is driven
EXACTLY = 1e-6  # of a step: what is nearer to one is at it

Pose = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Instant:
    """One character at an instant.

    Attributes
    ----------
    time : seconds since the beginning.
    step : the step that leads here: what `record` tells was decided in it.
    positions, rotations : float32 [J, 3] and [J, 4], local transforms, joint 0 in the world.
    record : what that step recorded by name, without the axis of characters (see `mm.recording`).
    """

    time: float
    step: int
    positions: NDArray[np.float32]
    rotations: NDArray[np.float32]
    record: Mapping[str, NDArray] = field(default_factory=dict)


class Timeline:
    """The steps of one character; step k is at k / fps seconds.

    Parameters
    ----------
    skeleton, fps : of the character.
    seconds : how long a step is remembered.
    start : number of the first step.
    about : what a `Recording` says of its system (`mm.recording.about`).

    Other threads may read while one appends: a step is written before it is counted.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        fps: float,
        *,
        seconds: float = SECONDS,
        start: int = 0,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        self.skeleton, self.fps, self.about = skeleton, fps, dict(about or {})
        self._start, self.last = start, start - 1
        self.kept = max(2, round(seconds * fps))  # steps; a row more is written in while others read
        self._arrays: dict[str, NDArray] = {}
        self._seconds = np.zeros(self.kept + 1)
        self._cuts = np.zeros(self.kept + 1, bool)
        self._made: list[tuple[int, Any, Any]] = []

    @staticmethod
    def of_recording(recording: Recording, character: int = 0) -> Timeline:
        """All of one character's run; one that is not there is a UserError."""
        if not 0 <= character < recording.count:
            remedy = f"the recording has {recording.count}, counted from 0"
            raise UserError(f"no character {character}", remedy=remedy)
        names = ("system", "skeleton", "settings", "schema", "database")
        about = {name: getattr(recording, name) for name in names}
        found = Timeline(recording.skeleton, recording.fps, seconds=recording.seconds, about=about)
        found._arrays = {name: array[:, character] for name, array in recording.arrays.items()}
        found._seconds[: len(recording)] = recording.step_seconds
        found.last = len(recording) - 1
        return found

    def __len__(self) -> int:
        """Steps that are remembered."""
        return self.last + 1 - self.first

    @property
    def first(self) -> int:
        """The first step that is remembered."""
        return max(self._start, self.last + 1 - self.kept)

    @property
    def begin(self) -> float:
        """Time of the first step remembered, seconds."""
        return self.first / self.fps

    @property
    def end(self) -> float:
        """Time of the last step, seconds."""
        return self.last / self.fps

    @property
    def names(self) -> tuple[str, ...]:
        """What is recorded."""
        return tuple(self._arrays)

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self._arrays.values())

    def append(self, arrays: Mapping[str, NDArray], *, seconds: float = 0.0, cut: bool = False) -> None:
        """Remember a step: arrays [1, ...] by name, how long it took, whether it is a cut."""
        step = self.last + 1
        row = step % (self.kept + 1)
        for name, array in arrays.items():
            if name not in self._arrays:
                # Memory that is never written is never used: a minute that is not lived costs nothing.
                self._arrays[name] = np.empty((self.kept + 1, *array.shape[1:]), array.dtype)
            self._arrays[name][row] = array[0]
        self._seconds[row], self._cuts[row] = seconds, cut
        self.last = step

    def hold(self) -> None:
        """Remember another step in which nothing happened."""
        still = {name: array[None] for name, array in self.record(self.last).items()}
        flags = ("searched", "forced", "transition")
        self.append({name: array & False if name in flags else array for name, array in still.items()})

    def root(self) -> Pose:
        """Position [3] and rotation [4] of the ground root after the last step."""
        row = self._row(self.last)
        return self._arrays["positions"][row, 0], self._arrays["rotations"][row, 0]

    def forget_after(self, step: int) -> None:
        """Go on from a step that is remembered: what came after it did not happen."""
        self.last = self._clip(step)
        self._made = [each for each in self._made if each[0] <= self.last + 1]

    def take_settings(self, settings: Any, data: Any = None) -> None:
        """Remember by what settings, and on what database, steps are made from the next one on."""
        now = self.last + 1
        # What was replaced before a step was made by it, or none is remembered that was, is forgotten.
        until = [*(since for since, *_ in self._made[1:]), now]
        made = zip(self._made, until, strict=False)
        kept = [each for each, end in made if end > max(each[0], self.first)]
        self._made = [*kept, (now, settings, data)]

    def made_by(self, step: int) -> tuple[Any, Any]:
        """The settings and the database that a step was made by; None where they are not known."""
        before = [each for since, *each in self._made if since <= step]
        return (before[-1][0], before[-1][1]) if before else (None, None)

    def step_at(self, time: float) -> int:
        """The step that leads to a time, of those remembered."""
        return self._clip(self.steps_around(time)[1])

    def steps_around(self, time: float) -> tuple[int, int]:
        """The last step until a time and the first one from it on, remembered or not; one at a step."""
        step = time * self.fps
        return int(np.floor(step + EXACTLY)), int(np.ceil(step - EXACTLY))

    def pose(self, time: float) -> Pose:
        """Local positions [J, 3] and rotations [J, 4] at a time, seconds; outside of what is remembered those
        at its ends."""
        step = self.step_at(time)
        share = 1 - (step - time * self.fps)
        if step == self.first or not 0 <= share < 1 - EXACTLY:
            return self._pose(step)
        cut = self._cuts[self._row(step)]
        return self._pose(step - 1) if cut else between(self._pose(step - 1), self._pose(step), share)

    def at(self, time: float) -> Instant:
        """The character at a time, seconds, as `pose` shows it."""
        step = self.step_at(time)
        return Instant(min(max(time, self.begin), self.end), step, *self.pose(time), self.record(step))

    def record(self, step: int) -> dict[str, NDArray]:
        """What a step recorded by name."""
        row = self._row(self._clip(step))
        return {name: array[row].copy() for name, array in self._arrays.items()}

    def stack(self, name: str, *, since: int = 0) -> NDArray:
        """An array of all steps remembered [T, ...], or of those since a step."""
        return self._in_order(self._arrays[name], since)

    def step_seconds(self, *, since: int = 0) -> NDArray[np.float64]:
        """Wall time of all steps remembered [T], or of those since a step."""
        return self._in_order(self._seconds, since)

    def cuts(self, *, since: int = 0) -> NDArray[np.bool_]:
        """Whether each step remembered [T] is a cut: the one before does not lead to it."""
        return self._in_order(self._cuts, since)

    def held(self, *, since: int = 0) -> Timeline:
        """What is remembered now, from a step on: a copy that stays as it is while another thread appends."""
        last = self.last
        steps = np.arange(max(since, self._start, last + 1 - self.kept), last + 1)
        found = Timeline(self.skeleton, self.fps, start=int(last + 1 - len(steps)), about=self.about)
        found.kept, found.last, found._made = max(len(steps), 1), last, list(self._made)
        here, there = steps % (self.kept + 1), steps % (found.kept + 1)

        def copied(array: NDArray) -> NDArray:
            copy = np.zeros((found.kept + 1, *array.shape[1:]), array.dtype)
            copy[there] = array[here]
            return copy

        found._arrays = {name: copied(array) for name, array in dict(self._arrays).items()}
        found._seconds, found._cuts = copied(self._seconds), copied(self._cuts)
        return found

    def recording(self) -> Recording:
        """What is remembered as a run: to be saved, or made into a clip."""
        now = self.held()
        return Recording(
            fps=self.fps,
            arrays={name: np.ascontiguousarray(now.stack(name)[:, None]) for name in now.names},
            step_seconds=now.step_seconds(),
            stage_seconds=np.zeros((len(now), 0)),
            **self.about,
        )

    def _clip(self, step: int) -> int:
        return min(max(step, self.first), self.last)

    def _pose(self, step: int) -> Pose:
        row = self._row(step)
        return self._arrays["positions"][row].copy(), self._arrays["rotations"][row].copy()

    def _row(self, step: int) -> int:
        return step % (self.kept + 1)

    def _in_order(self, array: NDArray, since: int = 0) -> NDArray:
        last = self.last
        start, stop = self._row(max(since, self.first)), self._row(last) + 1
        return array[start:stop].copy() if start < stop else np.concatenate([array[start:], array[:stop]])


def between(before: Pose, after: Pose, share: float) -> Pose:
    """A share of the way from a pose to the next, each local positions [..., 3] and rotations [..., 4]."""
    positions = before[0] + np.float32(share) * (after[0] - before[0])
    turned = np.sum(before[1] * after[1], axis=-1, keepdims=True)
    there = np.where(turned < 0, -after[1], after[1])
    # Steps are short: a straight line, made whole again, is within 0.01 degrees of the arc up to 20 degrees.
    rotations = quat.normalize(before[1] + np.float32(share) * (there - before[1]))
    return positions, rotations.astype(np.float32)
