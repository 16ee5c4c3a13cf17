"""What the numbers are that the Decompressor puts out: a pose as one vector."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from motion import quat
from motion.pose import Poses

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Layout:
    """The vector of a pose of so many joints (the ground root is joint 0) and contacts (REFERENCE 3.1).

    In this order, D = 15 (J - 1) + 6 + C numbers: of the joints but the root local positions (3 each),
    rotations (6: the matrix's first two columns, row by row), velocities (3) and angular velocities (3); the
    root's velocity (3) and angular velocity (3) in its own space; contacts (C, 0 or 1).
    """

    joints: int
    contacts: int

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Columns by block."""
        n = self.joints - 1
        sizes = {
            "positions": 3 * n,
            "rotations": 6 * n,
            "velocities": 3 * n,
            "angular_velocities": 3 * n,
            "root_velocity": 3,
            "root_angular_velocity": 3,
            "contacts": self.contacts,
        }
        stops = np.cumsum(list(sizes.values())).tolist()
        return {name: slice(stop - sizes[name], stop) for name, stop in zip(sizes, stops, strict=True)}

    @property
    def size(self) -> int:
        """D."""
        return 15 * (self.joints - 1) + 6 + self.contacts

    def pack(self, database: Database, frames: slice | NDArray = slice(None)) -> Array:
        """Vectors [T, D] of a database's frames."""
        poses = database.poses[frames]
        back = quat.inv(np.asarray(poses.rotations[:, 0]))
        blocks = (
            poses.positions[:, 1:],
            columns(poses.rotations[:, 1:]),
            poses.velocities[:, 1:],
            poses.angular_velocities[:, 1:],
            quat.rotate(back, poses.velocities[:, 0]),
            quat.rotate(back, poses.angular_velocities[:, 0]),
            database.contacts[frames],
        )
        flat = [np.asarray(block, np.float32).reshape(len(poses), -1) for block in blocks]
        return np.concatenate(flat, axis=1)

    def unpack(self, vectors: Array, fps: float) -> tuple[Poses, NDArray[np.uint8]]:
        """Poses [N] and contacts [N, C] of vectors [N, D]; joint 0 as Decompression gives it (`mm.kernels`).

        Rotations are made orthonormal by Gram-Schmidt. Over the frame the root turns by its angular velocity
        and goes by its velocity, seen in the middle of the turn; contacts are what exceeds 1/2.
        """
        count, parts = len(vectors), {name: vectors[:, part] for name, part in self.slices.items()}
        poses = Poses.empty(count, self.joints)
        shape = (count, self.joints - 1, 3)
        poses.positions[:, 1:] = parts["positions"].reshape(shape)
        poses.rotations[:, 1:] = rotations(parts["rotations"].reshape(count, -1, 3, 2))
        poses.velocities[:, 1:] = parts["velocities"].reshape(shape)
        poses.angular_velocities[:, 1:] = parts["angular_velocities"].reshape(shape)
        vx, vz = parts["root_velocity"][:, 0], parts["root_velocity"][:, 2]
        rate = parts["root_angular_velocity"][:, 1]
        half = rate / (2 * fps)
        poses.positions[:, 0, 0] = (np.cos(half) * vx + np.sin(half) * vz) / fps
        poses.positions[:, 0, 2] = (np.cos(half) * vz - np.sin(half) * vx) / fps
        poses.rotations[:, 0] = 0
        poses.rotations[:, 0, 0], poses.rotations[:, 0, 2] = np.cos(half), np.sin(half)
        poses.velocities[:, 0, 0], poses.velocities[:, 0, 2] = vx, vz
        poses.angular_velocities[:, 0, 1] = rate
        return poses, (parts["contacts"] > 0.5).astype(np.uint8)


def columns(rotations: NDArray) -> Array:
    """The first two columns [..., 3, 2] of the matrices of quaternions [..., 4]."""
    return quat.to_matrix(np.asarray(rotations))[..., :2].astype(np.float32)


def rotations(xy: Array) -> Array:
    """Quaternions [..., 4] of two columns [..., 3, 2] each, made orthonormal by Gram-Schmidt.

    Those without direction turn nothing; what is no number stays none.
    """
    x = xy[..., 0] / np.maximum(np.linalg.norm(xy[..., 0], axis=-1, keepdims=True), 1e-8)
    z = np.cross(x, xy[..., 1])
    length = np.linalg.norm(z, axis=-1, keepdims=True)
    z /= np.where(length < 1e-8, 1, length)
    found = quat.from_matrix(np.stack([x, np.cross(z, x), z], axis=-1))
    found = np.where(length < 1e-8, quat.identity(), found)
    return np.where(np.isnan(length), np.nan, found).astype(np.float32)
