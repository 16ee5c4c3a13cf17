"""What all stages are trained on: a database's frames as arrays, and which of them are held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmm.frames import compressor_inputs
from lmm.layout import Layout
from mm.database import Database

Array = NDArray[np.float32]
PARTS = ("training", "held_out")
CONSTANT = 1e-5  # relative deviation below which a column is taken to be constant: float32's rounding


@dataclass(eq=False)
class Data:
    """A database's frames.

    Attributes
    ----------
    database : T frames.
    held_out : names of the clips (with their mirrored copies) that are not trained on.
    """

    database: Database
    held_out: tuple[str, ...] = ()

    @property
    def layout(self) -> Layout:
        return Layout(len(self.database.skeleton), len(self.database.contact_roles))

    @cached_property
    def features(self) -> Array:
        """Normalised features [T, F]."""
        return np.array(self.database.features)

    @cached_property
    def vectors(self) -> Array:
        """What the decompressor is to put out, [T, D]."""
        return self.layout.pack(self.database)

    @cached_property
    def inputs(self) -> Array:
        """What the compressor sees, [T, ..]."""
        return compressor_inputs(self.database)

    @cached_property
    def ranges(self) -> Mapping[str, NDArray[np.bool_]]:
        """Which ranges [R] each part has."""
        held = np.array([name in self.held_out for name in self.database.names], bool)
        return {"training": ~held, "held_out": held}

    @cached_property
    def frames(self) -> Mapping[str, NDArray[np.int64]]:
        """Frames of each part, ascending."""
        of_range = self.database.ranges()
        return {part: np.flatnonzero(which[of_range]) for part, which in self.ranges.items()}

    def starts(self, window: int, part: str = "training") -> NDArray[np.int64]:
        """Frames of a part at which a window of so many frames begins that ends in the same range."""
        last = (self.database.stops - window)[self.database.ranges()]
        frames = self.frames[part]
        return frames[frames <= last[frames]]

    def longest(self) -> int:
        """Frames of the longest range that is trained on."""
        return int((self.database.stops - self.database.starts)[self.ranges["training"]].max())

    def sample(self, count: int, part: str, *, window: int = 1) -> NDArray[np.int64]:
        """At most count of a part's `starts`, evenly spread."""
        starts = self.starts(window, part)
        return starts[np.linspace(0, len(starts) - 1, min(count, len(starts))).astype(np.int64)]

    def parts(self) -> tuple[str, ...]:
        """Parts that have frames."""
        return tuple(part for part in PARTS if len(self.frames[part]))


def floored(std: Array, *widths: int) -> Array:
    """Deviations of inputs [C], none below a tenth of its block's mean; blocks begin at widths.

    What hardly varies in the clips that are trained on may vary more in others.
    """
    out = std.copy()
    for block in np.split(out, widths):
        if (block > 0).any():
            block[block > 0] = np.maximum(block[block > 0], 0.1 * block[block > 0].mean())
    return out


def spread(values: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of columns [T, ..], float32; 0 where a column is constant."""
    mean, std = values.mean(axis=0, dtype=np.float64), values.std(axis=0, dtype=np.float64)
    std[std <= CONSTANT * (1 + np.abs(mean))] = 0
    return mean.astype(np.float32), std.astype(np.float32)
