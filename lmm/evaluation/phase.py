"""How far a network drifts that runs on its own output under the true trajectory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lmm.locomotion.layout import JOINTS, BlockLayout
from lmm.locomotion.window import Blocks

Array = NDArray[np.float32]


class Frames(Protocol):
    """Vectors of frames, see `lmm.pfnn.frames.Frames` and `lmm.mann.frames.Frames`."""

    @property
    def x(self) -> Array: ...

    @property
    def y(self) -> Array: ...

    @property
    def frame(self) -> NDArray[np.int64]: ...


class Evaluated(Protocol):
    """A network: outputs [N, O] of inputs [N, I], of a phase-functioned one at phases [N]; one that runs, or
    that is being trained."""

    def evaluate(self, x: Array, /, *phases: Any) -> Array: ...


def windows(frame: NDArray[np.int64], length: int) -> NDArray[np.int64]:
    """Rows of `Frames` [M] at which so many begin that follow each other in one range."""
    last = len(frame) - length + 1
    if last <= 0:
        return np.zeros(0, np.int64)
    return np.flatnonzero(frame[length - 1 :] - frame[:last] == length - 1)


def free_run(
    network: Evaluated,
    frames: Frames,
    rows: NDArray[np.int64],
    layout: BlockLayout,
    *,
    fps: float,
    steps: int,
) -> Iterator[Array]:
    """Outputs [N, O] after 1, 2, .. steps from rows [N], of which steps begin (`windows`).

    Joints and the phase go on from what the network puts out, as they do when characters are driven, but for
    their smoothing: rotations are made whole. Trajectory, gait and ground are those of the data.
    """
    into, out = joint_columns(layout)
    phase = getattr(frames, "phase", None)
    phases = [] if phase is None else [phase[rows].astype(np.float64)]
    y: Array | None = None
    for step in range(steps):
        x = frames.x[rows + step]
        if y is not None:
            x[:, into] = y[:, out]
            if "rotations" in layout.inputs:
                of_joints = x[:, layout.inputs["rotations"]].reshape(len(x), layout.joints, -1)
                whole = layout.written(layout.turned(of_joints))
                x[:, layout.inputs["rotations"]] = whole.reshape(len(x), -1)
            for turned in phases:
                turned += y[:, layout.outputs["phase_rate"].start].astype(np.float64) / fps
        y = network.evaluate(x, *phases)
        yield y


def joint_columns(layout: Blocks) -> tuple[slice, slice]:
    """The columns of the joints in the inputs, and of the same numbers in the outputs."""
    blocks = [block for block in JOINTS if block in layout.inputs]
    into, out = (
        slice(columns[blocks[0]].start, columns[blocks[-1]].stop)
        for columns in (layout.inputs, layout.outputs)
    )
    return into, out


def joint_errors(found: Array, truth: Array, layout: Blocks) -> NDArray[np.float32]:
    """Distances [N] of the joints of outputs [N, O] from the true ones in root space, their means, cm."""
    block = layout.outputs["positions"]
    away = (found[:, block] - truth[:, block]).reshape(len(found), -1, 3)
    return 100 * np.linalg.norm(away, axis=-1).mean(axis=1)
