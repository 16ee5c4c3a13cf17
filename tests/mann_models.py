"""Small mode-adaptive networks of random numbers, on a database of synthetic walking."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pfnn_models

from lmm.mann.layout import FORWARD, UP, Layout
from lmm.mann.model import MannModel, end_effectors
from lmm.mann.network import MannNetwork
from mm.description import Description

GATE = 12  # width of the gate's hidden layers
# Forward and up without a direction: nothing, one alone, along each other.
NOWHERE = [0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 1, 0], [0, 1, 0, 0, 1, 0], [1, 1, 0, -1, -1, 0]


def network(*sizes: int, experts: int = 4, columns: np.ndarray | None = None, seed: int = 0) -> MannNetwork:
    """A network whose experts differ and whose outputs are about as spread as its statistics say."""
    rng = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    pairs = list(pairwise(sizes))
    columns = np.arange(0, sizes[0], 2) if columns is None else columns
    gate = list(pairwise((len(columns), GATE, GATE, experts)))
    return MannNetwork(
        input_mean=numbers(sizes[0]),
        input_std=np.exp(numbers(sizes[0]) / 4),
        output_mean=numbers(sizes[-1]),
        output_std=np.exp(numbers(sizes[-1]) / 4),
        weights=tuple(numbers(experts, rows, outs) / np.float32(np.sqrt(rows)) for rows, outs in pairs),
        biases=tuple(numbers(experts, outs) / 10 for _, outs in pairs),
        gate_columns=columns.astype(np.int64),
        gate_weights=tuple(numbers(rows, outs) * np.float32(2 / np.sqrt(rows)) for rows, outs in gate),
        gate_biases=tuple(numbers(outs) / 10 for _, outs in gate),
    )


def model(
    *,
    seed: int = 0,
    spread: float = 0.02,
    fps: float = 60.0,
    experts: int = 4,
    found: Description | None = None,
) -> MannModel:
    """A model whose outputs are about a standing pose, by so much."""
    found = found or pfnn_models.description(fps)
    contacts = found.contact_roles
    layout = Layout(len(found.skeleton) - 1, len(contacts))
    columns = layout.gate_columns(end_effectors(found))
    made = network(layout.input_size, 24, 24, layout.output_size, experts=experts, columns=columns, seed=seed)
    axes = np.tile(np.concatenate([FORWARD, UP]), layout.joints)
    return MannModel(found, pfnn_models.standing(made, layout, found, spread, rotations=axes), contacts)
