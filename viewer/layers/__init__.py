"""What is drawn about a character on request: functions of what is known of it at an instant.

Each gives layers of the scene by name, in the world that the character walks in; none where what it draws is
not recorded. A stage puts them where the character stands (`placed`).
"""

from collections.abc import Callable, Mapping, Sequence

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


def drawn(moment: Moment, names: Sequence[str]) -> dict[str, Layer]:
    """The layers of some of `DRAWN` at a moment, by name."""
    found: dict[str, Layer] = {}
    for name in names:
        found |= {f"{name} {part}": layer for part, layer in DRAWN[name][1](moment).items()}
    return found


__all__ = ["DRAWN", "Drawn", "Moment", "drawn", "placed"]
