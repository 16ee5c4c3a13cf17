"""The built-in data: a seeded generator of human locomotion, danced after a card of moves.

Everything follows from the way of the body: footsteps are placed where it will be, feet roll over heel and
ball between them, the pelvis rides as high as the legs let it, the legs close the gap, and trunk and arms
move against the legs. Step rates, stances and excursions are published ones (`gait`); no captured motion is
in it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .card import passages
from .dance import FPS, Passage, perform
from .figure import FIGURE
from .labels import CONTACTS, GAITS, Labels
from .path import Move, length
from .style import Style

__all__ = [
    "CONTACTS",
    "FIGURE",
    "FPS",
    "GAITS",
    "Labels",
    "Move",
    "Passage",
    "Style",
    "dances",
    "generate",
    "names",
    "perform",
]

SECONDS = 600.0  # one round of the card


def generate(seconds: float = SECONDS, *, seed: int = 0) -> list[Passage]:
    """All passages of `dances` at once: about 0.4 GB an hour."""
    return list(dances(seconds, seed=seed))


def dances(seconds: float = SECONDS, *, seed: int = 0) -> Iterator[Passage]:
    """Dance the card for some time: passages of half a minute, the last one as long as time is left.

    The same seed gives the same motion; a longer dance begins with the shorter one. Every passage is danced
    in another style. seconds must be positive.
    """
    if not 0 < seconds < np.inf:
        raise ValueError(f"{seconds} seconds: expected a positive number")
    left = max(1, round(seconds * FPS))
    for number, (name, moves) in enumerate(_card(left, seed)):
        rng = np.random.default_rng([seed, 1, number])
        passage = perform(moves, name=name, style=Style.random(rng), rng=rng)
        yield _first(passage, left)
        left -= len(passage.clip)


def names(seconds: float = SECONDS, *, seed: int = 0) -> list[str]:
    """The names of the passages of `dances`, without dancing."""
    return [name for name, _ in _card(max(1, round(seconds * FPS)), seed)]


def _card(frames: int, seed: int) -> Iterator[tuple[str, list[Move]]]:
    """Name and moves of the passages that fill a number of frames."""
    for name, moves in passages(np.random.default_rng([seed, 0])):
        yield name, moves
        frames -= length(moves, FPS)
        if frames <= 0:
            return


def _first(passage: Passage, frames: int) -> Passage:
    """No more than the first frames of a passage."""
    if len(passage.clip) <= frames:
        return passage
    clip = passage.clip
    clip = clip.replace(positions=clip.positions[:frames], rotations=clip.rotations[:frames])
    return Passage(clip, passage.labels[:frames], passage.path)
