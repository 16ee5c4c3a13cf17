"""Phase from foot contacts (REFERENCE 4.2): the right foot comes down at 0, the left one at pi."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import strides
from motion.errors import UserError

from . import contacts as touching

Array = NDArray[np.float64]

_REMEDY = "leave the phase out, or correct the contacts by hand"


def from_contacts(names: Sequence[str], contacts: NDArray[Any], fps: float) -> Array:
    """Phase [T], radians in 0 to 2 pi, of contacts [T, C] of the parts named (see `features.contacts`).

    Its rate is positive everywhere: slow in a stand, whole turns between two strikes of one foot, so that a
    missed contact does no harm. A body on all fours, a foot that never touches the ground, or feet of which
    none comes down although they do not stand, are a UserError.
    """
    if any(name.endswith("hand") for name in names):
        raise UserError("no phase for a body on all fours: it is of two feet", remedy="leave the phase out")
    feet = touching.feet(names, contacts, fps)
    for side, on in zip(("left", "right"), feet.T, strict=True):
        if not on.any():
            what = "neither foot" if not feet.any() else f"the {side} foot never"
            what = f"{what} touches the ground: no phase without contacts of both feet"
            raise UserError(what, remedy=_REMEDY)
    time = np.arange(len(feet)) / fps
    left, right = (stances(on, fps) for on in feet.T)
    try:
        return strides.phase(time, left, right)
    except ValueError as error:
        raise UserError(f"no walkable gait: {error}", remedy=_REMEDY) from error


def stances(on: NDArray[np.bool_], fps: float) -> Array:
    """Stances [S, 2] of a foot that stands where on [T] is true: seconds at which each begins and ends.

    One that holds at an end of the clip goes on beyond it.
    """
    found = np.array(touching.spans(on), np.float64).reshape(-1, 2) / fps
    if len(found) and on[0]:
        found[0, 0] = -np.inf
    if len(found) and on[-1]:
        found[-1, 1] = np.inf
    return found


def rate(phase: NDArray[np.floating], fps: float) -> Array:
    """Rate of a phase [T], rad/s [T], by the step to the next frame; the last one is that before it."""
    steps = np.mod(np.diff(np.asarray(phase, np.float64)), 2 * np.pi) * fps
    return np.concatenate([steps, steps[-1:]]) if len(steps) else np.zeros(len(phase))
