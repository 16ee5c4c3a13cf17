"""What a frame of a network of locomotion costs: operations counted, and time measured, beside the learned
motion matching that ships."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from lmm import models
from lmm.controller import controller
from lmm.locomotion.model import LocomotionModel
from lmm.mann.model import MannModel
from lmm.model import Model
from mm import queries, recording
from mm.course import Course
from mm.database import Database
from mm.driving import Clock
from motion import console

SECONDS, REPEATS = 5.0, 3
SHIPS = "dancecard"


def operations(sizes: Sequence[int]) -> int:
    """The thesis's number of computations of a network of these widths, its inputs' first.

    Its formula 6.1 is the sum of n_l (1 + n_l+1) over all layers l but the last. Its Table 6.1, 335,501 for
    342-512-311, counts the nodes of the last layer, too, and so does this. What makes the weights of a phase
    or of experts is not counted.
    """
    return sum(here * (1 + after) for here, after in pairwise(sizes)) + sizes[-1]


def of_model(model: LocomotionModel) -> int:
    """`operations` of a model's network, and of the gate where it has one."""
    gate = operations(model.network.gate_sizes) if isinstance(model, MannModel) else 0
    return operations(model.network.sizes) + gate


def costs(
    model: LocomotionModel, database: Database, *, seconds: float = SECONDS, seed: int = 1
) -> list[dict[str, Any]]:
    """A row a way to run a network, one character under random commands, and one of `SHIPS` under the same.

    operations; frame_us and mean_us of a step, of each the fastest of some runs: median, and mean, since
    learned motion matching searches in some frames only; of_lmm, mean_us by that of `SHIPS`; network_us, the
    network's share of a step, median; ns_per_operation, it by operations; memory_mb, all that is held.
    """
    counted, course = of_model(model), queries.random_user(database, seconds, seed=seed)
    rows = []
    for make in models.controllers(model).values():
        system = make(count=1)
        row = _measured(system, course, seconds)
        system.timed = True
        stages = _record(system, course, seconds)
        network = float(np.median(stages.stage_seconds[:, stages.stages.index("network")]))
        own = {"network_us": 1e6 * network, "ns_per_operation": 1e9 * network / counted}
        rows.append(row | {"operations": counted} | own)
    ships = models.load(SHIPS)
    assert isinstance(ships, Model)
    rows.append(_measured(controller(ships, name=f"lmm ({SHIPS})"), course, seconds))
    return [row | {"of_lmm": row["mean_us"] / rows[-1]["mean_us"]} for row in rows]


def _measured(system: Any, course: Course, seconds: float) -> dict[str, Any]:
    """What any system costs."""
    runs = [_record(system, course, seconds).step_seconds for _ in range(REPEATS)]
    steps = 1e6 * np.min(runs, axis=0)  # every time the same is done, and other things that the machine does
    return {
        "system": system.name,
        "frame_us": float(np.median(steps)),
        "mean_us": float(steps.mean()),
        "memory_mb": sum(system.memory().values()) / 1e6,
    }


def _record(system: Any, course: Course, seconds: float) -> Any:
    clock = Clock(course, system.count, system.fps)
    return recording.record(system, course, seconds=seconds, driver=clock, progress=console.silent)
