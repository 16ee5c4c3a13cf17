"""Characters on uneven ground: their feet on it, their bodies as high as their legs allow.

A system calls it after its own pose, whatever made that pose: the ground's heights under root and feet are
asked for, then roots, bodies and legs move (two-bone inverse kinematics, as for feet that are held).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground, heights
from motion.skeleton import Skeleton

from . import ground_kernels, ground_kernels_numpy
from .feet import Legs

HALFLIFE = 0.03  # seconds; in three times that a foot is up most of a step


class GroundFeet:
    """Puts N characters' feet on a ground.

    Parameters
    ----------
    skeleton : joint 0 is the ground root, which is level.
    legs : the limbs that touch the ground, see `mm.description.Description.feet`.
    fps : frames per second.
    count : N.
    ground : any function of heights, see `features.terrain.Ground`.
    follow : poses are made for level ground, at their root's height: root, body and feet rise with the
        ground, and feet lie as it does. Else they are made for this ground (a network that was told of it),
        and only what would sink in comes up, and what hovers in contact comes down.
    halflife : how fast steps are taken, seconds; slopes are followed at once.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        legs: Legs,
        fps: float,
        count: int,
        *,
        ground: Ground,
        follow: bool = True,
        halflife: float = HALFLIFE,
        compiled: bool = True,
    ) -> None:
        self.ground, self.follow, self.halflife, self.dt = ground, follow, halflife, 1 / fps
        self._kernels: Any = ground_kernels if compiled else ground_kernels_numpy
        self._legs = legs
        self._parents = skeleton.parents
        self._under_root = np.flatnonzero(self._parents == 0)
        joints, feet = len(skeleton), len(legs.joints)
        self._levels = np.zeros((count, 1 + 3 * feet), ground_kernels.LEVEL)
        self._places = np.zeros((count, 1 + 4 * feet, 2), np.float32)
        self._touches = np.zeros((count, feet, 3), np.float32)
        self._world_pos = np.zeros((count, joints, 3), np.float32)
        self._world_rot = np.zeros((count, joints, 4), np.float32)
        self._raises = np.zeros((feet, 2))

    def reset(self) -> None:
        """Forget where the characters were: they may be anywhere in the next frame."""
        self._levels[:] = np.zeros((), ground_kernels.LEVEL)

    def apply(
        self, contacts: NDArray[np.uint8], positions: NDArray[np.float32], rotations: NDArray[np.float32]
    ) -> None:
        """Change poses, local positions [N, J, 3] and rotations [N, J, 4], in place; contacts [N, C].

        Once a frame. The arrays must not be those that the system goes on from. Errors: see
        `features.terrain.heights`.
        """
        legs, places = self._legs, self._places
        self._kernels.locate(
            self._levels, self.dt, self._parents, legs.needed, legs.joints, legs.points, positions, rotations,
            self._world_pos, self._world_rot, self._touches, places,
        )  # fmt: skip
        grounds = heights(self.ground, places[..., 0], places[..., 1])
        self._kernels.stand(
            self._levels, grounds, places, self.follow, self.halflife, self.dt, contacts, legs.heights,
            self._parents, legs.joints, legs.hinges, self._under_root, self._touches, self._world_pos,
            self._world_rot, positions, rotations, self._raises,
        )  # fmt: skip
