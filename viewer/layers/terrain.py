"""Uneven ground, and where its height is asked for, as by networks that see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground
from features.trajectory import facing
from lmm.locomotion.window import ASIDE

from .. import shapes
from ..scene import Layer, Mesh, Points, Surface, colour
from . import colours
from .moment import Moment

GRASS = colour("#c9cfc2")
CELL, MOST = 0.12, 260  # metres from point to point, at least; points along a side, at most
MARGIN = 5.0  # metres around what is walked on
AHEAD = 8.0  # metres that characters may go on a patch
_LINE, _DARK = 0.5, 0.82  # metres of a square, and how much darker every other one is


def samples(moment: Moment) -> dict[str, Layer]:
    """On the ground under a trajectory's samples, and 25 cm to their sides (REFERENCE 4.2)."""
    if "trajectory" not in moment.record:
        return {}
    x, z, yaws = moment.record["trajectory"].T
    ahead = facing(yaws)
    left = np.stack([ahead[:, 1], -ahead[:, 0]], axis=-1)
    middle = np.stack([x, z], axis=-1)
    spots = np.stack([middle + side * ASIDE * left for side in (-1, 0, 1)], axis=1).reshape(-1, 2)
    return {
        "ground": Points(positions=moment.on_ground(spots), colours=colours.GROUND, size=7.0, through=0.3)
    }


def surface(ground: Ground, low: NDArray, high: NDArray) -> Surface:
    """A ground from x, z low [2] to high [2], metres, and some metres around that, in squares of half a
    metre."""
    low, high = np.asarray(low, np.float64) - MARGIN, np.asarray(high, np.float64) + MARGIN
    counts = np.clip(np.ceil((high - low) / CELL), 2, MOST).astype(int) + 1
    x, z = np.meshgrid(
        *(np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)), indexing="ij"
    )
    vertices = np.stack([x, ground(x, z), z], axis=-1).reshape(-1, 3)
    corner = (np.arange(counts[0] - 1)[:, None] * counts[1] + np.arange(counts[1] - 1)).reshape(-1)
    right, up = corner + counts[1], corner + 1
    triangles = np.concatenate([np.stack([corner, up, right], -1), np.stack([right, up, right + 1], -1)])
    odd = (np.floor(x / _LINE) + np.floor(z / _LINE)).astype(int).reshape(-1) % 2
    shades = GRASS * np.where(odd[:, None], _DARK, 1.0)
    normals = shapes.normals(vertices, triangles).astype(np.float32)
    return Surface(
        mesh=Mesh(
            vertices.astype(np.float32), normals, triangles.astype(np.int32), shades.astype(np.float32)
        ),
        shadow=False,
        shaded=True,
    )


class Patch:
    """As much of a ground as there is around characters who go on without an end."""

    def __init__(self, ground: Ground) -> None:
        self._ground, self._low, self._high = ground, np.full(2, np.inf), np.full(2, -np.inf)

    def around(self, places: NDArray) -> Surface | None:
        """The ground around places [N, 2]; None where they are still on that of before."""
        places = places[np.isfinite(places).all(axis=-1)]
        if ((places >= self._low) & (places <= self._high)).all():
            return None
        self._low, self._high = places.min(axis=0) - AHEAD, places.max(axis=0) + AHEAD
        return surface(self._ground, self._low, self._high)
