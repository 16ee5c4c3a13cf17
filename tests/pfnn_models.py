"""Small phase-functioned networks of random numbers, on a database of synthetic walking."""

from __future__ import annotations

import functools
from itertools import pairwise

import lmm_models
import numpy as np

from lmm.pfnn.layout import Layout
from lmm.pfnn.model import CONTACTS, PhaseModel
from lmm.pfnn.network import PhaseNetwork
from mm.description import Description


def network(*sizes: int, seed: int = 0) -> PhaseNetwork:
    """A network whose control points differ and whose outputs are about as spread as its statistics say."""
    rng = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    pairs = list(pairwise(sizes))
    return PhaseNetwork(
        input_mean=numbers(sizes[0]),
        input_std=np.exp(numbers(sizes[0]) / 4),
        output_mean=numbers(sizes[-1]),
        output_std=np.exp(numbers(sizes[-1]) / 4),
        weights=tuple(numbers(4, rows, columns) / np.float32(np.sqrt(rows)) for rows, columns in pairs),
        biases=tuple(numbers(4, columns) / 10 for _, columns in pairs),
    )


@functools.cache
def description(fps: float = 60.0) -> Description:
    return Description.of(lmm_models.database(fps=fps))


def standing(found: Description) -> np.ndarray:
    """The outputs [O] of somebody who stands in the skeleton's rest pose, facing +Z, phase at 3 rad/s."""
    layout = Layout(len(found.skeleton) - 1)
    out = np.zeros(layout.output_size, np.float32)
    world = found.skeleton.offsets.copy()
    for j in range(1, len(world)):
        world[j] += world[found.skeleton.parents[j]]
    out[layout.outputs["positions"]] = world[1:].ravel()
    out[layout.outputs["facing"].stop - 6 : layout.outputs["facing"].stop] = 1
    out[layout.outputs["phase_rate"]] = 3
    return out


def model(
    *,
    seed: int = 0,
    spread: float = 0.02,
    fps: float = 60.0,
    layers: int = 2,
    found: Description | None = None,
) -> PhaseModel:
    """A model whose outputs are about a standing pose, by so much, of so many hidden layers."""
    found = found or description(fps)
    layout = Layout(len(found.skeleton) - 1, len(CONTACTS))
    made = network(layout.input_size, *[24] * layers, layout.output_size, seed=seed)
    std = np.full(layout.output_size, spread, np.float32)
    std[layout.outputs["contacts"]] = 1
    std[layout.outputs["root_velocity"]] = 1
    object.__setattr__(made, "output_mean", standing(found))
    object.__setattr__(made, "output_std", std)
    return PhaseModel(found, made)
