"""What is drawn about a character on request: functions of what is known of it at an instant.

Each gives layers of the scene by name, in the world that the character walks in; none where what it draws is
not recorded. A stage puts them where the character stands (`placed`).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..explain import Explanation
from ..scene import Layer
from . import candidates, contacts, features, terrain, trajectory
from .moment import Moment
from .placing import placed

Drawn = Mapping[str, Layer]

DRAWN: dict[str, tuple[str, Callable[[Moment], Drawn]]] = {
    "trajectory": (
        "what is asked (orange) and predicted (violet), with facings",
        trajectory.asked_and_predicted,
    ),
    "match": ("the way of the frame that plays", trajectory.of_match),
    "features": (
        "the last search's query against what it was answered by, joint for joint",
        features.compared,
    ),
    "contacts": ("feet that touch, and feet that are held", contacts.touching),
    "candidates": ("what the last search might have chosen, green to red by cost", candidates.ways),
    "boxes": ("the boxes of 16 frames around them, as a search tells them apart", candidates.boxes),
    "samples": ("where the ground's height is asked for", terrain.samples),
}

OF_SEARCH = ("features", "candidates", "boxes")  # those that stay as they are until the next search


def drawn(moment: Moment, names: Sequence[str]) -> dict[str, Layer]:
    """The layers of some of `DRAWN` at a moment, by name."""
    found: dict[str, Layer] = {}
    for name in names:
        found |= {f"{name} {part}": layer for part, layer in DRAWN[name][1](moment).items()}
    return found


class Drawing:
    """Some of `DRAWN`, moment by moment: what is of a search is made once, and given again until the next."""

    def __init__(self, names: Sequence[str]) -> None:
        self._moving = [name for name in names if name not in OF_SEARCH]
        self._standing = [name for name in names if name in OF_SEARCH]
        self._search: tuple[dict[str, NDArray], Explanation | None] = {}, None
        self._stood: dict[str, Layer] = {}

    def at(self, moment: Moment) -> dict[str, Layer]:
        """The layers at a moment, by name; those that are the same objects as before are unchanged."""
        found = drawn(moment, self._moving)
        if self._standing:
            record = {} if moment.search is None else moment.search[0]
            explanation = moment.explanation if {"candidates", "boxes"} & {*self._standing} else None
            if explanation is not self._search[1] or not _same(record, self._search[0]):
                self._stood = drawn(moment, self._standing)
                self._search = record, explanation
            found |= self._stood
        return found


def _same(one: Mapping[str, NDArray], other: Mapping[str, NDArray]) -> bool:
    return one.keys() == other.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f") for name in one
    )


__all__ = ["DRAWN", "Drawing", "Drawn", "Moment", "drawn", "placed"]
