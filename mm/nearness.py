"""How near poses are to others: to those of another system that is asked the same, and to those of the data.

Poses are joint positions in the ground root's space without the root itself (`mm.quality.in_root_space`), so
that where the characters are, and where they look, does not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import quality

if TYPE_CHECKING:
    from .database import Database
    from .recording import Recording

Array = NDArray[np.floating]

CHUNK = 8192
SAMPLED = 300  # frames of a run


def difference(poses: Array, others: Array, *, window: int = 0) -> NDArray[np.float64]:
    """Mean distance of the joints, in cm [T], of poses [T, J, 3] to others [T, J, 3] (metres), root-aligned.

    Two characters that are asked the same soon walk out of step, and most of what differs is where in the
    stride they are. With a window each pose is compared with the nearest one that the other shows within so
    many frames before and after, which leaves what differs in kind.
    """
    poses, others = np.asarray(poses, np.float64), np.asarray(others, np.float64)
    if poses.shape != others.shape:
        raise ValueError(f"poses {poses.shape} and others {others.shape}")
    least, window = np.full(len(poses), np.inf), min(window, len(poses) - 1)
    for shift in range(-window, window + 1):
        here = slice(max(0, -shift), len(poses) - max(0, shift))
        there = slice(max(0, shift), len(poses) - max(0, -shift))
        apart = np.linalg.norm(poses[here] - others[there], axis=-1).mean(axis=-1)
        least[here] = np.minimum(least[here], apart)
    return 100 * least


def to_nearest(database: Database, poses: Array) -> NDArray[np.float64]:
    """Mean distance of the joints, in cm [S], of poses [S, J, 3] (metres) to the nearest pose of a database.

    What `RealPoses.distances` tells, by looking at all poses once: for few poses, and data of any size.
    """
    flat = np.asarray(poses, np.float64).reshape(len(poses), -1)
    least, nearest = np.full(len(flat), np.inf), np.empty_like(flat)
    for start in range(0, len(database), CHUNK):
        chunk = database.poses[slice(start, start + CHUNK)]
        local = quality.in_root_space(database.skeleton, chunk.positions, chunk.rotations)
        real = local.reshape(len(local), -1).astype(np.float32)
        apart = (real**2).sum(axis=1)[:, None] - 2 * (
            real @ flat.T
        )  # less what is the same for all real ones
        best = apart.argmin(axis=0)
        closer = apart[best, np.arange(len(flat))] < least
        least[closer] = apart[best[closer], np.flatnonzero(closer)]
        nearest[closer] = real[best[closer]]
    away = (flat - nearest).reshape(len(flat), -1, 3)
    return 100 * np.linalg.norm(away, axis=-1).mean(axis=-1)


class RealPoses:
    """The poses of a database, to ask how far from the nearest of them a pose is.

    Every frame counts, mirrored ones too. Holds the poses twice, as float32 and as a tree of float64.
    """

    def __init__(self, database: Database) -> None:
        from scipy.spatial import cKDTree

        frames, columns = len(database), 3 * (len(database.skeleton) - 1)
        self._poses = np.empty((frames, columns), np.float32)
        for start in range(0, frames, CHUNK):
            poses = database.poses[slice(start, start + CHUNK)]
            local = quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
            self._poses[start : start + len(local)] = local.reshape(len(local), columns)
        # Turned so that the first axes are those along which poses differ most, a tree has to look at less.
        moments = np.cov(self._poses, rowvar=False, bias=True).reshape(columns, columns)
        self._axes = np.linalg.eigh(moments)[1][:, ::-1]
        self._tree = cKDTree(self._poses @ self._axes)

    def distances(self, poses: Array) -> NDArray[np.float64]:
        """Mean distance of the joints, in cm [S], of poses [S, J, 3] (metres) to the nearest real one.

        The nearest is the one with the least mean square distance of the joints.
        """
        flat = np.asarray(poses, np.float64).reshape(len(poses), -1)
        _, nearest = self._tree.query(flat @ self._axes)
        apart = (flat - self._poses[nearest]).reshape(len(poses), -1, 3)
        return 100 * np.linalg.norm(apart, axis=-1).mean(axis=-1)

    def of_run(self, run: Recording) -> float:
        """Mean of `distances` of a recording's first character, of evenly spread frames, 300 at the most."""
        some = np.linspace(0, len(run) - 1, min(SAMPLED, len(run))).astype(np.int64)
        local = quality.in_root_space(run.skeleton, run["positions"][some, 0], run["rotations"][some, 0])
        return float(self.distances(local).mean())
