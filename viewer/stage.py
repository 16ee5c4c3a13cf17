"""Shows put into one scene: each at its place, with its name above it, at any time.

A single show stands where it is in its own world. Several stand side by side: each is moved as a whole so
that it begins at its own place, facing +Z, the first one leftmost as seen from the front, or from behind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import quat
from motion.errors import UserError

from . import skin
from .layers.placing import extent, placed, put
from .scene import LIGHT, Labels, Layer, Scene, Solids, Surface, Theme
from .shows import Show

Array = NDArray[np.floating]
Marks = Callable[[float], Mapping[str, Layer]]

_LANE = 0.8  # from one to the next, in parts of how tall they are
_AROUND, _ABOVE = 0.08, 0.2  # room around the joints, and above them for names, likewise
_NEAR = 1.3  # in parts of how tall they are: what is drawn farther from them need not be seen
_BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


class Stage:
    """A scene with shows in it.

    Parameters
    ----------
    shows : at least one.
    theme : colours of what is around them.
    names : whether their names stand above them.
    marks : for each show what is drawn about it at a time, in its own world (`viewer.layers`), or None.
    lanes : whether several are moved, so that each begins at its own place; else all are in one world.
    behind : whether the first one is leftmost as seen from behind.
    """

    def __init__(
        self,
        shows: Sequence[Show],
        *,
        theme: Theme = LIGHT,
        names: bool = False,
        marks: Sequence[Marks | None] = (),
        lanes: bool = True,
        behind: bool = False,
    ) -> None:
        if not shows:
            raise ValueError("no shows")
        self.shows, self.scene = list(shows), Scene(theme=theme)
        self._marks, self._marked = list(marks), dict[str, Layer]()
        self.tall = max(_height(show) for show in shows)
        self._reach = max(_AROUND * self.tall, *map(_reach, shows))
        self._turns, self._moves = self._places(lanes, -1 if behind else 1)
        self._leans = [_lean(show) for show in self.shows]
        self.roots, self.yaws = np.zeros((0, 3)), np.zeros(0)
        self.middle, self._corners = np.zeros(3), np.zeros((0, 3))
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
        """Show the poses at a time, seconds, and what is drawn about them."""
        self._pose_at(time)
        marked = dict[str, Layer]()
        for i, marks in enumerate(self._marks):
            for name, layer in (marks(time) if marks is not None else {}).items():
                marked[f"{i} {name}"] = layer
                if layer is not self._marked.get(f"{i} {name}"):
                    put(self.scene.layers, f"{i} {name}", placed(layer, self._turns[i], self._moves[i]))
        for name in self._marked.keys() - marked.keys():
            self.scene.layers[name].visible = False
        self._marked = marked

    def lay(self, i: int, ground: Surface) -> None:
        """Put a ground, of show i's own world, in place of the level one."""
        self.scene.ground = None
        self.scene.layers[f"{i} ground"] = placed(ground, self._turns[i], self._moves[i])

    def _pose_at(self, time: float) -> None:
        roots, yaws, tops, corners, middles = [], [], [], [], []
        for i, show in enumerate(self.shows):
            positions, rotations = self.pose(i, time)
            for name, values in _looks(i, show, positions, rotations).items():
                self.scene.layers[name].update(**values)
            stands, faces = _stance(show, positions, rotations)
            corners.append(self._around(positions))
            middles.append(stands + quat.rotate(quat.from_yaw(faces), self._leans[i]))
            roots.append(stands)
            yaws.append(faces)
            tops.append([stands[0, 0], positions[0, :, 1].max() + 0.14 * self.tall, stands[0, 2]])
        self.roots, self.yaws = np.concatenate(roots), np.concatenate(yaws)
        self._corners, bodies = np.concatenate(corners), np.concatenate(middles)
        bodies = bodies[np.isfinite(bodies).all(axis=1)]
        if len(bodies):  # a network that broke may give no numbers: the camera stays where it was
            self.middle = (bodies.min(axis=0) + bodies.max(axis=0)) / 2
        self._names.update(positions=np.array(tops))

    def pose(self, i: int, time: float) -> tuple[Array, Array]:
        """Positions [N, J, 3] and rotations [N, J, 4] of show i in the scene."""
        positions, rotations = self.shows[i].pose(time)
        turn, move = self._turns[i], self._moves[i]
        turns = np.broadcast_to(turn, rotations.shape)
        return quat.rotate(turn, positions) + move, quat.mul(turns, rotations)

    def boxes(self, times: Sequence[float]) -> tuple[Array, Array]:
        """What there is to see at T times: middles [T, 3] on the ground, corners [T, C, 3] around everyone.

        The bodies are left at the last of these times.
        """
        middles, corners = [], []
        for time in times:
            self._pose_at(time)
            middles.append(self.middle)
            corners.append(self._corners)
        return np.array(middles), np.array(corners)

    def marks(self, time: float) -> Array:
        """Points [P, 3] of what is drawn about those shown at a time, and not far from them.

        They are left as they are then.
        """
        self.move_to(time)
        found = [extent(self.scene.layers[name]) for name in self._marked]
        points = np.concatenate([np.zeros((0, 3)), *found])
        far = np.linalg.norm(points[:, None, [0, 2]] - self.roots[None][..., [0, 2]], axis=-1)
        return np.asarray(points[far.min(axis=1) < _NEAR * self.tall])

    def _around(self, positions: Array) -> Array:
        """Corners [8, 3] of a box around characters' joints [N, J, 3] and their names."""
        low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
        above = _ABOVE if self._names.visible else _AROUND
        low = low - np.array([self._reach, _AROUND * self.tall, self._reach])
        high = high + np.array([self._reach, above * self.tall, self._reach])
        return np.asarray(low + _BOX * (high - low))

    def _dress(self, i: int, show: Show) -> None:
        """Make the layers of a show."""
        for name, values in _looks(i, show, *self.pose(i, 0.0)).items():
            made = Solids(parts=show.body.parts, **values) if "transforms" in values else Surface(**values)
            self.scene.layers[name] = made

    def _places(self, lanes: bool, way: int) -> tuple[list[Array], list[Array]]:
        if len(self.shows) == 1 or not lanes:
            return [quat.identity()] * len(self.shows), [np.zeros(3)] * len(self.shows)
        turns, moves = [], []
        lane = way * _LANE * max(self.tall, 0.5)
        for i, show in enumerate(self.shows):
            stands, faces = _stance(show, *show.pose(0.0))
            turn = quat.from_yaw(-faces[0])
            place = np.array([(i - (len(self.shows) - 1) / 2) * lane, 0.0, 0.0])
            turns.append(turn)
            moves.append(place - quat.rotate(turn, stands.mean(axis=0) * np.array([1.0, 0.0, 1.0])))
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
    """Where they stand [N, 3] and yaws [N]; without a ground root the yaw is 0, the place below joint 0."""
    known = show.skeleton.roles.get("root") == 0
    stands = positions[:, 0] * np.array([1.0, float(known), 1.0])
    return stands, quat.yaw(rotations[:, 0]) if known else np.zeros(len(stands))


