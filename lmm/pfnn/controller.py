"""Characters driven by a phase-functioned network (REFERENCE 4.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat
from mm.control import Command

from ..evaluator import Products
from ..locomotion.controller import STAGES, LocomotionController
from . import steps, steps_numpy, trajectory
from .evaluator import PhaseEvaluator
from .model import PhaseModel
from .settings import PhaseSettings
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
    settings : see `lmm.pfnn.settings.PhaseSettings`.
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
        settings: PhaseSettings | None = None,
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
        self._steps: Any = steps if compiled else steps_numpy
        self._start()

    def _frame(self, who: slice, command: Command, ground: Ground | None) -> int:
        """A frame of some characters, up to their feet; the first whose command is not finite, or -1."""
        characters, past, x, kernels = self.characters[who], self._past[who], self._x[who], self._steps
        joints, velocities = self._joints[who], self._velocities[who]
        wrong = kernels.plan(
            characters, past, self._head, command.velocity, command.yaw, command.turn_rate, command.crouch,
            self._settings, *self._blend, joints, velocities, self._into, x,
        )  # fmt: skip
        if wrong >= 0:
            return wrong
        if ground is not None:
            kernels.sample_points(characters, self._into, x, self._points)
            heights = np.asarray(ground(self._points[..., 0], self._points[..., 1]), np.float32)
            kernels.write_heights(characters, heights, self._into, x)
        self._lap("trajectory")
        y = self.network.evaluate(x, characters["phase"])
        self._lap("network")
        shown = self._shown
        kernels.show(
            characters, y, self._out, self._settings, self._parents, self._offsets, self.settings.stretch,
            self._contact_columns, joints, velocities, shown.positions[who], shown.rotations[who],
            shown.velocities[who], shown.angular_velocities[who], self._contacts[who], self._turned,
        )  # fmt: skip
        self._head = (self._head + 1) % past.shape[1]
        kernels.advance(characters, past, self._head, y, self._out, self._settings, self._obstacles)
        self._lap("pose")
        return -1

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; phase [N], radians, is that of the frame to come."""
        return super().record() | {"phase": self.characters["phase"].copy()}
