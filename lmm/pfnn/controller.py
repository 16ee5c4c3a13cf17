"""Characters driven by a phase-functioned network (REFERENCE 4.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat

from ..evaluator import Products
from ..locomotion.controller import STAGES, LocomotionController
from ..locomotion.settings import LocomotionSettings
from . import steps, steps_numpy, trajectory
from .evaluator import PhaseEvaluator
from .model import PhaseModel
from .spline import Mode

__all__ = ["STAGES", "PhaseController"]


class PhaseController(LocomotionController):
    """Drives N characters by commands; implements `mm.control.System`.

    Parameters
    ----------
    model : the network and its skeleton.
    count : N.
    mode : how weights are made of the phase, see `lmm.pfnn.spline`.
    products : of the network's numbers, see `lmm.pfnn.evaluator`.
    settings : see `lmm.locomotion.settings.LocomotionSettings`.
    ground : any function of heights (`features.terrain.Ground`); flat at 0 by default.
    obstacles : float [M, 5], see `mm.controller.Controller`; roots keep off them.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    name : what reports call this system.

    Whatever N, a character does the same: bit for bit, with bfloat16 products but for rounding.
    `stage_seconds` holds the time of the last step by stage when `timed` is set.
    """

    def __init__(
        self,
        model: PhaseModel,
        *,
        count: int = 1,
        mode: Mode = "cubic",
        products: Products = "float32",
        settings: LocomotionSettings | None = None,
        ground: Ground = flat,
        obstacles: ArrayLike = (),
        compiled: bool = True,
        name: str | None = None,
    ) -> None:
        self.model = model
        super().__init__(
            model,
            network=PhaseEvaluator(
                model.network, mode=mode, products=products, count=max(count, 1), compiled=compiled
            ),
            kernels=steps if compiled else steps_numpy,
            character=trajectory.CHARACTER,
            past=trajectory.PAST,
            inputs=tuple(model.layout.inputs),
            outputs=tuple(model.layout.outputs),
            count=count,
            settings=settings,
            ground=ground,
            obstacles=obstacles,
            compiled=compiled,
            name=name or f"pfnn-{mode}",
        )
        self._start()

    def _stand(self, characters: NDArray, heights: NDArray[np.float32], x: NDArray[np.float32]) -> None:
        self._steps.write_heights(characters, heights, self._into, x)

    def _evaluate(self, characters: NDArray, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return self.network.evaluate(x, characters["phase"])

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; phase [N], radians, is that of the frame to come."""
        return super().record() | {"phase": self.characters["phase"].copy()}
