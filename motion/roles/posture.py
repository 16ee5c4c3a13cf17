"""How a body stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skeleton import Skeleton
from .vocabulary import SIDES


def on_all_fours(skeleton: Skeleton, positions: NDArray) -> bool:
    """Whether a body mostly walks on its hands (front paws) too, by world positions [T, J, 3] of some frames.

    Then, in more than half of them, the shoulders are hardly above the hips and the hands near the feet: by a
    third of the legs' length. Who stands up, crouches or picks something up now and then does not. False for
    a skeleton without both pairs of limbs.
    """
    parts = ("up_leg", "leg", "foot", "arm", "hand")
    if not all(f"{side}_{part}" in skeleton.roles for side in SIDES for part in parts):
        return False
    limbs = {p: positions[:, [skeleton.roles[f"{side}_{p}"] for side in SIDES]] for p in parts}
    bones = (limbs["up_leg"] - limbs["leg"], limbs["leg"] - limbs["foot"])
    reach = sum(np.linalg.norm(bone, axis=-1).mean(axis=-1) for bone in bones)
    height = {part: limb[..., 1].mean(axis=-1) for part, limb in limbs.items()}
    level = height["arm"] - height["up_leg"] < reach / 3
    low = height["hand"] - height["foot"] < reach / 3
    return bool(np.mean(level & low) > 0.5)
