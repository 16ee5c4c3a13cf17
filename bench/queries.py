"""The searches that a controller really makes: recorded while a random user drives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import course as courses
from mm.controller import Controller
from mm.database import Database
from mm.settings import Settings

from .driving import Clock, at_data_speeds, drive

CHARACTERS = 8


@dataclass(eq=False)
class Queries:
    """M searches as a controller made them.

    features [M, F] normalised; current int32 [M], the frames that played; bound [M], what playing on would
    have cost (infinite where a clip ended); radius of the frames around the current one that are left out.
    """

    features: NDArray[np.float32]
    current: NDArray[np.int32]
    bound: NDArray[np.float32]
    radius: int

    def __len__(self) -> int:
        return len(self.features)


class _Listener:
    """A projection that writes down what it is asked."""

    def __init__(self, projection: Any) -> None:
        self._projection = projection
        self.asked: list[tuple[NDArray, NDArray, NDArray]] = []

    def project(
        self, queries: NDArray, state: Any, bound: NDArray, required_tags: NDArray, forbidden_tags: NDArray
    ) -> Any:
        self.asked.append((queries.copy(), state.frames().copy(), np.array(bound, np.float32)))
        return self._projection.project(queries, state, bound, required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self._projection.memory()


def record(database: Database, count: int = 1000, *, index: str = "exact", course: str = "random") -> Queries:
    """The first count searches of eight characters spread over a course, at the speeds of the data."""
    settings = Settings()
    controller = Controller(database, count=CHARACTERS, settings=settings, index=index)
    controller.stages.projection = listener = _Listener(controller.stages.projection)
    clock = Clock(at_data_speeds(courses.load(course), database), CHARACTERS, database.fps, spread=True)
    steps = drive(controller, clock)
    while sum(len(queries) for queries, _, _ in listener.asked) < count:
        next(steps)
    features, current, bound = (np.concatenate(part)[:count] for part in zip(*listener.asked, strict=True))
    return Queries(features, current, bound, round(settings.ignore_radius * database.fps))
