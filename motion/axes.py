"""Other axes, handedness and units than ours (Y up, +Z forward, right-handed, metres), in and out.

With B the matrix that takes our left, up and forward to theirs, every vector v becomes scale B v, every
rotation R becomes B R B^T. A rotation's axis and an angular velocity are pseudovectors: a reflection also
turns them round, so that they become det(B) B w.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .clip import Clip
from .errors import UserError
from .pose import Poses

AXES = ("x", "y", "z", "-x", "-y", "-z")
HANDEDNESS = ("right", "left")


@dataclass(frozen=True, kw_only=True)
class Convention:
    """Axes and unit of a consumer; every method has its inverse, to it from ours and from it to ours.

    Attributes
    ----------
    up, forward : the axes that point up, and where characters face.
    handedness : "right" or "left".
    scale : the consumer's units a metre, 100 for centimetres.

    Blender's is ``up="z", forward="-y"``; Unity's ``handedness="left"``; Unreal's ``up="z", forward="x",
    handedness="left", scale=100``. Errors: UserError for unknown or equal axes or another handedness.
    """

    up: str = "y"
    forward: str = "z"
    handedness: str = "right"
    scale: float = 1.0

    def __post_init__(self) -> None:
        basis(self.up, self.forward, self.handedness)
        if not 0 < self.scale < np.inf:
            raise UserError(f"a scale of {self.scale}", remedy="give a positive number")

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """B [3, 3]."""
        return basis(self.up, self.forward, self.handedness)

    @property
    def sense(self) -> float:
        """1, or -1 where positive angles turn the other way: where the handedness is not ours."""
        return 1.0 if self.handedness == "right" else -1.0

    def clip_to(self, clip: Clip) -> Clip:
        """A clip of ours for the consumer: the rest pose changes along with the motion."""
        return self._clip(clip, self.matrix, self.scale)

    def clip_from(self, clip: Clip) -> Clip:
        """A clip of the consumer's as ours."""
        return self._clip(clip, self.matrix.T, 1 / self.scale)

    def poses_to(self, poses: Poses, out: Poses | None = None) -> Poses:
        """Poses of ours for the consumer; into out, which may be poses itself, where given."""
        return self._poses(poses, self.matrix, self.scale, out)

    def poses_from(self, poses: Poses, out: Poses | None = None) -> Poses:
        """Poses of the consumer's as ours; into out, which may be poses itself, where given."""
        return self._poses(poses, self.matrix.T, 1 / self.scale, out)

    def ground_to(self, vectors: ArrayLike) -> NDArray[np.floating]:
        """Positions or velocities [..., 2] on our ground (x, z) as the consumer's [..., 3]."""
        vectors = _floats(vectors)
        return vectors @ (self.scale * self.matrix[:, [0, 2]]).T.astype(vectors.dtype)

    def ground_from(self, vectors: ArrayLike) -> NDArray[np.floating]:
        """The consumer's positions or velocities [..., 3] on our ground [..., 2] (x, z); heights go."""
        vectors = _floats(vectors)
        return vectors @ (self.matrix[:, [0, 2]] / self.scale).astype(vectors.dtype)

    def yaw_to(self, yaw: ArrayLike) -> NDArray[np.floating]:
        """Our yaws, or turn rates, [...] as the consumer's.

        Both are 0 facing forward and count about the up axis by the rule of the handedness: ours to the left,
        those of left-handed axes to the right.
        """
        return self.sense * _floats(yaw)

    def yaw_from(self, yaw: ArrayLike) -> NDArray[np.floating]:
        """The consumer's yaws, or turn rates, [...] as ours."""
        return self.sense * _floats(yaw)

    def _turn(self, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
        """What quaternions are multiplied by [4, 4]."""
        turn = np.eye(4)
        turn[1:, 1:] = self.sense * matrix
        return turn

    def _clip(self, clip: Clip, matrix: NDArray[np.float64], scale: float) -> Clip:
        linear = scale * matrix
        skeleton = replace(
            clip.skeleton,
            offsets=clip.skeleton.offsets @ linear.T,
            end_sites={j: linear @ offset for j, offset in clip.skeleton.end_sites.items()},
        )
        return clip.replace(
            skeleton=skeleton,
            positions=clip.positions @ linear.T,
            rotations=clip.rotations @ self._turn(matrix).T,
        )

    def _poses(self, poses: Poses, matrix: NDArray[np.float64], scale: float, out: Poses | None) -> Poses:
        maps = {
            "positions": scale * matrix,
            "rotations": self._turn(matrix),
            "velocities": scale * matrix,
            "angular_velocities": self.sense * matrix,
        }
        found = {name: array @ maps[name].T.astype(array.dtype) for name, array in poses.arrays().items()}
        if out is None:
            return Poses(**found)
        for name, array in out.arrays().items():
            array[:] = found[name]
        return out


def convert(
    clip: Clip,
    *,
    up: str = "y",
    forward: str = "z",
    handedness: str = "right",
    scale: float = 1.0,
    inverse: bool = False,
) -> Clip:
    """`Convention.clip_to`, or with inverse `Convention.clip_from`, by the convention of the options."""
    convention = Convention(up=up, forward=forward, handedness=handedness, scale=scale)
    return convention.clip_from(clip) if inverse else convention.clip_to(clip)


def basis(up: str, forward: str, handedness: str = "right") -> NDArray[np.float64]:
    """B [3, 3], whose columns are the left, up and forward of a character in the other axes.

    In right-handed axes left = up x forward, in left-handed ones the opposite.
    """
    if handedness not in HANDEDNESS:
        raise UserError(f"unknown handedness {handedness!r}", remedy=f"choose {' or '.join(HANDEDNESS)}")
    above, ahead = _axis(up), _axis(forward)
    if above @ ahead != 0:
        raise UserError(
            f"up {up} and forward {forward} lie along one axis", remedy="choose two different axes"
        )
    left = np.cross(above, ahead) * (1.0 if handedness == "right" else -1.0)
    return np.stack([left, above, ahead], axis=-1)


def system(up: str, forward: str | None, handedness: str) -> tuple[str, str, str]:
    """Axes that belong together; forward, where it is not told, is z, or -y where z is up."""
    forward = forward or ("-y" if up.endswith("z") else "z")
    basis(up, forward, handedness)
    return up, forward, handedness


def _axis(name: str) -> NDArray[np.float64]:
    plain = name.lower().removeprefix("+")
    if plain not in AXES:
        raise UserError(f"unknown axis {name!r}", remedy=f"choose one of {', '.join(AXES)}")
    axis = np.zeros(3)
    axis["xyz".index(plain[-1])] = -1.0 if plain.startswith("-") else 1.0
    return axis


def _floats(values: ArrayLike) -> NDArray[Any]:
    values = np.asarray(values)
    return values if np.issubdtype(values.dtype, np.floating) else values.astype(np.float64)
