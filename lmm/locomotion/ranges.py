"""A range of a database as the vectors of its frames need it: in root space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.labels import Labels
from mm.database import Database
from motion import kinematics, quat
from motion.pose import Poses
from motion.skeleton import Skeleton

from .labelling import kept
from .window import Blocks, size

Array = NDArray[np.float32]
Frames = NDArray[np.int64]

USUAL = 4000  # frames, evenly spread, that tell how joints usually are turned


@dataclass(frozen=True, eq=False)
class Range:
    """T frames; J joints without the ground root.

    Attributes
    ----------
    root : float64 [T, 2], x, z in the world, metres.
    yaw : [T], radians.
    positions, rotations : [T, J, 3], [T, J, 4] of the joints in their frame's root space.
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
        root, yaw = roots(poses)
        local, turned = _in_root_space(database.skeleton, poses)
        world, _ = kinematics.forward(
            database.skeleton, poses.positions.astype(np.float64), poses.rotations.astype(np.float64)
        )
        back = quat.inv(quat.from_yaw(yaw.astype(np.float64)))
        moving = quat.rotate(back[:-1, None], np.diff(world[:, 1:], axis=0)) * database.fps
        return Range(root, yaw, local, turned, moving.astype(np.float32))


def roots(poses: Poses) -> tuple[NDArray, NDArray]:
    """Roots' x, z in the world, float64 [T, 2] in metres, and yaws [T] in radians."""
    return poses.positions[:, 0][:, [0, 2]].astype(np.float64), quat.yaw(poses.rotations[:, 0])


def usual_rotations(database: Database) -> Array:
    """The rotation in root space [J, 4] around which those of each joint lie, without the ground root.

    A rotation has two quaternions. A network is to learn that of every frame which is nearer to this one
    (`quat.towards`): were signs kept from frame to frame, they would differ from clip to clip. It is the
    largest eigenvector of the sum of q q^T (Markley, Cheng, Crassidis and Oshman 2007).
    """
    poses = database.poses[slice(None, None, max(1, len(database) // USUAL))]
    turned = _in_root_space(database.skeleton, poses)[1].astype(np.float64)
    _, vectors = np.linalg.eigh(np.einsum("tja,tjb->jab", turned, turned))
    return quat.shortest(vectors[..., -1]).astype(np.float32)


def _in_root_space(skeleton: Skeleton, poses: Poses) -> tuple[NDArray, NDArray]:
    """Positions [T, J, 3] and rotations [T, J, 4] of all joints but the root."""
    positions, rotations = (np.array(a) for a in (poses.positions, poses.rotations))
    positions[:, 0], rotations[:, 0] = 0, quat.identity()
    local, turned = kinematics.forward(skeleton, positions, rotations)
    return local[:, 1:], turned[:, 1:]


def spans(database: Database, labels: Labels) -> list[tuple[int, int]]:
    """First and one past the last frame of the ranges that have vectors: those that the labels do not leave
    out (`lmm.locomotion.labelling`), of more than two frames. A ValueError where labels are of another number
    of frames."""
    if len(labels) != len(database):
        raise ValueError(f"labels of {len(labels)} frames for a database of {len(database)}")
    both = zip(database.starts.tolist(), database.stops.tolist(), kept(database, labels), strict=True)
    return [(start, stop) for start, stop, keep in both if keep and stop - start > 2]


def of_all(
    database: Database,
    labels: Labels,
    layout: Blocks,
    vectors: Callable[[int, int], tuple[Array, Array, Frames]],
) -> tuple[Array, Array, Frames]:
    """Vectors x [M, I] and y [M, O] of all frames but the first and the last of each range, and which [M].

    vectors gives those of the range from one frame to another. Ranges without any: see `spans`.
    """
    # Filled range by range: one array of all frames is the most that is held.
    found = spans(database, labels)
    count = sum(stop - start - 2 for start, stop in found)
    x, y = (np.empty((count, size(blocks)), np.float32) for blocks in (layout.inputs, layout.outputs))
    frame, at = np.empty(count, np.int64), 0
    for start, stop in found:
        rows = slice(at, at + stop - start - 2)
        x[rows], y[rows], frame[rows] = vectors(start, stop)
        at = rows.stop
    return x, y, frame
