"""A system whose characters walk on a ground that it knows nothing of, or only by its network."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground
from motion.errors import UserError
from motion.pose import Poses

from .control import Command, Described
from .ground_feet import GroundFeet


class Grounded:
    """A controller whose characters' feet are put on a ground; implements `mm.control.Described`.

    Parameters
    ----------
    controller : what drives.
    ground, follow, compiled : see `mm.ground_feet.GroundFeet`; follow unless the controller's poses are
        made for this ground.

    What the controller goes on from stays as it is. A skeleton without whole legs is a UserError.
    """

    def __init__(
        self, controller: Described, ground: Ground, *, follow: bool = True, compiled: bool = True
    ) -> None:
        self.controller, self.ground = controller, ground
        self.name, self.skeleton = controller.name, controller.skeleton
        self.fps, self.count = controller.fps, controller.count
        self.description, self.settings = controller.description, controller.settings
        try:
            legs = self.description.feet(self.settings.foot_height)
        except UserError as error:
            what = f"no feet to put on a ground: {error.what}"
            raise UserError(what, remedy="leave the ground out") from error
        self._feet = GroundFeet(
            self.skeleton, legs, self.fps, self.count, ground=ground, follow=follow, compiled=compiled
        )
        self._shown = Poses.empty(self.count, len(self.skeleton))
        self.stage_seconds: dict[str, float] = {}

    @property
    def timed(self) -> bool:
        return self.controller.timed

    @timed.setter
    def timed(self, on: bool) -> None:
        self.controller.timed = on

    def reset(self, positions: NDArray[np.float32], yaws: NDArray[np.float32]) -> None:
        self.controller.reset(positions, yaws)
        self._feet.reset()

    def step(self, command: Command) -> Poses:
        poses = self.controller.step(command)
        start = time.perf_counter()
        self._shown[:] = poses
        self._feet.apply(self.contacts(), self._shown.positions, self._shown.rotations)
        if self.timed:
            took = time.perf_counter() - start
            self.stage_seconds = {**self.controller.stage_seconds, "ground": took}
        return self._shown

    def check_tags(self, required: int, forbidden: int) -> None:
        self.controller.check_tags(required, forbidden)

    def poses(self) -> Poses:
        return self._shown

    def contacts(self) -> NDArray[np.uint8]:
        return self.controller.contacts()

    def planted(self) -> NDArray[np.uint8]:
        return self.controller.planted()

    def record(self) -> dict[str, NDArray]:
        shown = {"positions": self._shown.positions.copy(), "rotations": self._shown.rotations.copy()}
        return self.controller.record() | shown

    def memory(self) -> dict[str, int]:
        poses = sum(array.nbytes for array in self._shown.arrays().values()) // self.count
        return self.controller.memory() | {"ground": poses}
