"""How a mode-adaptive network's vectors are normalised: deviations by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..locomotion import statistics as by_block
from .layout import Layout

Array = NDArray[np.float32]


def statistics(
    x: Array, y: Array, layout: Layout, weights: Array, *, joint_scale: float = 1.0
) -> dict[str, Array]:
    """input_mean, input_std [I], output_mean, output_std [O] of vectors x [M, I] and y [M, O].

    See `lmm.locomotion.statistics`, whose joint_weights are weights [J]. Joints count as much as the
    trajectory does unless joint_scale says otherwise: REFERENCE 5 tells nothing else, and the gate sees some.
    """
    return by_block.statistics(x, y, layout, weights, joint_scale=joint_scale)
