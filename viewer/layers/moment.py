"""One character at an instant, and what is known of it: all that layers are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features import normalise, trajectory
from features.schema import Schema
from motion import kinematics, quat

from ..cast import Member
from ..explain import Explanation, step_of
from ..sources import offset_and_scale
from ..timeline import Instant

Array = NDArray[np.floating]

LIFT = 0.015  # metres above the ground: what lies on it is seen


@dataclass(frozen=True, eq=False)
class Root:
    """Where a character stood: position float [2] (x, z), and how it faced, radians."""

    position: Array
    yaw: float


class Moment:
    """A member at a time, seconds.

    Attributes
    ----------
    instant : what its timeline tells (`viewer.timeline.Instant`).
    root : where its ground root is.
    """

    def __init__(self, member: Member, time: float) -> None:
        self.member, self.time = member, time
        self.instant: Instant = member.timeline.at(time)
        self.root = _root(self.instant.positions, self.instant.rotations)

    @property
    def record(self) -> dict[str, NDArray]:
        return dict(self.instant.record)

    @cached_property
    def world(self) -> tuple[Array, Array]:
        """Positions [J, 3] and rotations [J, 4] of the joints in the world."""
        skeleton = self.member.timeline.skeleton
        positions, rotations = kinematics.forward(
            skeleton, self.instant.positions[None], self.instant.rotations[None]
        )
        return positions[0], rotations[0]

    @property
    def schema(self) -> Schema | None:
        """Of the features that are searched for."""
        return self.member.schema

    @cached_property
    def size(self) -> float:
        """How large it is beside a person, so that arrows are so, too."""
        high = float(np.ptp(self.world[0][:, 1]))
        return float(np.clip(high / 1.6, 0.3, 2.0)) if np.isfinite(high) else 1.0

    @property
    def explanation(self) -> Explanation | None:
        return self.member.explanation(self.time)

    @cached_property
    def search(self) -> tuple[dict[str, NDArray], Root] | None:
        """What the step of the last search recorded, and where the character was then; None without one."""
        timeline = self.member.timeline
        step = step_of(timeline, self.time)
        if step is None:
            return None
        record = timeline.record(step)
        return record, _root(record["positions"], record["rotations"])

    def features(self, frame: int) -> NDArray[np.float32] | None:
        """A database's features of a frame [F], in their units; None without the database or the frame."""
        data = self.member.data
        return None if data is None or frame < 0 else self.raw(data.features[frame])

    def raw(self, features: ArrayLike) -> NDArray[np.float32] | None:
        """Normalised features [F] in their units; None without the database that normalised them."""
        if self.member.data is None:
            return None
        return normalise.denormalise(np.asarray(features), *offset_and_scale(self.member.data))

    def way(self, features: Array, root: Root) -> tuple[Array, Array]:
        """The trajectory in features [F], from a root: points [K, 2] in the world, from the past to the
        future with the root among them, and unit facings [K, 2], not numbers where there are none."""
        assert self.schema is not None
        layout = self.schema.trajectory()
        spots, facings = np.full((len(layout), 2), np.nan), np.full((len(layout), 2), np.nan)
        for columns, values in ((layout.position_columns, spots), (layout.direction_columns, facings)):
            known = np.flatnonzero(columns >= 0)
            values[known] = features[columns[known, None] + np.arange(2)]
        times = np.append(layout.times, 0.0)
        order = np.argsort(times, kind="stable")
        spots = np.concatenate([spots, np.zeros((1, 2))])[order]
        facings = np.concatenate([facings, np.full((1, 2), np.nan)])[order]
        placed = np.isfinite(spots).all(axis=1)
        facings = facings[placed] / np.linalg.norm(facings[placed], axis=-1, keepdims=True)
        points = trajectory.points_to_world(spots[placed], root.position, np.array(root.yaw))
        return points, trajectory.directions_to_world(facings, np.array(root.yaw))

    def on_ground(self, points: ArrayLike, lift: float = LIFT) -> Array:
        """Points [..., 2] (x, z) as ones [..., 3] that lie on the ground."""
        points = np.asarray(points, np.float64)
        heights = self.member.ground(points[..., 0], points[..., 1])
        return np.stack([points[..., 0], heights + lift, points[..., 1]], axis=-1)


def _root(positions: Array, rotations: Array) -> Root:
    return Root(positions[0, [0, 2]].astype(np.float64), float(quat.yaw(rotations[:1].astype(np.float64))[0]))
