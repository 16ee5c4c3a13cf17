"""Characters driven by a mode-adaptive network (REFERENCE 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..evaluator import Products
from ..locomotion import trajectory
from ..locomotion.controller import LocomotionController
from . import steps, steps_numpy
from .evaluator import MannEvaluator
from .layout import to_axes
from .network import MannNetwork


class MannController(LocomotionController):
    """Characters on two feet or four; options: see `LocomotionController`.

    The network knows nothing of the ground: roots stand on the mean of the heights along the trajectory.
    """

    kernels = steps, steps_numpy
    character = trajectory.character(future=6)  # of each sample predicted its velocity x, z, too
    past = trajectory.PAST + 3  # velocity x, z in the world, the speed asked for
    fed = 3, 3, 6  # axes, too

    def _evaluator(
        self, network: MannNetwork, products: Products, count: int, compiled: bool
    ) -> MannEvaluator:
        return MannEvaluator(network, products=products, count=count, compiled=compiled)

    def _blends(self, spacing: int) -> tuple[NDArray, ...]:
        return *super()._blends(spacing), trajectory.blend(spacing, 0, self.settings.position_bias)[1]

    def _begin(self, mean: Any) -> None:
        super()._begin(mean)
        self._fed[2][0] = to_axes(mean.rotations[0])

    def _stand(self, characters: NDArray, heights: NDArray[np.float32], x: NDArray[np.float32]) -> None:
        self._steps.stand(characters, heights)

    def _evaluate(self, characters: NDArray, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.network.evaluate(x)

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; experts [N, K] is what each counted in the last step."""
        return super().record() | {"experts": self.network.shares.copy()}
