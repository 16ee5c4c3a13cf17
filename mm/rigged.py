"""A system whose characters drive a rig of their own, by run-time retargeting."""

from __future__ import annotations

import time

from numpy.typing import NDArray

from motion.anatomy import Anatomy, anatomy
from motion.clip import Clip
from motion.pose import Poses
from motion.retargeter import Retargeter

from .control import Command, Described
from .description import anatomy_of
from .recording import Recording
from .wrapped import Wrapped


class Rigged(Wrapped):
    """A controller that also poses N rigs; implements `mm.control.System`, of the controller's skeleton.

    Parameters
    ----------
    controller : what drives.
    target : the rig's anatomy.
    compiled : see `motion.retargeter.Retargeter`.

    `rigs` are the poses of the last step. Their world is the controller's times `retargeter.plan.scale`;
    a recording holds them as rig_positions and rig_rotations.
    """

    def __init__(self, controller: Described, target: Anatomy, *, compiled: bool = True) -> None:
        super().__init__(controller)
        self.retargeter = Retargeter(
            _own(controller),
            target,
            controller.count,
            contact_roles=controller.description.contact_roles,
            foot_halflife=controller.settings.foot_halflife,
            unlock_radius=controller.settings.unlock_radius,
            compiled=compiled,
        )
        self.rigs = Poses.empty(self.count, len(self.retargeter.skeleton))

    def reset(self, positions: NDArray, yaws: NDArray) -> None:
        super().reset(positions, yaws)
        self.retargeter.reset()

    def step(self, command: Command) -> Poses:
        poses = self.controller.step(command)
        start = time.perf_counter()
        contacts = self.controller.planted() if self.settings.foot_lock else None
        self.rigs = self.retargeter.step(poses, contacts, 1 / self.fps)
        self._book("retargeting", start)
        return poses

    def record(self) -> dict[str, NDArray]:
        rigs = {"rig_positions": self.rigs.positions.copy(), "rig_rotations": self.rigs.rotations.copy()}
        return super().record() | rigs

    def memory(self) -> dict[str, int]:
        poses = sum(array.nbytes for array in self.rigs.arrays().values()) // self.count
        return super().memory() | {"rig": poses}

    def clip(self, recording: Recording, character: int = 0) -> Clip:
        """One rig's motion in a recording of this system."""
        arrays = {
            "positions": recording["rig_positions"],
            "rotations": recording["rig_rotations"],
        }
        shown = Recording(self.name, self.retargeter.skeleton, recording.fps, arrays, course=recording.course)
        return shown.clip(character)


def _own(controller: Described) -> Anatomy:
    """The anatomy of a controller's skeleton, from what is known of its data."""
    if controller.description.anatomy is not None:
        return controller.description.anatomy
    database = getattr(controller, "database", None)
    if database is not None:
        return anatomy_of(database)
    return anatomy(controller.skeleton)
