"""How far a phase-functioned network drifts that runs on its own output under the true trajectory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmm.pfnn.frames import Frames
from lmm.pfnn.layout import Layout

Array = NDArray[np.float32]


class Phased(Protocol):
    """A network: outputs [N, O] of inputs [N, I] at phases [N]; one that runs, or that is being trained."""

    def evaluate(self, x: Array, phases: NDArray[np.floating], /) -> Array: ...


def windows(frame: NDArray[np.int64], length: int) -> NDArray[np.int64]:
    """Rows of `lmm.pfnn.frames.Frames` at which so many begin that follow each other in one range."""
    last = len(frame) - length + 1
    if last <= 0:
        return np.zeros(0, np.int64)
    return np.flatnonzero(frame[length - 1 :] - frame[:last] == length - 1)


def free_run(
    network: Phased, frames: Frames, rows: NDArray[np.int64], layout: Layout, *, fps: float, steps: int
) -> Iterator[Array]:
    """Outputs [N, O] after 1, 2, .. steps from rows [N], of which steps begin (`windows`).

    Joints and the phase go on from what the network puts out, as they do when characters are driven, but for
    their smoothing; trajectory, gait and ground are those of the data.
    """
    joints = slice(layout.inputs["positions"].start, layout.inputs["velocities"].stop)
    own = slice(layout.outputs["positions"].start, layout.outputs["velocities"].stop)
    phases = frames.phase[rows].astype(np.float64)
    y: Array | None = None
    for step in range(steps):
        x = frames.x[rows + step]
        if y is not None:
            x[:, joints] = y[:, own]
            phases = phases + y[:, layout.outputs["phase_rate"].start].astype(np.float64) / fps
        y = network.evaluate(x, phases)
        yield y


def joint_errors(found: Array, truth: Array, layout: Layout) -> NDArray[np.float32]:
    """Distances [N] of the joints of outputs [N, O] from the true ones in root space, their means, cm."""
    block = layout.outputs["positions"]
    away = (found[:, block] - truth[:, block]).reshape(len(found), -1, 3)
    return 100 * np.linalg.norm(away, axis=-1).mean(axis=1)
