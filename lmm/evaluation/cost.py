"""What a frame of a network of locomotion costs: operations counted, and time measured."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from lmm import models
from lmm.locomotion.model import LocomotionModel
from lmm.mann.model import MannModel
from mm import queries, recording
from mm.database import Database
from mm.driving import Clock
from motion import console

SECONDS = 5.0


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
    """A row a way to run a network, one character under random commands.

    operations; frame_us and network_us, medians of a whole step and of the network's share of it; memory_mb,
    all that the system holds; ns_per_operation, network_us by operations.
    """
    counted, rows = of_model(model), []
    course = queries.random_user(database, seconds, seed=seed)
    for make in models.controllers(model).values():
        system = make(count=1)
        clock = Clock(course, system.count, system.fps)
        whole, stages = (
            recording.record(system, course, seconds=seconds, driver=clock, progress=console.silent)
            for system.timed in (False, True)
        )
        network = stages.stage_seconds[:, stages.stages.index("network")]
        rows.append(
            {
                "system": system.name,
                "operations": counted,
                "frame_us": float(1e6 * np.median(whole.step_seconds)),
                "network_us": float(1e6 * np.median(network)),
                "ns_per_operation": float(1e9 * np.median(network) / counted),
                "memory_mb": sum(system.memory().values()) / 1e6,
            }
        )
    return rows
