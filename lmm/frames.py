"""What the Compressor sees of a frame, and the Projector of a query."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from motion import kinematics

from .layout import Layout, columns

Array = NDArray[np.float32]


def compressor_size(layout: Layout) -> int:
    """Numbers of a vector of `compressor_inputs`."""
    return layout.size + 15 * (layout.joints - 1)


def compressor_inputs(database: Database, frames: slice | NDArray = slice(None)) -> Array:
    """Vectors [T, D + 15 (J - 1)]: a frame's `Layout` vector, then the joints in the root's space.

    Of each joint but the root: positions (3), rotations (6, two columns), velocities (3) and angular
    velocities (3), without the root's own motion (REFERENCE 3.2).
    """
    layout = Layout(len(database.skeleton), len(database.contact_roles))
    poses = database.poses[frames]
    local = [np.array(array) for array in poses.arrays().values()]
    local[0][:, 0], local[2][:, 0], local[3][:, 0] = 0, 0, 0
    local[1][:, 0] = (1, 0, 0, 0)
    positions, rotations, velocities, angular = kinematics.forward_velocities(database.skeleton, *local)
    blocks = positions[:, 1:], columns(rotations[:, 1:]), velocities[:, 1:], angular[:, 1:]
    flat = [np.asarray(block, np.float32).reshape(len(poses), -1) for block in blocks]
    return np.concatenate([layout.pack(database, frames), *flat], axis=1)


def projector_inputs(queries: Array, crouch_tag: int, asked: NDArray[np.uint32]) -> Array:
    """Vectors [M, F + 1]: queries [M, F], then 1 where tags asked for [M] have crouching, else 0.

    Where the data does not divide into crouched and upright frames, and the tag is 0, the queries alone.
    """
    if not crouch_tag:
        return queries
    crouched = (asked & np.uint32(crouch_tag)) != 0
    return np.concatenate([queries, crouched[:, None].astype(np.float32)], axis=1)
