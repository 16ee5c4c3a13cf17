"""The vectors of a database's frames: what a phase-functioned network is trained on (REFERENCE 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from features import trajectory as ground_plane
from features.labels import Labels
from mm.database import Database
from motion import quat, springs

from ..locomotion import ranges
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


def frames(database: Database, labels: Labels) -> Frames:
    """Vectors of all frames but the first and the last of each range, on level ground.

    labels are of all frames of the database. Before a range begins and after it ends, the root is taken to go
    on as it did there, facing where it faced. Ranges that the labels leave out have none. Other grounds: see
    `lmm.locomotion.grounds`.
    """
    if labels.phase is None:
        raise ValueError("labels without a phase")
    layout = Layout(len(database.skeleton) - 1, len(labels.names))
    usual = ranges.usual_rotations(database)
    x, y, frame = ranges.of_all(database, labels, layout, partial(_range, database, labels, layout, usual))
    return Frames(x, y, labels.phase[frame], frame)


def _range(
    database: Database, labels: Labels, layout: Layout, usual: Array, start: int, stop: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    fps, spacing = database.fps, interval(database.fps)
    part = Range.of(database, start, stop)
    root, yaw, local, turned, moving = part.root, part.yaw, part.positions, part.rotations, part.velocities

    t = np.arange(1, stop - start - 1)
    path, facing, at = around(root, yaw, t, spacing * np.arange(-PRESENT, FUTURE))
    x = layout.pack_inputs(
        Inputs(
            path=path,
            facing=facing,
            gaits=labels.gait[start + at],
            positions=local[t - 1],
            velocities=moving[t - 1],
            heights=np.zeros((len(t), SAMPLES, SIDES), np.float32),
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
            rotations=quat.towards(turned[t], usual),
        )
    )
    return x, y, start + t
