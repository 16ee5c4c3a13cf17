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


def standing(found: Description, contacts: int) -> np.ndarray:
    """The outputs [O] of somebody who stands in the skeleton's rest pose, facing +Z."""
    layout = Layout(len(found.skeleton) - 1, contacts)
    out = np.zeros(layout.output_size, np.float32)
    world = found.skeleton.offsets.copy()
    for j in range(1, len(world)):
        world[j] += world[found.skeleton.parents[j]]
    out[layout.outputs["positions"]] = world[1:].ravel()
    out[layout.outputs["facing"].stop - 6 : layout.outputs["facing"].stop] = 1
    out[layout.outputs["rotations"]] = np.tile(np.concatenate([FORWARD, UP]), layout.joints)
    return out


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
    std = np.full(layout.output_size, spread, np.float32)
    std[layout.outputs["contacts"]] = 1
    std[layout.outputs["root_velocity"]] = 1
    object.__setattr__(made, "output_mean", standing(found, len(contacts)))
    object.__setattr__(made, "output_std", std)
    return MannModel(found, made, contacts)
