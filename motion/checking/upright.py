"""Which way is up: bodies that walk about with head and feet along another axis than y."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..axes import AXES
from ..roles import SIDES
from .body import Body
from .finding import Finding

STRAIGHT = (
    0.85  # cosine, on average, between an axis and the way from the feet to the hips, and on to the head
)
TRAVEL = 1.0  # of the legs' length across that axis: who lies or hangs does not go anywhere


def findings(body: Body) -> list[Finding]:
    """The whole clip, where it is in other axes than ours, of which y points up."""
    joints = body.joints(("hips", "head", *(f"{side}_foot" for side in SIDES)))
    if not joints:
        return []
    hips, head, left, right = (body.world[:, joint] for joint in joints)
    trunk, legs = _mean_direction(head - hips), _mean_direction(hips - (left + right) / 2)
    along = int(np.abs(trunk).argmax())
    sign = np.sign(trunk[along])
    if (along == 1 and sign > 0) or min(sign * trunk[along], sign * legs[along]) < STRAIGHT:
        return []
    across = np.delete(hips, along, axis=1)
    if np.linalg.norm(np.ptp(across, axis=0)) < TRAVEL * body.leg:
        return []
    axis = AXES[along + 3 * (sign < 0)]
    what = f"the body goes about upright along {axis}, not along y: say which axis is up (--source-up)"
    return [Finding("axes", 0, len(body), what, fatal=True)]


def _mean_direction(ways: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean [3] of unit vectors along ways [T, 3]: shorter than 1 as they differ."""
    return (ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)).mean(axis=0)
