"""Systems that are driven side by side by one user, and the clock that they are stepped by.

Each system is stepped at its own rate; what is shown lies between its last two steps, so that motion is right
at any rate of the screen. A session does all of it when it is told how much time went by, and is as
deterministic as its systems: pictures and films are made so. A window keeps one in a thread (`viewer.live`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm import recording
from mm.control import Command, Resumable, System
from motion import quat
from motion.errors import UserError
from motion.pose import Poses

from .timeline import EXACTLY, SECONDS, Instant, Timeline

_PARTS = tuple(part.name for part in fields(Command))
MOST = 0.5  # seconds of real time that are made up for at once: a window that was dragged is no fast-forward


class Pilot(Protocol):
    """Who commands N characters: a user (`viewer.controls`), a course (`mm.driver`), an earlier run."""

    starts: NDArray[np.float32]
    yaws: NDArray[np.float32]

    def reset(self) -> None:
        """Begin again."""
        ...

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        """What the characters at positions [N, 2], facing yaws [N], are asked at a time (seconds, rising)."""
        ...

    def remember(self) -> Any:
        """What the next command depends on, for `recall`."""
        ...

    def recall(self, remembered: Any) -> None: ...


class _Piloting(NamedTuple):
    """A pilot, since when it commanded, and what it remembered."""

    pilot: Pilot
    since: float
    remembered: Any


@dataclass(eq=False)
class Actor:
    """One system of a session, with one character.

    Attributes
    ----------
    timeline : what it did; its last step is where it is.
    resumable : the system, where it can go back.
    memories : step, where it was then, and its pilot; as far as the timeline goes.
    error : what ended it, until it is reset.
    """

    name: str
    system: System
    timeline: Timeline
    memories: deque[tuple[int, Any, _Piloting]]
    resumable: Resumable | None = None
    error: str | None = None

    @property
    def time(self) -> float:
        """When its last step is, seconds."""
        return self.timeline.end


@dataclass(frozen=True, eq=False)
class Look:
    """What a session shows.

    Attributes
    ----------
    time : of what is shown, seconds; live: whether that is the present.
    actors : by name, each at that time.
    errors : by name, why it stands still.
    """

    time: float
    live: bool
    actors: Mapping[str, Instant]
    errors: Mapping[str, str]


class Session:
    """Systems of one character each, by name, under one pilot.

    Parameters
    ----------
    systems : what moves; the first one is whom a camera follows.
    pilot : commands all of them, a row each.
    seconds : how long what they did is remembered.
    clock : gives the real time, seconds, for what steps take and for budgets.

    Attributes
    ----------
    speed : seconds that go by for each real one: 0.1 is slow motion.
    paused : whether none go by.
    time : the present, seconds since the beginning.
    shown : the time that is looked at, None for the present.
    dropped : real seconds that were not made up for, since the machine was too slow.
    """

    def __init__(
        self,
        systems: Mapping[str, System],
        pilot: Pilot,
        *,
        seconds: float = SECONDS,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if not systems:
            raise ValueError("a session of no systems")
        self.speed, self.paused, self.time, self.dropped = 1.0, False, 0.0, 0.0
        self.shown: float | None = None
        self._clock = clock
        self._seconds = seconds
        self.actors = {name: self._actor(name, system) for name, system in systems.items()}
        self.take_pilot(pilot)
        self.reset()

    def _actor(self, name: str, system: System, *, start: int = 0) -> Actor:
        if system.count != 1:
            raise ValueError(f"{name} drives {system.count} characters, expected 1")
        timeline = Timeline(system.skeleton, system.fps, seconds=self._seconds, start=start)
        actor = Actor(name, system, timeline, deque(maxlen=timeline.kept))
        self._take_system(actor, system)
        return actor

    def take_pilot(self, pilot: Pilot) -> None:
        """Be commanded by another pilot, whose time begins now, wherever the characters are."""
        self.pilot, self._since = pilot, self.time
        self._asked: tuple[float, Command] | None = None

    # Time

    def advance(self, real_seconds: float, *, budget: float = np.inf) -> None:
        """Let real time go by: step who is due, in the order of time.

        A step is as long as it is, however slow the machine. What cannot be done within the budget (real
        seconds, looked at between steps) is dropped, and all wait for the slowest: a session that lags
        behind does not try to catch up.
        """
        if self.paused or real_seconds <= 0:
            return
        real = min(real_seconds, MOST)
        self.dropped += real_seconds - real
        target, late = self.time + real * self.speed, self._clock() + budget
        while (actor := self._due(target)) is not None:
            if self._clock() >= late:
                reached = max(self.time, actor.time)
                self.dropped += (target - reached) / self.speed
                target = reached
                break
            self._step(actor)
        self.time = target

    def single_step(self, *, back: bool = False) -> None:
        """Pause, and go on to the next moment at which a system has a step, or back to the last one.

        In what is remembered that is a look; at the present a step is made.
        """
        self.paused = True
        if self.shown is None and not back:
            self.time = self._moment(self.time)
            while (due := self._due(self.time)) is not None:
                self._step(due)
            return
        moment = self._moment(self.time if self.shown is None else self.shown, back=back)
        self.shown = max(moment, self.begin) if moment < self.time - EXACTLY else None

    def _moment(self, now: float, *, back: bool = False) -> float:
        """When the next step of any system is, or when the last one was, seconds."""
        moments = []
        for actor in self.actors.values():
            steps = now * actor.system.fps
            step = np.ceil(steps - EXACTLY) - 1 if back else np.floor(steps + EXACTLY) + 1
            moments.append(float(step) / actor.system.fps)
        return max(moments) if back else min(moments)

    def _due(self, now: float) -> Actor | None:
        """Who is least far, of those whose last step is before a time."""
        actor = min(self.actors.values(), key=lambda each: each.time)
        return actor if actor.time < now - EXACTLY / actor.system.fps else None

    def _step(self, actor: Actor) -> None:
        if actor.error is None:
            which = list(self.actors).index(actor.name)
            asked = self._command(actor.time)
            command = Command(*(getattr(asked, part)[which : which + 1] for part in _PARTS))
            start = self._clock()
            try:
                poses = actor.system.step(command)
            except UserError as error:  # numbers that run away, tags that no frame bears: the others go on
                actor.error = str(error)
            else:
                self._keep(actor, command, poses, seconds=self._clock() - start)
                return
        self._hold(actor)

    def _hold(self, actor: Actor) -> None:
        """A step in which nothing happens."""
        actor.timeline.hold()
        if actor.memories:
            actor.memories.append((actor.timeline.last, *actor.memories[-1][1:]))

    def _command(self, now: float) -> Command:
        """What all are asked at a time; who steps at the same time is asked the same."""
        if self._asked is None or self._asked[0] != now:
            positions, yaws = self.places()
            self._asked = now, self.pilot.command(now - self._since, positions, yaws)
        return self._asked[1]

    def _keep(self, actor: Actor, command: Command, poses: Poses, **how: Any) -> None:
        actor.timeline.append(recording.step(actor.system, command, poses), **how)
        if actor.resumable is not None:
            piloting = _Piloting(self.pilot, self._since, self.pilot.remember())
            actor.memories.append((actor.timeline.last, actor.resumable.remember(), piloting))

    # Places

    def places(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where the characters are, x and z [N, 2], and how they face, [N], after their last steps."""
        positions, rotations = [], []
        for actor in self.actors.values():
            position, rotation = actor.timeline.root()
            positions.append(position)
            rotations.append(rotation)
        return np.array(positions, np.float32)[:, [0, 2]], quat.yaw(np.array(rotations, np.float32))

    def reset(self) -> None:
        """Put all where the pilot starts, at rest; what they did is remembered."""
        self.pilot.reset()
        self._put(list(self.actors.values()), self.pilot.starts, self.pilot.yaws)
        self.take_pilot(self.pilot)

    def teleport(self, positions: ArrayLike, yaws: ArrayLike, *, name: str | None = None) -> None:
        """Put one, or all by default, at positions [2] or [N, 2], facing yaws [] or [N], at rest."""
        who = [self.actors[name]] if name is not None else list(self.actors.values())
        self._put(who, positions, yaws)

    def _put(self, who: Sequence[Actor], positions: ArrayLike, yaws: ArrayLike) -> None:
        """Make steps that the last ones do not lead to, all at one time, and show them."""
        places = np.broadcast_to(np.asarray(positions, np.float32), (len(who), 2))
        facing = np.broadcast_to(np.asarray(yaws, np.float32), (len(who),))
        begin = max(actor.time for actor in who)
        for actor, place, yaw in zip(who, places, facing, strict=True):
            while len(actor.timeline) and actor.time < begin - EXACTLY / actor.system.fps:
                self._hold(actor)
            actor.system.reset(place[None], yaw[None])
            actor.error = None
            command = Command.still(1)
            command.yaw[:] = yaw
            record = actor.system.record()
            poses = Poses.empty(1, len(actor.system.skeleton))
            poses.positions[:], poses.rotations[:] = record["positions"], record["rotations"]
            self._keep(actor, command, poses, cut=True)
        self.time, self.shown, self._asked = max([self.time, *(actor.time for actor in who)]), None, None

    # Looking back

    def scrub(self, moment: float | None) -> None:
        """Look at a time that is remembered, and pause; None: at the present, and stay paused."""
        self.paused = True
        self.shown = None if moment is None else min(max(moment, self.begin), self.time)

    @property
    def begin(self) -> float:
        """The earliest time that is remembered of all."""
        return max(actor.timeline.begin for actor in self.actors.values())

    def look(self) -> Look:
        """What is shown now."""
        now = self.time if self.shown is None else self.shown
        return Look(
            now,
            self.shown is None,
            {name: actor.timeline.at(now) for name, actor in self.actors.items()},
            {name: actor.error for name, actor in self.actors.items() if actor.error},
        )

    @property
    def fixed(self) -> tuple[str, ...]:
        """Names of those who cannot go back: what stands around a controller may not."""
        return tuple(name for name, actor in self.actors.items() if actor.resumable is None)

    def resume(self) -> None:
        """Go on from the time that is looked at: what came after it is forgotten.

        Who cannot go back (`fixed`) is a UserError.
        """
        if self.shown is None:
            self.paused = False
            return
        if self.fixed:
            remedy = "look back, and go on from the present"
            raise UserError(f"{', '.join(self.fixed)} cannot go back to an earlier time", remedy=remedy)
        last, self._since = -np.inf, self.shown
        for actor in self.actors.values():
            step = actor.timeline.step_at(self.shown)
            piloting, asked = self._go_back(actor, step), (step - 1) / actor.system.fps
            # Of several the one that was asked last; another pilot goes on as it is, from now.
            if piloting.pilot is self.pilot and asked > last:
                self.pilot.recall(piloting.remembered)
                last, self._since = asked, piloting.since
        self.time, self.shown, self.paused, self._asked = self.shown, None, False, None

    def _go_back(self, actor: Actor, step: int) -> _Piloting:
        assert actor.resumable is not None  # `resume` asks
        while actor.memories[-1][0] > step:
            actor.memories.pop()
        _, remembered, piloting = actor.memories[-1]
        actor.resumable.recall(remembered)
        actor.timeline.forget_after(step)
        actor.error = None
        return piloting

    # Changes

    def add(self, name: str, system: System, pilot: Pilot) -> None:
        """Take in another system, now, at the place of the first one; pilot commands all of them."""
        if name in self.actors:
            raise UserError(f"there is a {name} already", remedy="give it another name")
        positions, yaws = self.places()
        actor = self._actor(name, system, start=round(np.ceil(self.time * system.fps - EXACTLY)))
        self.actors[name] = actor
        self.take_pilot(pilot)
        self._put([actor], positions[0], yaws[0])

    def retune(self, name: str, settings: Any) -> None:
        """Let a system go on by other settings; those that it cannot take on its way are a UserError."""
        actor = self.actors[name]
        if actor.resumable is None:
            raise UserError(f"{name} keeps the settings that it was made with", remedy="make it anew")
        actor.resumable.retune(settings)
        self._tell_made(actor)

    def exchange(self, name: str, system: System) -> None:
        """Let another system, made alike but for its settings or weights, go on where one is."""
        actor, which = self.actors[name], list(self.actors).index(name)
        before = actor.resumable
        self._take_system(actor, system)
        if before is not None and actor.resumable is not None:
            actor.resumable.recall(before.remember())
        else:
            positions, yaws = self.places()
            self._put([actor], positions[which], yaws[which])

    def _take_system(self, actor: Actor, system: System) -> None:
        # Asking for the protocol takes longer than a step.
        actor.system, actor.resumable = system, system if isinstance(system, Resumable) else None
        self._tell_made(actor)

    def _tell_made(self, actor: Actor) -> None:
        system = actor.system
        actor.timeline.about = recording.about(system)
        actor.timeline.take_settings(getattr(system, "settings", None), getattr(system, "database", None))
