"""Grounds: functions of heights, and heightmaps, which are such functions.

A ground is any function heights(x, z) -> y of arrays of one shape, metres in the world. Flat is the default.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import files, text
from motion.errors import NotFinite, UserError

from . import terrain_kernels, terrain_kernels_numpy

Ground = Callable[[NDArray, NDArray], NDArray]

# Of the published heightmaps: metres between their numbers (3.937 cm), metres of a unit of height (3 cm).
SPACING, UNIT = 0.03937007874, 0.03
MOST = 1e6  # metres; a height beyond is a fault of the file

_WHOLE = "every row needs the same count of plain numbers"


def flat(x: NDArray, z: NDArray) -> NDArray[np.float32]:
    """The flat ground: zeros [..] for x and z [..]."""
    return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(z)), np.float32)


def heights(ground: Ground, x: NDArray, z: NDArray) -> NDArray[np.float32]:
    """What a ground gives at x and z [..], metres, contiguous.

    A ground that gives other than a finite height for each place is a UserError, places that are no numbers
    are `NotFinite`.
    """
    found = np.ascontiguousarray(ground(x, z), np.float32)
    if found.shape != x.shape or not np.isfinite(found).all():
        if not (np.isfinite(x).all() and np.isfinite(z).all()):
            raise NotFinite("poses that are no numbers cannot be put on a ground")
        wrong = f"heights {found.shape}" if found.shape != x.shape else "no finite heights"
        raise UserError(f"a ground gives {wrong} for x and z {x.shape}", remedy="check its function")
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Heightmap:
    """Heights on a square grid, bilinear between its points; beyond the edges they go on as at the edge.

    Attributes
    ----------
    heights : float32 [R, C], metres; rows go along x, columns along z.
    spacing : metres from one row or column to the next.
    origin : x, z of heights[0, 0]; by default the point R // 2, C // 2 is at 0, 0.
    compiled : False samples by the NumPy twin, for tests.
    name : what reports call it.
    """

    heights: NDArray[np.float32]
    spacing: float = SPACING
    origin: tuple[float, float] | None = None
    compiled: bool = True
    name: str = "a heightmap"

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights, np.float32)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ValueError(f"heights of shape {heights.shape}, expected [R, C] of at least 2 by 2")
        if not np.all(np.isfinite(heights)):
            raise ValueError("heights that are not finite")
        if not self.spacing > 0:
            raise ValueError(f"spacing {self.spacing}, expected metres above 0")
        rows, columns = heights.shape
        middle = (-(rows // 2) * self.spacing, -(columns // 2) * self.spacing)
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "origin", middle if self.origin is None else tuple(self.origin))

    def __repr__(self) -> str:
        (x, z), (low, high) = self.size, (self.heights.min(), self.heights.max())
        return f"Heightmap({x:.1f} x {z:.1f} m, {low:.2f} to {high:.2f} m high)"

    @property
    def size(self) -> tuple[float, float]:
        """Metres from the first to the last point along x and z."""
        rows, columns = self.heights.shape
        return (rows - 1) * self.spacing, (columns - 1) * self.spacing

    def facts(self) -> dict[str, Any]:
        """What a report says of it: name, size_m along x and z, low_m and high_m, and of the slopes (metres a
        metre) the median and the 95th percentile."""
        slopes = np.hypot(*np.gradient(self.heights.astype(np.float64), self.spacing))
        median, p95 = np.percentile(slopes, (50, 95))
        return {
            "name": self.name,
            "size_m": list(self.size),
            "low_m": float(self.heights.min()),
            "high_m": float(self.heights.max()),
            "slope_median": float(median),
            "slope_p95": float(p95),
        }

    def covers(self, x: ArrayLike, z: ArrayLike) -> NDArray[np.bool_]:
        """Whether x [..] and z [..] lie within the edges."""
        assert self.origin is not None
        inside = [
            (low <= np.asarray(at)) & (np.asarray(at) <= low + length)
            for at, low, length in zip((x, z), self.origin, self.size, strict=True)
        ]
        return inside[0] & inside[1]

    def __call__(self, x: ArrayLike, z: ArrayLike) -> NDArray[np.float32]:
        """Heights [..], metres, at x [..] and z [..]; NaN where these are."""
        assert self.origin is not None
        x, z = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(z, np.float32))
        out = np.empty(x.size, np.float32)
        kernels: Any = terrain_kernels if self.compiled else terrain_kernels_numpy
        kernels.sample(self.heights, self.spacing, *self.origin, x.ravel(), z.ravel(), out)
        return out.reshape(x.shape)


def load(
    path: str | os.PathLike[str], *, spacing: float = SPACING, unit: float = UNIT, level: float | None = None
) -> Heightmap:
    """Read a heightmap in the published text form: a row of numbers a line, rows along x (PFNN, 2017).

    spacing and unit are metres between numbers and of one unit of height. level is the number that stands
    for y = 0, by default their median. Lines that begin with # are left out. A file with holes (missing
    numbers, NaN), rows of different length or no numbers is a UserError that names the line.
    """
    for name, value in (("spacing", spacing), ("unit", unit)):
        if not 0 < value < MOST:
            raise UserError(f"{name} of {value:g} m", remedy="give a length above 0")
    rows: list[NDArray[np.float64]] = []
    for number, line in enumerate(text.lines(text.decode(text.read_bytes(path))), start=1):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            rows.append(_row(words, len(rows[0]) if rows else 0, path, number))
    if len(rows) < 2 or len(rows[0]) < 2:
        found = f"{len(rows)} rows of numbers" if len(rows) != 1 else "one row of numbers"
        found = "one number a row" if rows and len(rows[0]) == 1 else found
        raise UserError(f"a heightmap of {found}", path=path, remedy="it needs at least two of each")
    table = np.array(rows)
    metres = (table - (np.median(table) if level is None else level)) * unit
    if np.abs(metres).max() > MOST:
        raise UserError(
            f"a height of {np.abs(metres).max():g} m", path=path, remedy="check the file, or give its unit"
        )
    return Heightmap(metres.astype(np.float32), spacing, name=str(path))


def told(facts: Mapping[str, Any]) -> str:
    """The facts of a heightmap in a line."""
    (x, z), slopes = facts["size_m"], (100 * facts["slope_median"], 100 * facts["slope_p95"])
    return (
        f"{facts['name']}: {x:.1f} x {z:.1f} m, {facts['low_m']:.2f} to {facts['high_m']:.2f} m "
        f"high, slopes of {slopes[0]:.0f} % (median) and {slopes[1]:.0f} % (95th percentile)"
    )


def save(path: str | os.PathLike[str], heightmap: Heightmap, *, unit: float = UNIT) -> None:
    """Write a heightmap in the form that `load` reads with level=0; spacing and origin are not in it."""
    with files.atomic(path, "w") as stream:
        for row in heightmap.heights.astype(np.float64) / unit:
            stream.write(" ".join(f"{value:.7g}" for value in row) + "\n")


def _row(words: list[str], columns: int, path: str | os.PathLike[str], line: int) -> NDArray[np.float64]:
    """One row of numbers, as many as columns unless that is 0."""
    try:
        row = np.array([float(word) for word in words])
    except ValueError:
        row = np.array([_number(word) for word in words])
    holes = np.flatnonzero(~np.isfinite(row))
    if len(holes):
        column = int(holes[0])
        what = f"{text.shown(words[column])} is no height (number {column + 1} of the row)"
        raise UserError(what, path=path, line=line, remedy="fill the hole: " + _WHOLE)
    if columns and len(row) != columns:
        what = f"a row of {len(row)} numbers, the first has {columns}"
        raise UserError(what, path=path, line=line, remedy=_WHOLE)
    return row


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan
