"""Small phase-functioned networks of random numbers, on a database of synthetic walking."""

from __future__ import annotations

import functools
from dataclasses import replace
from itertools import pairwise
from typing import Any

import lmm_models
import numpy as np

from lmm.locomotion.layout import BlockLayout
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


def standing(made: Any, layout: BlockLayout, found: Description, spread: float, **means: Any) -> Any:
    """A network whose outputs are about somebody who stands in the skeleton's rest pose, facing +Z.

    spread : by how much; means : those of other blocks. Of all gaits it has seen as much.
    """
    seen = made.input_mean.copy()
    seen[layout.inputs["gaits"]] = 1 / 6
    mean, std = np.zeros(layout.output_size, np.float32), np.full(layout.output_size, spread, np.float32)
    world = found.skeleton.offsets.copy()
    for j in range(1, len(world)):
        world[j] += world[found.skeleton.parents[j]]
    outputs = layout.outputs
    mean[outputs["positions"]] = world[1:].ravel()
    mean[outputs["facing"].stop - 6 : outputs["facing"].stop] = 1
    for block, values in means.items():
        mean[outputs[block]] = values
    std[outputs["contacts"]] = std[outputs["root_velocity"]] = 1
    return replace(made, input_mean=seen, output_mean=mean, output_std=std)


def model(
    *,
    seed: int = 0,
    spread: float = 0.02,
    fps: float = 60.0,
    layers: int = 2,
    found: Description | None = None,
) -> PhaseModel:
    """A model whose outputs are about a standing pose, by so much, of so many hidden layers; 3 rad/s."""
    found = found or description(fps)
    layout = Layout(len(found.skeleton) - 1, len(CONTACTS))
    made = network(layout.input_size, *[24] * layers, layout.output_size, seed=seed)
    return PhaseModel(found, standing(made, layout, found, spread, phase_rate=3))
