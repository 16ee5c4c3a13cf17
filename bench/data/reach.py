"""How fast the data goes in each direction, and how sharply it turns: what there is none of is missing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..coverage import SLOW

Array = NDArray[np.floating]

BAND = 0.5  # m/s
ENOUGH = 2.0  # seconds of a motion, two strides: of fewer a search has no choice
TURNING = 60.0  # degrees a second
DIRECTIONS = ("ahead", "left", "back", "right")  # of the travel, as the character faces; 90 degrees each
TURNS = ("turn_left", "turn_right")


def by_speed(states: Array, clip: NDArray[np.integer], fps: float) -> pd.DataFrame:
    """A row a band of speed: seconds in all, by direction of travel and by turn, and from how many clips.

    states [T, 3] as `bench.coverage.states` gives them, clip [T] the clip of each frame. Bands are `BAND`
    wide, but for the first: up to `SLOW`, a direction means nothing. A turn is faster than `TURNING`.
    """
    speed, direction, turn = np.asarray(states, np.float64).T
    top = float(speed.max(initial=SLOW))
    edges = np.unique([0, SLOW, *np.arange(BAND, top + BAND, BAND)])
    quarter = np.floor((direction + 45) % 360 / 90).astype(np.int64) % 4
    rows = []
    for low, high in pairwise(edges):
        those = (speed > low) & (speed <= high) if low > 0 else speed <= high
        sides = (turn > TURNING, turn < -TURNING)
        rows.append(
            {
                "from_mps": low,
                "to_mps": high,
                "seconds": those.sum() / fps,
                "clips": np.unique(clip[those]).size,
            }
            | {
                name: (those & (quarter == i)).sum() / fps if low > 0 else np.nan
                for i, name in enumerate(DIRECTIONS)
            }
            | {name: (those & side).sum() / fps for name, side in zip(TURNS, sides, strict=True)}
        )
    return pd.DataFrame(rows)


def spans(table: pd.DataFrame, name: str) -> list[tuple[float, float]]:
    """Speeds, from and to m/s, at which there is enough (`ENOUGH` in every band) of a direction or turn."""
    out: list[tuple[float, float]] = []
    for row in table[table[name] >= ENOUGH].itertuples():
        if out and out[-1][1] == row.from_mps:
            out[-1] = (out[-1][0], row.to_mps)
        else:
            out.append((row.from_mps, row.to_mps))
    return out
