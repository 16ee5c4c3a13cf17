"""The vectors of a database's frames: what a mode-adaptive network is trained on (REFERENCE 5)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from features import trajectory as ground_plane
from features.labels import Labels
from mm.database import Database
from motion import springs

from ..locomotion import ranges
from ..locomotion.ranges import Range
from ..locomotion.trajectory import interval
from ..locomotion.window import FUTURE, PRESENT, around
from .layout import Inputs, Layout, Outputs

Array = NDArray[np.float32]

AHEAD = 1.0  # seconds over which the way is measured that makes the speed wanted


@dataclass(frozen=True, eq=False)
class Frames:
    """M frames with one before and one after them in their range.

    Attributes
    ----------
    x, y : float32 [M, I], [M, O], by `lmm.mann.layout`, without any normalisation. What the gate sees are
        columns of x, `Layout.gate_columns`.
    frame : int64 [M], which of the database.
    """

    x: Array
    y: Array
    frame: NDArray[np.int64]


class Way(NamedTuple):
    """The trajectory around M frames, seen from their roots.

    Attributes
    ----------
    path, facing, going : [M, 12, 2], speeds : [M, 12], see `lmm.mann.layout.Inputs`.
    at : int64 [M, 12], frames of the range that samples are taken of.
    """

    path: NDArray
    facing: NDArray
    going: NDArray
    speeds: NDArray
    at: NDArray[np.int64]


def frames(database: Database, labels: Labels) -> Frames:
    """Vectors of all frames but the first and the last of each range.

    labels are of all frames of the database; their gaits are the actions. Before a range begins and after it
    ends, the root is taken to go on as it did there, facing where it faced. Ranges that the labels leave out
    have none.
    """
    layout = Layout(len(database.skeleton) - 1, len(labels.names))
    return Frames(*ranges.of_all(database, labels, layout, partial(_range, database, labels, layout)))


def _range(
    database: Database, labels: Labels, layout: Layout, start: int, stop: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    fps, spacing = database.fps, interval(database.fps)
    part = Range.of(database, start, stop)
    root, yaw = part.root, part.yaw
    arriving = arriving_with(root, fps)
    t = np.arange(1, stop - start - 1)
    told = way(root, yaw, t, fps)
    x = layout.pack_inputs(
        Inputs(
            path=told.path,
            facing=told.facing,
            gaits=labels.gait[start + told.at],
            going=told.going,
            speeds=told.speeds,
            positions=part.positions[t - 1],
            rotations=part.rotations[t - 1],
            velocities=part.velocities[t - 1],
        )
    )
    path, facing, at = around(root, yaw, t + 1, spacing * np.arange(FUTURE))
    y = layout.pack_outputs(
        Outputs(
            root_velocity=ground_plane.directions_to_local(arriving[t + 1, None], yaw[t])[:, 0],
            turn_rate=springs.wrap(yaw[t + 1] - yaw[t]) * fps,
            contacts=labels.contacts[start + t].astype(np.float32),
            path=path,
            facing=facing,
            going=ground_plane.directions_to_local(arriving[at], yaw[t + 1]),
            positions=part.positions[t],
            rotations=part.rotations[t],
            velocities=part.velocities[t],
        )
    )
    return x, y, start + t


def way(root: NDArray, yaw: NDArray, t: NDArray[np.int64], fps: float) -> Way:
    """What inputs tell of the way of a range's root [T, 2] that faces yaw [T], at frames t [M] of it."""
    path, facing, at = around(root, yaw, t, interval(fps) * np.arange(-PRESENT, FUTURE))
    going = ground_plane.directions_to_local(arriving_with(root, fps)[at], yaw[t])
    return Way(path, facing, going, wanted_speeds(root, fps)[at], at)


def arriving_with(root: NDArray, fps: float) -> NDArray:
    """The velocities [T, 2] with which a root [T, 2] comes to its frames, m/s.

    They come from the frame before: where the root goes next is for the network to tell.
    """
    return np.diff(root, axis=0, prepend=2 * root[:1] - root[1:2]) * fps


def wanted_speeds(root: NDArray, fps: float) -> Array:
    """The speeds [T] that a user would have asked for at frames of a root's way [T, 2], m/s.

    Who asks is ahead of the body: it is the way of the second to come, over that second.
    """
    steps = np.linalg.norm(np.diff(root, axis=0), axis=1)
    ahead = max(1, round(AHEAD * fps))
    way = np.concatenate([[0], np.cumsum(np.concatenate([steps, np.repeat(steps[-1:], ahead)]))])
    return ((way[ahead:] - way[:-ahead]) * (fps / ahead)).astype(np.float32)
