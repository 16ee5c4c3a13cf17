"""Weights as a function of the phase: a closed cubic Catmull-Rom spline over four points (REFERENCE 4.1).

Three ways to evaluate it: from the four points at every phase (cubic), or from sets that the spline was
evaluated to beforehand, between two of ten (linear) or the nearest of fifty (constant).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.errors import UserError

Mode = Literal["cubic", "linear", "constant"]
CONTROLS = 4
SETS: dict[Mode, int] = {"cubic": CONTROLS, "linear": 10, "constant": 50}  # weight sets that are held
USED: dict[Mode, int] = {"cubic": CONTROLS, "linear": 2, "constant": 1}  # of these, how many a phase needs


def check_mode(mode: str) -> None:
    """A UserError unless there is such a way to evaluate the spline."""
    if mode not in get_args(Mode):
        raise UserError(f"no phase mode {mode!r}", remedy=f"choose from {', '.join(get_args(Mode))}")


def coefficients(phases: ArrayLike) -> NDArray[np.float64]:
    """What each control point counts at phases [...], radians: [..., 4], each row of sum 1.

    With w = 4p/(2 pi) mod 1 and k_n = floor(4p/(2 pi)) + n - 1 mod 4 the spline is
    a1 + w(a2 - a0)/2 + w^2(a0 - 5/2 a1 + 2 a2 - 1/2 a3) + w^3(3/2 a1 - 3/2 a2 + 1/2 a3 - 1/2 a0).
    """
    place = np.asarray(phases, np.float64) * (CONTROLS / (2 * np.pi))
    first = np.floor(place)
    w = place - first
    shares = (
        -w / 2 + w**2 - w**3 / 2,
        1 - 5 / 2 * w**2 + 3 / 2 * w**3,
        w / 2 + 2 * w**2 - 3 / 2 * w**3,
        -(w**2) / 2 + w**3 / 2,
    )
    out = np.zeros((*w.shape, CONTROLS))
    for n, share in enumerate(shares):
        point = np.mod(first + n - 1, CONTROLS).astype(np.int64)
        np.put_along_axis(out, point[..., None], share[..., None], axis=-1)
    return out


def shares(phases: ArrayLike, mode: Mode) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which sets phases [...] need, and what each counts.

    Returns the first set [...] and shares [..., U] of it and the U - 1 that follow, round the cycle.
    """
    if mode == "cubic":
        found = coefficients(phases)
        return np.zeros(found.shape[:-1], np.int64), found
    count = SETS[mode]
    place = np.asarray(phases, np.float64) * (count / (2 * np.pi))
    if mode == "constant":
        return np.mod(np.floor(place + 0.5), count).astype(np.int64), np.ones((*place.shape, 1))
    first = np.floor(place)
    w = place - first
    return np.mod(first, count).astype(np.int64), np.stack([1 - w, w], axis=-1)


def sets(controls: NDArray[np.floating], mode: Mode) -> NDArray[np.floating]:
    """The weight sets [S, ...] that a mode holds, of control points [4, ...]; their type stays.

    Sums are float32's, whatever the type.
    """
    if mode == "cubic":
        return controls
    grid = 2 * np.pi / SETS[mode] * np.arange(SETS[mode])
    blended = np.tensordot(coefficients(grid).astype(np.float32), controls.astype(np.float32), axes=1)
    return blended.astype(controls.dtype)
