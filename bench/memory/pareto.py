"""Which of several choices are worth making: those that no other one beats in everything."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

FRONTS = {"front": "pose_cm", "front_held": "pose_held_cm"}  # of memory against which error


def front(costs: ArrayLike) -> NDArray[np.bool_]:
    """Which rows of costs [N, K] are on the Pareto front: no other is as low in all columns and lower in one.

    Equal rows are on it together. One with a number that is not known (NaN) is not, and beats none.
    """
    rows = np.asarray(costs, np.float64)
    out: NDArray[np.bool_] = np.array(~np.isnan(rows).any(axis=1))
    known = rows[out]
    no_worse = (known[:, None] <= known).all(axis=2)
    lower = (known[:, None] < known).any(axis=2)
    out[out] = ~(no_worse & lower).any(axis=0)
    return out


def with_fronts(systems: pd.DataFrame) -> pd.DataFrame:
    """Systems with columns front and front_held, where their errors are known.

    In them stands whether nothing smaller (memory_mb) decodes poses better, among those that decode frames.
    """
    out = systems.copy()
    for name, column in FRONTS.items():
        if column in systems:
            error = systems[column].where(systems["error"] == "decoded")
            if error.notna().any():
                out[name] = front(np.column_stack([systems["memory_mb"], error]))
    return out