def _some(show: Show) -> list[tuple[Array, Array]]:
    """Poses at a few times; a UserError where all of them are no numbers."""
    times = [0.0] if show.seconds is None else np.linspace(0, show.seconds, 5).tolist()
    found = [pose for pose in map(show.pose, times) if np.isfinite(pose[0]).all()]
    if not found:
        raise UserError(f"the poses of {show.name} are no numbers", remedy="show another one")
    return found


def _lean(show: Show) -> Array:
    """Where the first character's joints are around its root, on the ground and as it faces [3]: their mean.

    The root moves smoothly, joints do not: a camera that looks there does not sway.
    """
    found = []
    for positions, rotations in _some(show):
        stands, faces = _stance(show, positions[:1], rotations[:1])
        found.append(quat.rotate(quat.from_yaw(-faces), positions[:1].mean(axis=1) - stands)[0])
    return np.asarray(np.mean(found, axis=0) * np.array([1.0, 0.0, 1.0]))


def _reach(show: Show) -> float:
    """How far the first character's body reaches beyond its joints on the ground, metres: a muzzle does."""
    found = [0.0]
    for positions, rotations in _some(show):
        meshes = []
        for values in _looks(0, show, positions[:1], rotations[:1]).values():
            if "mesh" in values:
                meshes.append(values["mesh"].vertices)
            else:
                placing = zip(show.body.parts, values["transforms"][0], strict=True)
                meshes += [part.vertices @ at[:, :3].T + at[:, 3] for part, at in placing]
        vertices, joints = np.concatenate(meshes)[:, [0, 2]], positions[0][:, [0, 2]]
        found += [*(vertices.max(axis=0) - joints.max(axis=0)), *(joints.min(axis=0) - vertices.min(axis=0))]
    return float(max(found))


def _height(show: Show) -> float:
    """How tall the first character is usually, metres; who lies counts as a third as tall as long."""
    poses = [positions for positions, _ in _some(show)]
    sizes = [max(np.ptp(p[0, :, 1]), 0.35 * np.ptp(p[0], axis=0).max()) for p in poses]
    return max(float(np.median(sizes)), 0.1)
