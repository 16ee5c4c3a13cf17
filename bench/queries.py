"""The searches that a controller really makes: recorded while a random user drives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import course as courses
from mm import speeds
from mm.controller import Controller
from mm.database import Database
from mm.driver import Driver
from mm.settings import Settings
from motion import quat

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
    walk, run = speeds.of_database(database)
    way = courses.load(course)
    driver = Driver(
        way.scaled(walk=walk, run=run) if walk > 0 else way, CHARACTERS, database.fps, spread=True
    )
    controller.reset(driver.starts, driver.yaws)
    positions, yaws = driver.starts, driver.yaws
    made, frame = 0, 0
    while made < count:
        command = driver.command(frame / database.fps, positions, yaws)
        before = len(listener.asked)
        poses = controller.step(command)
        positions, yaws = poses.positions[:, 0, [0, 2]], quat.yaw(poses.rotations[:, 0])
        made += sum(len(queries) for queries, _, _ in listener.asked[before:])
        frame += 1
    features, current, bound = (np.concatenate(part)[:count] for part in zip(*listener.asked, strict=True))
    return Queries(features, current, bound, round(settings.ignore_radius * database.fps))
