"""The vectors of a database's frames: what a phase-functioned network is trained on (REFERENCE 4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features import trajectory as ground_plane
from features.labels import Labels
from mm.database import Database
from motion import springs

from ..locomotion.ranges import Range
from ..locomotion.trajectory import interval
from ..locomotion.window import FUTURE, PRESENT, SAMPLES, SIDES, around
from .layout import Inputs, Layout, Outputs

Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Frames:
    """M frames with one before and one after them in their range.

    Attributes
    ----------
    x, y : float32 [M, I], [M, O], by `lmm.pfnn.layout`, y without any normalisation.
    phase : float32 [M], radians.
    frame : int64 [M], which of the database.
    """

    x: Array
    y: Array
    phase: Array
    frame: NDArray[np.int64]


def frames(database: Database, labels: Labels, *, heights: Array | None = None) -> Frames:
    """Vectors of all frames but the first and the last of each range.

    labels are of all frames of the database. heights [T, 12, 3], metres over the root's, are those of the
    ground along the trajectory; flat by default. Before a range begins and after it ends, the root is taken
    to go on as it did there, facing where it faced.
    """
    if labels.phase is None or len(labels) != len(database):
        raise ValueError(f"labels of {len(labels)} frames for a database of {len(database)}, with phases")
    layout = Layout(len(database.skeleton) - 1, len(labels.names))
    # Filled range by range: one array of all frames is the most that is held.
    lengths = np.maximum(database.stops.astype(np.int64) - database.starts - 2, 0)
    count = int(lengths.sum())
    x, y = (np.empty((count, size), np.float32) for size in (layout.input_size, layout.output_size))
    frame, at = np.empty(count, np.int64), 0
    for start, length in zip(database.starts.tolist(), lengths.tolist(), strict=True):
        if length:
            rows = slice(at, at + length)
            x[rows], y[rows], frame[rows] = _range(
                database, labels, heights, layout, start, start + length + 2
            )
            at += length
    return Frames(x, y, labels.phase[frame], frame)


def _range(
    database: Database, labels: Labels, heights: Array | None, layout: Layout, start: int, stop: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    fps, spacing = database.fps, interval(database.fps)
    part = Range.of(database, start, stop)
    root, yaw, local, turned, moving = part.root, part.yaw, part.positions, part.rotations, part.velocities

    t = np.arange(1, stop - start - 1)
    path, facing, at = around(root, yaw, t, spacing * np.arange(-PRESENT, FUTURE))
    beyond = np.zeros((len(t), SAMPLES, SIDES), np.float32)
    x = layout.pack_inputs(
        Inputs(
            path=path,
            facing=facing,
            gaits=labels.gait[start + at],
            positions=local[t - 1],
            velocities=moving[t - 1],
            heights=beyond if heights is None else heights[start + t],
        )
    )
    path, facing, _ = around(root, yaw, t + 1, spacing * np.arange(FUTURE))
    step = ground_plane.directions_to_local(np.diff(root, axis=0)[t, None], yaw[t])[:, 0]
    phase = np.asarray(labels.phase, np.float64)[start:stop]
    y = layout.pack_outputs(
        Outputs(
            root_velocity=step * fps,
            turn_rate=springs.wrap(yaw[t + 1] - yaw[t]) * fps,
            phase_rate=springs.wrap(phase[t + 1] - phase[t]) * fps,
            contacts=labels.contacts[start + t].astype(np.float32),
            path=path,
            facing=facing,
            positions=local[t],
            velocities=moving[t],
            rotations=turned[t],
        )
    )
    return x, y, start + t
