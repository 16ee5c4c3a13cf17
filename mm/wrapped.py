"""What stands around a controller and does something to its poses; the rest it forwards."""

from __future__ import annotations

import time

from numpy.typing import NDArray

from motion.pose import Poses

from .control import Described, lag_of


class Wrapped:
    """A controller with something around it; implements `mm.control.Described` but for `step`.

    controller : what drives; whatever is asked of its data, its feet or its last step, it answers.
    """

    def __init__(self, controller: Described) -> None:
        self.controller = controller
        self.name, self.skeleton = controller.name, controller.skeleton
        self.fps, self.count = controller.fps, controller.count
        self.description, self.settings = controller.description, controller.settings
        self.lag = lag_of(controller)
        self.stage_seconds: dict[str, float] = {}

    @property
    def timed(self) -> bool:
        return self.controller.timed

    @timed.setter
    def timed(self, on: bool) -> None:
        self.controller.timed = on

    def _book(self, stage: str, start: float) -> None:
        """Book the time since start (`time.perf_counter`) under a stage, beside those of the controller."""
        if self.timed:
            self.stage_seconds = {**self.controller.stage_seconds, stage: time.perf_counter() - start}

    def reset(self, positions: NDArray, yaws: NDArray) -> None:
        self.controller.reset(positions, yaws)

    def check_tags(self, required: int, forbidden: int) -> None:
        self.controller.check_tags(required, forbidden)

    def poses(self) -> Poses:
        return self.controller.poses()

    def contacts(self) -> NDArray:
        return self.controller.contacts()

    def planted(self) -> NDArray:
        return self.controller.planted()

    def record(self) -> dict[str, NDArray]:
        return self.controller.record()

    def memory(self) -> dict[str, int]:
        return self.controller.memory()
