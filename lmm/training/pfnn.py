"""Training of a phase-functioned network (REFERENCE 4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import Tensor

from lmm.pfnn.frames import frames
from lmm.pfnn.layout import Layout
from lmm.pfnn.spline import coefficients

from .locomotion import LocomotionData, LocomotionStage
from .mixed_networks import PhaseLayers
from .pfnn_settings import PhaseTraining


class PhaseData(LocomotionData):
    """A database's frames, with their phases."""

    layout_type, vectors = Layout, frames


class PhaseStage(LocomotionStage):
    """The network, its phases a little off where that is asked for."""

    network: PhaseLayers

    def __init__(self, data: PhaseData, settings: PhaseTraining) -> None:
        how, layout = settings.pfnn, data.layout
        sizes = (layout.input_size, *how.hidden, layout.output_size)
        network = PhaseLayers(sizes, seed=settings.seed, name="pfnn")
        super().__init__(data, network, name="pfnn", settings=settings, how=how, joint_scale=how.joint_scale)
        self._own = how

    def begin(self) -> None:
        super().begin()
        shares = coefficients(self._data.frames.phase).astype(np.float32)
        self._shares = torch.from_numpy(shares).to(self._all.device)

    def _more(self, draw: np.random.Generator) -> Callable[[Tensor], tuple[Tensor, ...]]:
        """What each control point counts."""
        if not self._own.phase_noise:
            return lambda rows: (self._shares[rows.to(self._shares.device)],)
        off = self._own.phase_noise * draw.standard_normal(self._own.batch)

        def shares(rows: Tensor) -> tuple[Tensor, ...]:
            phases = self._data.frames.phase[rows.numpy()] + off
            return (torch.from_numpy(coefficients(phases).astype(np.float32)).to(self._shares.device),)

        return shares

    def _besides(self) -> Mapping[str, Tensor]:
        if not self._own.shrink:
            return {}
        squares = [parameter.square().mean() for parameter in self.network.parameters()]
        return {"weights": self._own.shrink * torch.stack(squares).mean()}
