"""A session in a thread of its own, so that a window never waits for it long.

A budget alone would not do: it is looked at between steps, and one search of a large database, or one step
beside a training that takes all cores, may last longer than many frames of the screen. Steps are compiled and
let go of the interpreter's lock, so that a window draws meanwhile. The window asks once a frame, and waits a
few milliseconds for the answer, which is there in time but for such steps; then it shows what there was.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, Protocol

from .session import Look

PATIENCE = 0.008  # seconds that a frame waits: half of one at 60 a second
BUDGET = 0.05  # seconds of steps at once: a machine too slow for its systems runs them at its own pace


class Played(Protocol):
    """What is let go by: a `viewer.session.Session`, or a `viewer.replay.Replay`."""

    def advance(self, real_seconds: float, *, budget: float) -> None: ...

    def look(self) -> Look: ...


class Live:
    """Lets a session's time go by in a thread.

    look : what the last frame showed.
    late : frames that were shown what there was, since a step was not done in time.
    """

    def __init__(self, session: Played, *, patience: float = PATIENCE, budget: float = BUDGET) -> None:
        self._session, self._patience, self._budget = session, patience, budget
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="session")
        self._owed = 0.0
        self._wishes: list[Callable[[Any], Any]] = []
        self._work: Future[Look] | None = None
        self.look = session.look()
        self.late = 0

    def frame(self, real_seconds: float) -> Look:
        """What to show after so much real time since the last frame.

        What a step raises that is no fault of one system's is raised here.
        """
        self._owed += real_seconds
        if self._work is None:
            work, self._wishes = self._wishes, []
            owed, self._owed = self._owed, 0.0
            self._work = self._pool.submit(self._advance, work, owed)
        wait([self._work], timeout=self._patience)
        if not self._work.done():
            self.late += 1
            return self.look
        done, self._work = self._work, None
        self.look = done.result()
        return self.look

    def do(self, wish: Callable[[Any], Any]) -> None:
        """Have something done to the session before its time goes on: a reset, other settings, a pause."""
        self._wishes.append(wish)

    def close(self) -> None:
        """End the thread, when it has done what it does."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _advance(self, wishes: list[Callable[[Any], Any]], seconds: float) -> Look:
        for wish in wishes:
            wish(self._session)
        self._session.advance(seconds, budget=self._budget)
        return self._session.look()
