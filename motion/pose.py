"""Poses with velocities: many frames of a clip, or many characters at one instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import kinematics
from .clip import Clip


@dataclass(eq=False)
class Poses:
    """Local joint transforms and their rates, in the parent's frame (joint 0: the ground root, in the world).

    Attributes
    ----------
    positions : float32 [T or N, J, 3], metres.
    rotations : float32 [T or N, J, 4], unit quaternions.
    velocities : float32 [T or N, J, 3], m/s.
    angular_velocities : float32 [T or N, J, 3], rad/s.
    """

    positions: NDArray[np.float32]
    rotations: NDArray[np.float32]
    velocities: NDArray[np.float32]
    angular_velocities: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, index: slice | NDArray) -> Poses:
        return Poses(*(array[index] for array in self.arrays().values()))

    def __setitem__(self, index: slice | NDArray, poses: Poses) -> None:
        for array, values in zip(self.arrays().values(), poses.arrays().values(), strict=True):
            array[index] = values

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The four arrays by name."""
        return {
            "positions": self.positions,
            "rotations": self.rotations,
            "velocities": self.velocities,
            "angular_velocities": self.angular_velocities,
        }

    def copy(self) -> Poses:
        return Poses(*(array.copy() for array in self.arrays().values()))

    @staticmethod
    def empty(count: int, joints: int) -> Poses:
        """count poses of the identity at the origin, at rest."""
        rotations = np.zeros((count, joints, 4), np.float32)
        rotations[..., 0] = 1
        zeros = (np.zeros((count, joints, 3), np.float32) for _ in range(3))
        positions, velocities, angular = zeros
        return Poses(positions, rotations, velocities, angular)

    @staticmethod
    def of_clip(clip: Clip) -> Poses:
        """Poses of a clip, velocities by central differences."""
        return Poses(
            clip.positions.astype(np.float32),
            clip.rotations.astype(np.float32),
            kinematics.velocities(clip.positions, clip.fps).astype(np.float32),
            kinematics.angular_velocities(clip.rotations, clip.fps).astype(np.float32),
        )
