"""What the Compressor sees of a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from motion import kinematics

from .layout import Layout, columns

Array = NDArray[np.float32]


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
