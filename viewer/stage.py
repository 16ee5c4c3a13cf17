"""Shows put into one scene: each at its place, with its name above it, at any time.

A single show stands where it is in its own world. Several stand side by side: each is moved as a whole so
that it begins at its own place, facing +Z, the first one leftmost as seen from the front.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import quat

from . import skin
from .scene import LIGHT, Labels, Scene, Solids, Surface, Theme
from .shows import Show

Array = NDArray[np.floating]

_LANE = 0.8  # from one to the next, in parts of how tall they are
_SPAN = 0.8  # how wide the arms and legs of one reach, likewise


class Stage:
    """A scene with shows in it.

    Parameters
    ----------
    shows : at least one.
    theme : colours of what is around them.
    names : whether their names stand above them.
    """

    def __init__(self, shows: Sequence[Show], *, theme: Theme = LIGHT, names: bool = False) -> None:
        if not shows:
            raise ValueError("no shows")
        self.shows, self.scene = list(shows), Scene(theme=theme)
        self.tall = max(_height(show) for show in shows)
        self._turns, self._moves = self._places()
        self.roots = np.zeros((0, 3))
        self.yaws = np.zeros(0)
        for i, show in enumerate(self.shows):
            self._dress(i, show)
        self._names = Labels(
            texts=[show.name for show in self.shows],
            positions=np.zeros((len(self.shows), 3), np.float32),
            visible=names,
        )
        self.scene.layers["names"] = self._names
        self.move_to(0.0)

    @property
    def seconds(self) -> float | None:
        """How long the longest lasts; None where one has no end."""
        ends = [show.seconds for show in self.shows]
        return None if None in ends else max(end for end in ends if end is not None)

    def move_to(self, time: float) -> None:
        """Show the poses at a time, seconds."""
        roots, yaws, tops = [], [], []
        for i, show in enumerate(self.shows):
            positions, rotations = self.pose(i, time)
            for name, values in _looks(i, show, positions, rotations).items():
                self.scene.layers[name].update(**values)
            stands, faces = _stance(show, positions, rotations)
            roots.append(stands)
            yaws.append(faces)
            tops.append(stands[0] + np.array([0.0, positions[0, :, 1].max() + 0.14 * self.tall, 0.0]))
        self.roots, self.yaws = np.concatenate(roots), np.concatenate(yaws)
        self._names.update(positions=np.array(tops))

    def pose(self, i: int, time: float) -> tuple[Array, Array]:
        """Positions [N, J, 3] and rotations [N, J, 4] of show i in the scene."""
        positions, rotations = self.shows[i].pose(time)
        turn, move = self._turns[i], self._moves[i]
        return quat.rotate(turn, positions) + move, quat.mul(
            np.broadcast_to(turn, rotations.shape), rotations
        )

    def extent(self, times: Sequence[float]) -> tuple[Array, Array, float]:
        """Where all are at some times: lowest and highest ground positions [3], and how wide all of them are
        apart at one time at most, metres; the stage is left at the last of these times."""
        low, high, wide = np.full(3, np.inf), np.full(3, -np.inf), 0.0
        for time in times:
            self.move_to(time)
            here = self.roots.min(axis=0), self.roots.max(axis=0)
            wide = max(wide, float(np.linalg.norm(here[1] - here[0])))
            low, high = np.minimum(low, here[0]), np.maximum(high, here[1])
        return low, high, wide

    @property
    def middle(self) -> Array:
        """The ground position [3] in the middle of all."""
        found: Array = (self.roots.min(axis=0) + self.roots.max(axis=0)) / 2
        return found

    @property
    def span(self) -> float:
        """How wide one of them is at most, metres."""
        return _SPAN * self.tall

    def _dress(self, i: int, show: Show) -> None:
        """Make the layers of a show."""
        for name, values in _looks(i, show, *self.pose(i, 0.0)).items():
            made = Solids(parts=show.body.parts, **values) if "transforms" in values else Surface(**values)
            self.scene.layers[name] = made

    def _places(self) -> tuple[list[Array], list[Array]]:
        if len(self.shows) == 1:
            return [quat.identity()], [np.zeros(3)]
        turns, moves = [], []
        lane = _LANE * max(self.tall, 0.5)
        for i, show in enumerate(self.shows):
            stands, faces = _stance(show, *show.pose(0.0))
            turn = quat.from_yaw(-faces[0])
            place = np.array([(i - (len(self.shows) - 1) / 2) * lane, 0.0, 0.0])
            turns.append(turn)
            moves.append(place - quat.rotate(turn, stands.mean(axis=0)))
        return turns, moves


def _looks(i: int, show: Show, positions: Array, rotations: Array) -> dict[str, dict[str, Any]]:
    """What the layers of show i hold in a pose, by their names."""
    if show.skin is None:
        return {f"{i} {show.name}": {"transforms": show.body.transforms(positions, rotations)}}
    worn, joints = show.skin
    return {
        f"{i} {show.name} {c}": {"mesh": skin.mesh(worn, positions[c, joints], rotations[c, joints])}
        for c in range(show.count)
    }


def _stance(show: Show, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Ground positions [N, 3] and yaws [N]; without a ground root the yaw is 0, the place that of joint 0."""
    stands = positions[:, 0] * np.array([1.0, 0.0, 1.0])
    known = show.skeleton.roles.get("root") == 0
    return stands, quat.yaw(rotations[:, 0]) if known else np.zeros(len(stands))


def _height(show: Show) -> float:
    """How tall characters are, a usual one in the middle of what is known of them, metres."""
    times = [0.0] if show.seconds is None else np.linspace(0, show.seconds, 5)
    poses = [show.pose(time)[0] for time in times]
    sizes = [max(np.ptp(p[0, :, 1]), 0.35 * np.ptp(p[0], axis=0).max()) for p in poses]
    return max(float(np.median(sizes)), 0.1)
