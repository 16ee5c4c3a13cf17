"""Clips and recorded runs as something to watch: played, paused and looked back in as a `Session` is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from motion.errors import UserError

from .cast import Member
from .session import MOST, Look
from .timeline import EXACTLY, Timeline


@dataclass(frozen=True)
class Part:
    """One who is replayed."""

    timeline: Timeline


class Replay:
    """What members did from a time to another, seconds, again and again; by default until the longest one
    ends. See `viewer.session.Session` for what its parts mean.

    What is shown is always a time that is remembered. Where nothing is between the times that is a UserError.
    """

    fixed: tuple[str, ...] = ()

    def __init__(self, members: Sequence[Member], start: float = 0.0, stop: float | None = None) -> None:
        if not members:
            raise ValueError("nothing to replay")
        self.speed, self.paused, self.dropped = 1.0, False, 0.0
        self.actors: Mapping[str, Part] = {each.name: Part(each.timeline) for each in members}
        end = max(each.timeline.end for each in members)
        self.begin, self.time = start, end if stop is None else min(stop, end)
        if start > self.time:
            what = f"nothing from {start:g} to {self.time:g} s"
            raise UserError(what, remedy=f"the longest lasts {end:.2f} s")
        self.shown = start

    def advance(self, real_seconds: float, *, budget: float = np.inf) -> None:
        """Let real time go by; after the end it begins again."""
        if not self.paused and real_seconds > 0:
            now = self.shown + min(real_seconds, MOST) * self.speed
            self.shown = now if now <= self.time else self.begin

    def single_step(self, *, back: bool = False) -> None:
        """Pause, and look at the next frame of any, or at the last one."""
        self.paused = True
        moments = []
        for actor in self.actors.values():
            steps, fps = self.shown * actor.timeline.fps, actor.timeline.fps
            step = np.ceil(steps - EXACTLY) - 1 if back else np.floor(steps + EXACTLY) + 1
            moments.append(float(step) / fps)
        self.scrub(max(moments) if back else min(moments))

    def scrub(self, moment: float | None) -> None:
        """Look at a time, and pause; None: at the end."""
        self.paused = True
        self.shown = self.time if moment is None else min(max(moment, self.begin), self.time)

    def resume(self) -> None:
        self.paused = False

    def reset(self) -> None:
        self.shown = self.begin

    def look(self) -> Look:
        return Look(
            self.shown, False, {name: each.timeline.at(self.shown) for name, each in self.actors.items()}, {}
        )
