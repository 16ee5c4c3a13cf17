"""A range of a database as the vectors of its frames need it: in root space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from motion import kinematics, quat


@dataclass(frozen=True, eq=False)
class Range:
    """T frames; J joints without the ground root.

    Attributes
    ----------
    root : float64 [T, 2], x, z in the world, metres.
    yaw : [T], radians.
    positions, rotations : [T, J, 3], [T, J, 4] of the joints in their frame's root space; rotations keep
        their sign from frame to frame.
    velocities : float32 [T - 1, J, 3], m/s, to the next frame, in root space.
    """

    root: NDArray
    yaw: NDArray
    positions: NDArray
    rotations: NDArray
    velocities: NDArray[np.float32]

    @staticmethod
    def of(database: Database, start: int, stop: int) -> Range:
        """Frames start to stop of a database."""
        poses = database.poses[slice(start, stop)]
        root, yaw = poses.positions[:, 0][:, [0, 2]].astype(np.float64), quat.yaw(poses.rotations[:, 0])
        positions, rotations = (np.array(a) for a in (poses.positions, poses.rotations))
        positions[:, 0], rotations[:, 0] = 0, quat.identity()
        local, turned = kinematics.forward(database.skeleton, positions, rotations)
        world, _ = kinematics.forward(
            database.skeleton, poses.positions.astype(np.float64), poses.rotations.astype(np.float64)
        )
        back = quat.inv(quat.from_yaw(yaw.astype(np.float64)))
        moving = quat.rotate(back[:-1, None], np.diff(world[:, 1:], axis=0)) * database.fps
        unrolled = kinematics.unroll(turned)[:, 1:]
        return Range(root, yaw, local[:, 1:], unrolled, moving.astype(np.float32))
