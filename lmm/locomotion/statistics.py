"""How vectors are normalised: deviations by block (REFERENCE 4.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion.skeleton import Skeleton

from .window import Blocks

Array = NDArray[np.float32]

JOINT_SCALE = 0.1  # an input's joint counts by its weight times this, against the trajectory
NOTHING = 1e-10  # the weight of a joint that the network shall not see


def joint_weights(skeleton: Skeleton) -> Array:
    """Weights [J - 1] of all joints but the ground root: 1, or 0 for fingers and who sits on its parent."""
    weights = np.ones(len(skeleton), np.float32)
    hands = {skeleton.roles.get(f"{side}_hand") for side in ("left", "right")}
    for j in range(1, len(skeleton)):
        parent = int(skeleton.parents[j])
        finger = parent in hands or (weights[parent] == 0 and set(skeleton.chain(j)) & hands)
        if finger or (parent and not np.any(skeleton.offsets[j])):
            weights[j] = 0
    return weights[1:]


def statistics(
    x: Array, y: Array, layout: Blocks, weights: Array, *, joint_scale: float = JOINT_SCALE
) -> dict[str, Array]:
    """input_mean, input_std [I], output_mean, output_std [O] of vectors x [M, I] and y [M, O].

    Deviations are the mean over their block, of the inputs' trajectory over all x and over all z. Those of
    an input's joints are divided by the joint's weight [J] and joint_scale. A block that never varies
    counts as it is: 1.
    """
    found: dict[str, Array] = {}
    for name, vectors, blocks in (("input", x, layout.inputs), ("output", y, layout.outputs)):
        std = vectors.std(axis=0, dtype=np.float64)
        for block, columns in blocks.items():
            parts = [columns]
            if name == "input" and block in ("path", "facing", "going"):
                middle = (columns.start + columns.stop) // 2
                parts = [slice(columns.start, middle), slice(middle, columns.stop)]
            for part in parts:
                mean = std[part].mean()
                std[part] = mean if mean > 0 else 1
            if name == "input" and block in ("positions", "rotations", "velocities"):
                numbers = (columns.stop - columns.start) // len(weights)
                std[columns] /= np.repeat(np.maximum(weights, NOTHING) * joint_scale, numbers)
        found[f"{name}_mean"] = vectors.mean(axis=0, dtype=np.float64).astype(np.float32)
        found[f"{name}_std"] = std.astype(np.float32)
    return found
