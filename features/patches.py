"""Patches of heightmaps: the same landscape at many places, turned and mirrored, to fit motion to.

A patch is where its middle lies in a map and how it is turned: nothing is copied out of the map, which goes
on beyond its edges as in a mirror.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.errors import UserError

from . import terrain_kernels, terrain_kernels_numpy
from .terrain import Heightmap

# The published patches: 128 numbers wide, no higher or lower than 1.5 m from their mean (PFNN, 2017).
SIDE, ROUGHEST = 5.04, 1.5  # metres
COUNT = 1500
_PROBES = 17  # heights are looked at on so many lines each way, to find a patch's mean and roughness
_TRIES = 20


@dataclass(frozen=True, eq=False)
class Patches:
    """P patches.

    Attributes
    ----------
    maps : the maps that they are of.
    which : int64 [P], the map of each.
    transforms : float64 [P, 2, 3], from x, z (metres from a patch's middle) and 1 to its map's row, column.
    levels : float64 [P], the mean height of each patch in its map, which counts as 0.
    """

    maps: tuple[Heightmap, ...]
    which: NDArray[np.int64]
    transforms: NDArray[np.float64]
    levels: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.which)

    def __getitem__(self, chosen: ArrayLike) -> Patches:
        """Some of them, by index or mask."""
        chosen = np.atleast_1d(np.asarray(chosen))
        return Patches(self.maps, self.which[chosen], self.transforms[chosen], self.levels[chosen])

    def heights(self, points: ArrayLike) -> NDArray[np.float64]:
        """Heights [P, M], metres, of every patch at points [M, 2]: x, z from its middle."""
        points = np.ascontiguousarray(points, np.float64)
        out = np.empty((len(self), len(points)))
        for of, heights, kernels in self._by_map():
            part = np.empty((len(of), len(points)))
            kernels.sample_patches(heights, self.transforms[of], points, part)
            out[of] = part
        return out - self.levels[:, None]

    def misfits(
        self, down: NDArray, down_y: NDArray, up: NDArray, up_y: NDArray, over: NDArray, *, weight: float,
        gap: float,
    ) -> NDArray[np.float64]:  # fmt: skip
        """How badly every patch meets feet, m^2 [P]; see `features.terrain_kernels.misfits`."""
        out = np.empty(len(self))
        feet = [np.ascontiguousarray(array, np.float64) for array in (down, down_y, up, up_y, over)]
        for of, heights, kernels in self._by_map():
            part = np.empty(len(of))
            kernels.misfits(heights, self.transforms[of], *feet, weight, gap, part)
            out[of] = part
        return out

    def _by_map(self) -> Iterable[tuple[NDArray[np.int64], NDArray[np.float32], Any]]:
        for i, one in enumerate(self.maps):
            of = np.flatnonzero(self.which == i)
            if len(of):
                yield of, one.heights, terrain_kernels if one.compiled else terrain_kernels_numpy


def cut(
    maps: Sequence[Heightmap],
    *,
    seed: int = 0,
    count: int = COUNT,
    side: float = SIDE,
    roughest: float = ROUGHEST,
) -> Patches:
    """count patches at random of maps, larger maps giving more, the same for the same seed.

    side is the length of a patch, metres; one that lies anywhere more than roughest metres from its mean is
    not taken. A UserError where there are too few others.
    """
    if not maps:
        raise UserError("no heightmap to take patches of", remedy="give one, or make one from a seed")
    if count < 1 or not side > 0 or not roughest > 0:
        raise UserError("patches need a count, a side and a roughness above 0")
    rng = np.random.default_rng(seed)
    areas = np.array([np.prod(one.size) for one in maps])
    line = np.linspace(-side / 2, side / 2, _PROBES)
    probes = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    kept: list[Patches] = []
    found = 0
    for _ in range(_TRIES):
        which = rng.choice(len(maps), count, p=areas / areas.sum())
        transforms = np.stack([_place(rng, maps[i]) for i in which])
        drawn = Patches(tuple(maps), which, transforms, np.zeros(count))
        heights = drawn.heights(probes)
        levels = heights.mean(axis=1)
        fine = np.abs(heights - levels[:, None]).max(axis=1) <= roughest
        kept.append(Patches(drawn.maps, which[fine], transforms[fine], levels[fine]))
        found += int(fine.sum())
        if found >= count:
            break
    else:
        raise UserError(
            f"{found} of {_TRIES * count:,} patches lie within {roughest:g} m of their mean, not {count}",
            remedy="check the heightmap's unit of height, or allow rougher patches",
        )
    which, transforms, levels = (
        np.concatenate([getattr(part, name) for part in kept])[:count]
        for name in ("which", "transforms", "levels")
    )
    return Patches(tuple(maps), which, transforms, levels)


def _place(rng: np.random.Generator, one: Heightmap) -> NDArray[np.float64]:
    """A transform [2, 3] to anywhere in a map, at any angle, mirrored every other time."""
    angle, mirror = rng.uniform(0, 2 * np.pi), rng.choice((-1.0, 1.0))
    c, s = np.cos(angle) / one.spacing, np.sin(angle) / one.spacing
    rows, columns = one.heights.shape
    middle = rng.uniform(0, 1, 2) * (rows - 1, columns - 1)
    return np.array([[c * mirror, -s, middle[0]], [s * mirror, c, middle[1]]])
