"""Training of a mode-adaptive network (REFERENCE 5)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lmm.mann import sway
from lmm.mann.frames import frames
from lmm.mann.layout import Layout
from lmm.mann.model import end_effectors

from .locomotion import LocomotionData, LocomotionStage
from .mann_settings import MannStageSettings, MannTraining
from .mixed_networks import ExpertLayers
from .rotations import orthonormal

BEYOND = 0.1  # of the range of an output in the data, as far as characters follow beyond it


class MannData(LocomotionData):
    """A database's frames, of two feet or four."""

    layout_type, vectors = Layout, frames

    def memory(self) -> int:
        """See `LocomotionData.memory`; how frames sway takes room, too."""
        return super().memory() + 4 * len(sway.columns(self.layout)) * len(self.database)

    def bounds(self) -> NDArray[np.float32]:
        """Those of the data, and a tenth of their range beyond. Without a phase that leads it back, a network
        that is asked for what it never saw answers with more and more of it."""
        least, most = self.frames.y.min(axis=0), self.frames.y.max(axis=0)
        return np.stack([least - BEYOND * (most - least), most + BEYOND * (most - least)])


class MannStage(LocomotionStage):
    """The experts and their gate."""

    network: ExpertLayers

    def __init__(self, data: MannData, settings: MannTraining) -> None:
        how, layout = lasting(settings.mann, data.count()), data.layout
        network = ExpertLayers(
            (layout.input_size, *how.hidden, layout.output_size),
            layout.gate_columns(end_effectors(data.database)),
            experts=how.experts,
            hidden=how.gate,
            seed=settings.seed,
            name="mann",
        )
        super().__init__(data, network, name="mann", settings=settings, how=how, joint_scale=how.joint_scale)
        self._own = how

    def begin(self) -> None:
        super().begin()
        # The gate sees joints as it sees what is asked, whatever they count for the experts.
        layout, weights = self._data.layout, self._joint_weights
        scale = np.ones(layout.input_size, np.float32)
        velocities = np.repeat(weights, 3)
        scale[layout.inputs["velocities"]] = np.where(velocities > 0, self._joint_scale, 1)
        self.network.heed(1 / scale[self.network.gate_columns.cpu().numpy()])

        if self._own.sway:
            found = sway.sways(self._data.database, self._data.labels)
            self._sways = torch.from_numpy(found).to(self._all.device)
            self._told_columns = torch.from_numpy(sway.columns(layout)).to(self._all.device)
            self._of_past = sway.of_past(layout)

    def _told(self, draw: np.random.Generator) -> Callable[[Tensor, Tensor], Tensor]:
        """Inputs with less of their own sway, in the past and in the future by other amounts, and with that
        of other frames: what is left could still be read, and what is added tells nothing."""
        if not self._own.sway:
            return super()._told(draw)
        count, device = self._own.batch, self._sways.device
        past, future, added = draw.random((3, count, 1), np.float32)
        less = torch.from_numpy(np.where(self._of_past, past, future)).to(device)
        others = torch.from_numpy(draw.integers(0, len(self._sways), count)).to(device)
        more = torch.from_numpy(self._own.sway * (2 * added - 1)).to(device) * self._sways[others]

        def told(x: Tensor, rows: Tensor) -> Tensor:
            x[:, self._told_columns] += more - less * self._sways[rows]
            return x

        return told

    def _fed_back(self, x: Tensor, y: Tensor) -> Tensor:
        """See `LocomotionStage._fed_back`; rotations are made whole, as `lmm.mann.steps.show` makes them."""
        whole, columns = y.clone(), self._data.layout.outputs["rotations"]
        axes = y[:, columns].reshape(len(y), -1, 2, 3).swapaxes(-1, -2)
        whole[:, columns] = orthonormal(axes)[..., :2].swapaxes(-1, -2).reshape(len(y), -1)
        return super()._fed_back(x, whole)


def lasting(settings: MannStageSettings, frames: int) -> MannStageSettings:
    """Settings with as many iterations as their epochs come to on so many frames, if they have any."""
    if not settings.epochs:
        return settings
    return replace(settings, iterations=max(math.ceil(settings.epochs * frames / settings.batch), 1))
