"""Where the window's camera stands: turned and moved by a user, along with whom it follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .. import camera
from ..camera import Camera
from ..controls import TURN

DRAG = 0.006  # radians a pixel
WHEEL = 0.9  # of the distance that is left after one notch nearer
LOWEST, HIGHEST = np.radians(-5.0), np.radians(88.0)


class Eye:
    """A camera around a place.

    Attributes
    ----------
    kind : follow moves along with whom it looks at; orbit goes around them, too; fixed stays where it is.
    azimuth, elevation, distance : from where it looks, see `viewer.camera.orbit`.
    turn : seconds in which it goes around them once.
    """

    def __init__(
        self,
        target: ArrayLike,
        *,
        azimuth: float,
        elevation: float,
        distance: float,
        kind: str = "follow",
        turn: float = 8.0,
    ) -> None:
        self.kind, self.turn = kind, turn
        self.azimuth, self.elevation, self.distance = azimuth, elevation, distance
        self._target = np.asarray(target, np.float64)

    @property
    def yaw(self) -> float:
        """Where it looks, 0 is +Z."""
        return float(np.mod(self.azimuth, 2 * np.pi) - np.pi)

    def drag(self, right: float, down: float) -> None:
        """Turn it by pixels that the mouse went."""
        self.azimuth -= DRAG * right
        self.elevation = float(np.clip(self.elevation + DRAG * down, LOWEST, HIGHEST))

    def zoom(self, notches: float) -> None:
        self.distance = float(np.clip(self.distance * WHEEL**notches, 0.6, 100.0))

    def tilt(self, held: float, dt: float) -> None:
        """A stick that is held up or down for a while, seconds."""
        self.elevation = float(np.clip(self.elevation - held * TURN * dt, LOWEST, HIGHEST))

    def move(self, goal: ArrayLike, dt: float) -> Camera:
        """The camera dt seconds later, as what it follows is at goal [3]."""
        if self.kind == "orbit":
            self.azimuth += 2 * np.pi * dt / self.turn
        if self.kind != "fixed":
            self._target = camera.follow(self.now(), goal, dt).target
        return self.now()

    def now(self) -> Camera:
        return camera.orbit(
            self._target, azimuth=self.azimuth, elevation=self.elevation, distance=self.distance
        )
