"""Characters driven by a phase-functioned network (REFERENCE 4.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..evaluator import Products
from ..locomotion import trajectory
from ..locomotion.controller import LocomotionController
from . import steps, steps_numpy
from .evaluator import PhaseEvaluator
from .model import PhaseModel
from .network import PhaseNetwork
from .spline import Mode


class PhaseController(LocomotionController):
    """Characters that have a phase.

    mode : how weights are made of it, see `lmm.pfnn.spline`. Other options: see `LocomotionController`.
    """

    kernels = steps, steps_numpy
    character = trajectory.character(("phase", np.float32))

    def __init__(self, model: PhaseModel, *, mode: Mode = "cubic", **options: Any) -> None:
        self._mode: Mode = mode
        super().__init__(model, **options)

    def _evaluator(
        self, network: PhaseNetwork, products: Products, count: int, compiled: bool
    ) -> PhaseEvaluator:
        return PhaseEvaluator(network, mode=self._mode, products=products, count=count, compiled=compiled)

    def _stand(self, characters: NDArray, heights: NDArray[np.float32], x: NDArray[np.float32]) -> None:
        self._steps.write_heights(characters, heights, self._into, x)

    def _evaluate(self, characters: NDArray, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.network.evaluate(x, characters["phase"])

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; phase [N], radians, is that of the frame to come."""
        return super().record() | {"phase": self.characters["phase"].copy()}
