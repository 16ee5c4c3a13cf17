"""A system whose characters walk on a ground that it knows nothing of, or only by its network."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from features.terrain import Ground
from motion.errors import UserError
from motion.pose import Poses

from .control import Command, Described
from .ground_feet import GroundFeet
from .wrapped import Wrapped


class Grounded(Wrapped):
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
        super().__init__(controller)
        self.ground = ground
        try:
            legs = self.description.feet(self.settings.foot_height)
        except UserError as error:
            what = f"no feet to put on a ground: {error.what}"
            raise UserError(what, remedy="leave the ground out") from error
        self._feet = GroundFeet(
            self.skeleton, legs, self.fps, self.count, ground=ground, follow=follow, compiled=compiled
        )
        self._shown = Poses.empty(self.count, len(self.skeleton))

    def reset(self, positions: NDArray, yaws: NDArray) -> None:
        super().reset(positions, yaws)
        self._feet.reset()
        record = super().record()
        self._shown[:] = Poses.empty(self.count, len(self.skeleton))
        self._shown.positions[:], self._shown.rotations[:] = record["positions"], record["rotations"]
        self._feet.apply(self.contacts(), self._shown.positions, self._shown.rotations)
        self._feet.reset()

    def step(self, command: Command) -> Poses:
        poses = self.controller.step(command)
        start = time.perf_counter()
        self._shown[:] = poses
        self._feet.apply(self.contacts(), self._shown.positions, self._shown.rotations)
        self._book("ground", start)
        return self._shown

    def poses(self) -> Poses:
        return self._shown

    def record(self) -> dict[str, NDArray]:
        shown = {"positions": self._shown.positions.copy(), "rotations": self._shown.rotations.copy()}
        return super().record() | shown

    def memory(self) -> dict[str, int]:
        poses = sum(array.nbytes for array in self._shown.arrays().values()) // self.count
        return super().memory() | {"ground": poses}


def on_ground(make: Callable[..., Any], ground: Ground | None, *, sees: bool = False) -> Any:
    """The controller that make gives, put on a ground if there is one.

    sees : make takes it, too (``make(ground=ground)``), and gives poses made for it. What is made must be a
    `mm.control.Described`, else it is a UserError.
    """
    if ground is None:
        return make()
    made = make(ground=ground) if sees else make()
    if not hasattr(made, "description"):
        raise UserError(f"{made.name} tells nothing of its feet", remedy="leave the ground out")
    return Grounded(made, ground, follow=not sees)
