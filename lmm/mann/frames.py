"""The vectors of a database's frames: what a mode-adaptive network is trained on (REFERENCE 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features import gait as gaits
from features import trajectory as ground_plane
from features.labels import Labels
from mm.database import Database
from motion import kinematics, springs

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


def labels_of(database: Database) -> Labels:
    """Labels without a phase of all frames, of two feet or four: the database's own contacts, and gaits.

    Ranges are labelled one by one. A skeleton without hips or feet is a UserError.
    """
    names, contacts = database.contact_roles, np.asarray(database.contacts)
    found = np.zeros((len(database), len(gaits.GAITS)), np.float32)
    for start, stop in zip(database.starts.tolist(), database.stops.tolist(), strict=True):
        part = slice(start, stop)
        poses = database.poses[part]
        world, _ = kinematics.forward(database.skeleton, poses.positions, poses.rotations)
        gait = gaits.decide(database.skeleton, database.fps, world, names, contacts[part])
        found[part] = gaits.weights(gait, database.fps)
    return Labels(names, contacts, None, found)


def frames(database: Database, labels: Labels) -> Frames:
    """Vectors of all frames but the first and the last of each range.

    labels are of all frames of the database; their gaits are the actions. Before a range begins and after it
    ends, the root is taken to go on as it did there, facing where it faced.
    """
    if len(labels) != len(database):
        raise ValueError(f"labels of {len(labels)} frames for a database of {len(database)}")
    layout = Layout(len(database.skeleton) - 1, len(labels.names))
    parts = [
        _range(database, labels, layout, int(start), int(stop))
        for start, stop in zip(database.starts, database.stops, strict=True)
        if stop - start > 2
    ]
    if not parts:
        x, y = (np.zeros((0, size), np.float32) for size in (layout.input_size, layout.output_size))
        return Frames(x, y, np.zeros(0, np.int64))
    x, y, frame = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Frames(x, y, frame)


def _range(
    database: Database, labels: Labels, layout: Layout, start: int, stop: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    fps, spacing = database.fps, interval(database.fps)
    part = Range.of(database, start, stop)
    root, yaw = part.root, part.yaw
    # Velocities come from the frame before: where the root goes next is for the network to tell.
    arriving = np.diff(root, axis=0, prepend=2 * root[:1] - root[1:2]) * fps
    wanted = wanted_speeds(root, fps)

    t = np.arange(1, stop - start - 1)
    path, facing, at = around(root, yaw, t, spacing * np.arange(-PRESENT, FUTURE))
    x = layout.pack_inputs(
        Inputs(
            path=path,
            facing=facing,
            gaits=labels.gait[start + at],
            going=ground_plane.directions_to_local(arriving[at], yaw[t]),
            speeds=wanted[at],
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


def wanted_speeds(root: NDArray, fps: float) -> Array:
    """The speeds [T] that a user would have asked for at frames of a root's way [T, 2], m/s.

    Who asks is ahead of the body: it is the way of the second to come, over that second.
    """
    steps = np.linalg.norm(np.diff(root, axis=0), axis=1)
    ahead = max(1, round(AHEAD * fps))
    way = np.concatenate([[0], np.cumsum(np.concatenate([steps, np.repeat(steps[-1:], ahead)]))])
    return ((way[ahead:] - way[:-ahead]) * (fps / ahead)).astype(np.float32)
