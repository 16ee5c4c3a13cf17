"""Other axes, handedness and units than ours (Y up, +Z forward, right-handed, metres), in and out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .clip import Clip
from .errors import UserError

AXES = ("x", "y", "z", "-x", "-y", "-z")
HANDEDNESS = ("right", "left")


def convert(
    clip: Clip,
    *,
    up: str = "y",
    forward: str = "z",
    handedness: str = "right",
    scale: float = 1.0,
    inverse: bool = False,
) -> Clip:
    """Express a clip in other axes: every vector v becomes scale B v, every rotation R becomes B R B^T.

    B takes our left, up and forward to theirs (`basis`). It changes the rest pose along with the motion, as
    programs with such axes expect. Convert only on the way out; with inverse the clip given is in the other
    axes and the result in ours (and divided by scale).

    Errors: UserError for unknown or equal axes or another handedness.
    """
    matrix = basis(up, forward, handedness)
    factor = 1 / scale if inverse else scale
    matrix = matrix.T if inverse else matrix
    # A rotation's axis is a pseudovector: a reflection turns it round.
    turn = np.eye(4)
    turn[1:, 1:] = np.linalg.det(matrix) * matrix
    linear = factor * matrix
    skeleton = replace(
        clip.skeleton,
        offsets=clip.skeleton.offsets @ linear.T,
        end_sites={j: linear @ offset for j, offset in clip.skeleton.end_sites.items()},
    )
    return clip.replace(
        skeleton=skeleton, positions=clip.positions @ linear.T, rotations=clip.rotations @ turn.T
    )


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


def _axis(name: str) -> NDArray[np.float64]:
    plain = name.lower().removeprefix("+")
    if plain not in AXES:
        raise UserError(f"unknown axis {name!r}", remedy=f"choose one of {', '.join(AXES)}")
    axis = np.zeros(3)
    axis["xyz".index(plain[-1])] = -1.0 if plain.startswith("-") else 1.0
    return axis
