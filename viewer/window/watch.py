"""How long the window's frames take, as a panel tells it."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..panel import Row, Told

KEPT = 240  # frames
_TOP = 33.0  # ms: two frames at 60 a second


class Watch:
    """Looks at a clock in every frame.

    Attributes
    ----------
    frames : seconds from each frame to the next, of the last ones.
    work : seconds of them in which the window worked; in the others it was drawn, or waited.
    """

    def __init__(self) -> None:
        self.frames: deque[float] = deque(maxlen=KEPT)
        self.work: deque[float] = deque(maxlen=KEPT)
        self._before: float | None = None

    def take(self, begin: float, end: float) -> None:
        """A frame's work, from a time to another."""
        if self._before is not None:
            self.frames.append(begin - self._before)
        self.work.append(end - begin)
        self._before = begin

    def told(self) -> Told:
        rows = []
        for name, seconds in (("frame", self.frames), ("work", self.work)):
            ms = 1e3 * np.array(seconds)
            middle = f"{np.median(ms):.1f} ms" if len(ms) else "-"
            rows.append(Row(name, middle, ms, None, max(_TOP, float(np.max(ms, initial=0.0)))))
        return Told("window", rows)
