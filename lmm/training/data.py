"""What all stages are trained on: a database's frames as arrays, and which of them are held out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmm.frames import compressor_inputs, compressor_size
from lmm.layout import Layout
from mm.database import Database

Array = NDArray[np.float32]
PARTS = ("training", "held_out")
LIBRARIES = 700_000_000  # bytes that torch and compiled code take, whatever the data
BLOCK = 32  # columns at a time, to save memory
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

    def inputs(self) -> Array:
        """What the compressor sees, [T, ..]; its first D columns are what the decompressor is to put out.

        Made anew each time: nothing else of a training is as large.
        """
        out = np.empty((len(self.database), compressor_size(self.layout)), np.float32)
        for part in self.chunks(1024):
            out[part] = compressor_inputs(self.database, part)
        return out

    def memory(self) -> int:
        """Bytes that a training takes beside the database's file, which the system may drop: the compressor's
        inputs, features, and what is made of them a block of columns at a time (2.9 kB a frame of 23 joints,
        measured 2.8)."""
        columns = compressor_size(self.layout) + self.database.schema.size + BLOCK
        return 4 * columns * len(self.database) + LIBRARIES

    def chunks(self, size: int) -> Iterator[slice]:
        """All frames, so many at a time."""
        return (slice(start, start + size) for start in range(0, len(self.database), size))

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


def spread(values: Array, rows: slice | NDArray[np.int64] = slice(None)) -> tuple[Array, Array]:
    """Mean and standard deviation [C] over some rows of values [T, C]; 0 where a column is constant."""
    count = values.shape[1]
    mean, std = np.empty(count), np.empty(count)
    for columns in np.array_split(np.arange(count), -(-count // BLOCK)):
        block = slice(columns[0], columns[-1] + 1)
        some = np.ascontiguousarray(values[:, block][rows])
        mean[block], std[block] = some.mean(axis=0, dtype=np.float64), some.std(axis=0, dtype=np.float64)
    std[std <= CONSTANT * (1 + np.abs(mean))] = 0
    return mean.astype(np.float32), std.astype(np.float32)
