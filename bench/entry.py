"""What a system to compare is: a name, what makes it, and what it is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm.control import System
from mm.database import Database
from motion.pose import Poses

Decoder = Callable[[Database, NDArray[np.int32]], Poses]  # what a system shows of frames [N] of a database


class Factory(Protocol):
    """Builds a system of count characters that keep off obstacles [M, 5] (see `mm.controller`)."""

    def __call__(self, database: Any, count: int, *, obstacles: ArrayLike = ()) -> System: ...


def as_stored(database: Database, frames: NDArray[np.int32]) -> Poses:
    """The poses of frames [N] as the database has them."""
    return database.poses[frames]


@dataclass(frozen=True)
class Entry:
    """A named way to make a system of N characters from a database; family: the name up to the first dash.

    locked : whether it holds the feet, which takes whole legs. spare : whether it stands for a locked one
    where legs are not whole, and elsewhere comes by its name or a pattern alone. asked : whether it comes by
    its name or a pattern alone everywhere.
    decoder : how its Decompression makes poses of frames, of all that make them alike the same object; None
    where it has no such stage. source : the model or the codec that it is made of, by name. way, weights :
    how a model runs (letters of learned stages, or a network's mode), and what its weights are held as. alone
    : whether the source is all that it is made of, so that `make` takes None for a database. sees_ground :
    whether `make` takes a ground, too, for which its poses are made; other systems are put on it
    (`mm.grounded.on_ground`). made_of : what it is of besides the database and this program, a fingerprint or
    a name; None where that is not known, and results of it are not kept (`bench.kept`).
    """

    name: str
    make: Factory
    about: str = ""
    locked: bool = False
    spare: bool = False
    asked: bool = False
    decoder: Decoder | None = as_stored
    source: str = ""
    way: str = ""
    weights: str | None = None
    alone: bool = False
    sees_ground: bool = False
    made_of: str | None = None

    @property
    def family(self) -> str:
        return self.name.split("-", 1)[0]


def called(name: str, locked: bool) -> str:
    """The name of a system that holds the feet, or of the same one that does not."""
    return name if locked else f"{name}-free"
