"""What colours mean: the same thing has the same one in all layers, plots and panels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..scene import Floats, colour

ASKED, PREDICTED, MATCHED, SOUGHT = (colour(c) for c in ("#e8740c", "#7b3fd4", "#0f8a5f", "#c2185b"))
TOUCHING, HELD, GROUND = (colour(c) for c in ("#f2a900", "#d0021b", "#3b6ea5"))
_SCALE = np.stack([colour(c) for c in ("#1a9850", "#f2b134", "#d73027")])  # from what is good to what is not


def graded(shares: ArrayLike) -> Floats:
    """Colours [..., 3] of shares [...]: green for 0, red for 1 and beyond."""
    at = 2 * np.clip(np.nan_to_num(np.asarray(shares, np.float64), nan=1.0), 0, 1)
    low = np.minimum(at.astype(int), 1)
    part = (at - low)[..., None]
    return np.asarray(_SCALE[low] * (1 - part) + _SCALE[low + 1] * part, np.float32)
