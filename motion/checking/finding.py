"""What a check says about a clip, and the bookkeeping of frames that all detectors share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Finding:
    """A defect of a clip, at frames [start, stop) of the clip as it was read.

    Attributes
    ----------
    kind : one of `KINDS`.
    start, stop : the frames concerned; 0 and the clip's length if all are.
    what : a line for a person, with numbers.
    fatal : whether these frames should be left out of what is made from the clip.
    """

    kind: str
    start: int
    stop: int
    what: str
    fatal: bool


KINDS = {
    "not finite": "values that are no numbers, or beyond any size",
    "axes": "another axis than y points up",
    "rate": "speeds, step times or falls that no body has: the frame rate is wrong",
    "sides": "left and right, or front and back, are swapped",
    "ground": "the clip stands far below or above y = 0, or parts of it under its own ground",
    "floating": "moves through the air, neither held by anything nor falling",
    "rest pose": "a pose for tools, inserted into the capture",
    "teleport": "the body is elsewhere from one frame to the next, at a speed that nobody reaches",
    "jump": "the body is elsewhere from one frame to the next, by more than any jolt explains",
    "flip": "a joint turns abruptly, as no joint does",
    "stretch": "a limb changes its length",
    "frozen": "nothing moves for a while",
    "repeated": "frames that repeat the one before, while the body moves",
}
"""Kind of finding to what it means."""


def spans(flags: NDArray, *, gap: int = 0) -> list[tuple[int, int]]:
    """Ranges [start, stop) where flags [T] are true; those at most gap false ones apart are joined."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, np.int8), [0]])))
    found: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and start - found[-1][1] <= gap:
            found[-1] = (found[-1][0], stop)
        else:
            found.append((start, stop))
    return found


def between_steps(bad: NDArray, *, gap: int) -> list[tuple[int, int]]:
    """Frames [start, stop) that the bad ones of the steps [T-1] between T frames concern.

    Bad steps at most gap apart lead to frames and back from them: the frames between the first and the last
    are meant. A single one is blamed on the frame that it leads to. What a bad step parts from the clip's
    first or last gap frames is too short to be anything by itself, and counts as bad with it.
    """
    frames = len(bad) + 1
    found = []
    for first, stop in spans(bad, gap=gap):
        start, last = first + 1, max(stop, first + 2)
        if first < gap:
            start, last = 0, stop
        elif frames - stop <= gap:
            last = frames
        found.append((start, last))
    return found


def some(items: Iterable[str], most: int = 3) -> str:
    """Items for a line, the first of them where they are many."""
    listed = list(dict.fromkeys(items))
    return ", ".join(listed[:most]) + f" and {len(listed) - most} more" * (len(listed) > most)
