"""How a body sways about the way that it goes.

The root goes where the body does, which sways with every step: so a trajectory tells a network where in its
step the body is, and one without a phase learns to read it there. Nobody who asks for a way sways: on a
straight one it would stop stepping, and glide.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.labels import Labels
from mm.database import Database

from ..locomotion import ranges
from ..locomotion.window import PRESENT, SAMPLES, beyond
from .frames import Way, way
from .layout import Layout

Array = NDArray[np.float32]

SMOOTH = 0.3  # seconds, deviation of the Gaussian that makes the way smooth
MOST = 0.15  # metres and radians together that a sample is away by sway; further it is by a turn
TOLD = ("path", "facing", "going", "speeds")  # blocks of inputs that sway


def columns(layout: Layout) -> NDArray[np.int64]:
    """The inputs [C] that sway."""
    return np.concatenate([np.arange(layout.input_size)[layout.inputs[block]] for block in TOLD])


def of_past(layout: Layout) -> NDArray[np.bool_]:
    """Which of `columns` [C] tell of the past."""
    return np.tile(np.arange(SAMPLES) < PRESENT, len(columns(layout)) // SAMPLES)


def sways(database: Database, labels: Labels) -> Array:
    """What inputs tell of the way, less what they would on a smooth one, [M, C] of `lmm.mann.frames.frames`.

    Where some sample is away by more than `MOST`, all are less by as much as that one is.
    """
    found = [_range(database, start, stop) for start, stop in ranges.spans(database, labels)]
    return np.concatenate(found)


def _range(database: Database, start: int, stop: int) -> Array:
    root, yaw = ranges.roots(database.poses[slice(start, stop)])
    t, fps = np.arange(1, stop - start - 1), database.fps
    told, calm = way(root, yaw, t, fps), way(*smooth(root, yaw, SMOOTH * fps), t, fps)
    away = np.linalg.norm(
        np.concatenate([told.path - calm.path, told.facing - calm.facing], axis=-1), axis=-1
    ).max(axis=1)
    share = np.minimum(1, MOST / np.maximum(away, 1e-9))
    return (share[:, None] * (_flat(told) - _flat(calm))).astype(np.float32)


def _flat(told: Way) -> NDArray:
    """The columns [M, C] of a way."""
    parts = (told.path, told.facing, told.going, told.speeds[..., None])
    return np.concatenate([np.swapaxes(part, 1, 2).reshape(len(part), -1) for part in parts], axis=1)


def smooth(root: NDArray, yaw: NDArray, frames: float) -> tuple[NDArray, NDArray]:
    """A root [T, 2] and its yaw [T] after a Gaussian of so many frames; beyond the ends they go on as
    `lmm.locomotion.window.beyond` has it."""
    from scipy.ndimage import gaussian_filter1d

    pad = int(np.ceil(4 * frames))
    places, at = beyond(root, np.arange(-pad, len(root) + pad))
    yaws = np.unwrap(yaw.astype(np.float64))[at]
    inner = slice(pad, pad + len(root))
    return gaussian_filter1d(places, frames, axis=0)[inner], gaussian_filter1d(yaws, frames)[inner]
