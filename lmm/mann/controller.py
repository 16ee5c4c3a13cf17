"""Characters driven by a mode-adaptive network (REFERENCE 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat
from mm.control import Command

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
        self._steps: Any = steps if compiled else steps_numpy
        spacing = trajectory.interval(self.fps)
        self._shares = trajectory.blend(spacing, 0, self.settings.position_bias)[1]
        self._axes = np.zeros((count, model.layout.joints, 6), np.float32)
        self._fed = (*self._fed, self._axes)
        self._start()

    def _begin(self, mean: Any) -> None:
        super()._begin(mean)
        self._axes[0] = to_axes(mean.rotations[0])

    def _frame(self, who: slice, command: Command, ground: Ground | None) -> int:
        """A frame of some characters, up to their feet; the first whose command is not finite, or -1."""
        characters, past, x, kernels = self.characters[who], self._past[who], self._x[who], self._steps
        joints, velocities, axes = self._joints[who], self._velocities[who], self._axes[who]
        wrong = kernels.plan(
            characters, past, self._head, command.velocity, command.yaw, command.turn_rate, command.crouch,
            self._settings, *self._blend, self._shares, joints, velocities, axes, self._into, x,
        )  # fmt: skip
        if wrong >= 0:
            return wrong
        if ground is not None:
            kernels.sample_points(characters, self._into, x, self._points)
            heights = np.asarray(ground(self._points[..., 0], self._points[..., 1]), np.float32)
            kernels.stand(characters, heights)
        self._lap("trajectory")
        y = self.network.evaluate(x)
        self._lap("network")
        shown = self._shown
        kernels.show(
            characters, y, self._out, self._settings, self._parents, self._offsets, self.settings.stretch,
            self._contact_columns, joints, velocities, axes, shown.positions[who], shown.rotations[who],
            shown.velocities[who], shown.angular_velocities[who], self._contacts[who], self._turned,
        )  # fmt: skip
        self._head = (self._head + 1) % past.shape[1]
        kernels.advance(characters, past, self._head, y, self._out, self._settings, self._obstacles)
        self._lap("pose")
        return -1

    def record(self) -> dict[str, NDArray]:
        """See `LocomotionController.record`; experts [N, K] is what each counted in the last step."""
        return super().record() | {"experts": self.network.shares.copy()}
