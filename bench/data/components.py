"""Principal components of the normalised features: how many directions they really vary in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.floating]

STRONGEST = 4  # columns that are named of a component


@dataclass(frozen=True, eq=False)
class Components:
    """axes [F, F], a component a column, strongest first; variance [F] along them; scores [T, 2] of the first
    two."""

    axes: Array
    variance: Array
    scores: Array

    @property
    def share(self) -> Array:
        """Share [F] of the variance; zeros where nothing varies."""
        total = self.variance.sum()
        return self.variance / total if total > 0 else np.zeros_like(self.variance)

    def needed(self, share: float) -> int:
        """How many components hold that share of the variance."""
        return int(np.searchsorted(np.cumsum(self.share), share - 1e-9)) + 1


def find(features: Array) -> Components:
    """Of features [T, F]; each axis points to where its largest entry is positive."""
    centred = np.asarray(features, np.float64) - np.mean(features, axis=0, dtype=np.float64)
    variance, axes = np.linalg.eigh(centred.T @ centred / len(centred))
    variance, axes = np.maximum(variance[::-1], 0), axes[:, ::-1]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=0)[None], axis=0)
    axes = axes * np.where(largest < 0, -1, 1)
    return Components(axes, variance, centred @ axes[:, :2])


def table(components: Components, names: tuple[str, ...]) -> pd.DataFrame:
    """A row a component: its share of the variance, all until it, and the columns that it is made of."""
    share = components.share
    return pd.DataFrame(
        {
            "component": np.arange(1, len(share) + 1),
            "share": share,
            "cumulative": np.cumsum(share),
            "made_of": [_made_of(axis, names) for axis in components.axes.T],
        }
    )


def _made_of(axis: Array, names: tuple[str, ...]) -> str:
    strongest = np.argsort(-np.abs(axis), kind="stable")[:STRONGEST]
    return ", ".join(f"{axis[i]:+.2f} {names[i]}" for i in strongest)
