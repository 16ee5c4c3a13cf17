"""Characters driven by a mode-adaptive network (REFERENCE 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat

from ..evaluator import Products
from ..locomotion import trajectory
from ..locomotion.controller import STAGES, LocomotionController
from ..locomotion.settings import LocomotionSettings
from . import steps, steps_numpy
from .evaluator import MannEvaluator
from .layout import to_axes
from .model import MannModel

__all__ = ["STAGES", "MannController"]

CHARACTER = trajectory.character(future=6)  # of each sample predicted its velocity x, z, too
PAST = trajectory.PAST + 3  # velocity x, z in the world, the speed asked for


class MannController(LocomotionController):
    """Drives N characters by commands; implements `mm.control.System`.

    Parameters
    ----------
    model : the network and its skeleton, on two feet or four.
    count : N.
    products : of the network's numbers, see `lmm.mann.evaluator`.
    settings : see `lmm.locomotion.settings.LocomotionSettings`.
    ground : any function of heights (`features.terrain.Ground`); flat at 0 by default. The network knows
        nothing of it: roots stand on the mean of the heights along the trajectory.
    obstacles : float [M, 5], see `mm.controller.Controller`; roots keep off them.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    name : what reports call this system.

    Whatever N, a character does the same: bit for bit, with bfloat16 products but for rounding.
    `stage_seconds` holds the time of the last step by stage when `timed` is set.
    """

    def __init__(
        self,
        model: MannModel,
        *,
        count: int = 1,
        products: Products = "float32",
        settings: LocomotionSettings | None = None,
        ground: Ground = flat,
        obstacles: ArrayLike = (),
        compiled: bool = True,
        name: str | None = None,
    ) -> None:
        self.model = model
        evaluator = MannEvaluator(model.network, products=products, count=max(count, 1), compiled=compiled)
        super().__init__(
            model,
            network=evaluator,
            kernels=steps if compiled else steps_numpy,
            character=CHARACTER,
            past=PAST,
            inputs=("path", "facing", "gaits", "positions", "velocities", "going", "speeds", "rotations"),
            outputs=tuple(model.layout.outputs),
            count=count,
            settings=settings,
            ground=ground,
            obstacles=obstacles,
            compiled=compiled,
            name=name or f"mann-{model.network.experts}",
        )
        self._axes = np.zeros((count, model.layout.joints, 6), np.float32)
        self._fed = (*self._fed, self._axes)
        self._start()

    def _blends(self, spacing: int) -> tuple[NDArray, ...]:
        return *super()._blends(spacing), trajectory.blend(spacing, 0, self.settings.position_bias)[1]

    def _begin(self, mean: Any) -> None:
        super()._begin(mean)
        self._axes[0] = to_axes(mean.rotations[0])

    def _stand(self, characters: NDArray, heights: NDArray[np.float32], x: NDArray[np.float32]) -> None:
        self._steps.stand(characters, heights)

    def _evaluate(self, characters: NDArray, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.network.evaluate(x)

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; experts [N, K] is what each counted in the last step."""
        return super().record() | {"experts": self.network.shares.copy()}
