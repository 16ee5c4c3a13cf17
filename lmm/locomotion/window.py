"""The window of samples that a network sees of where a character was and is going (REFERENCE 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from features import trajectory as ground_plane

Array = NDArray[np.float32]

SAMPLES, PRESENT = 12, 6  # of the trajectory; the one that is now
FUTURE = SAMPLES - PRESENT  # samples that are put out, the present among them
INTERVAL = 1 / 6  # seconds from one to the next
SIDES = 3  # heights to the right, in the middle, to the left
ASIDE = 0.25  # metres
GAITS = ("stand", "walk", "jog", "crouch", "jump", "other")  # `features.gait`'s, whose import takes long


class Blocks(Protocol):
    """A layout of vectors: columns of inputs and outputs by block, in order."""

    @property
    def inputs(self) -> Mapping[str, slice]: ...

    @property
    def outputs(self) -> Mapping[str, slice]: ...


def samples(block: Array, components: int) -> Array:
    """Numbers [N, K, components] of a block that holds one component of all K samples after the other."""
    return np.swapaxes(block.reshape(len(block), components, -1), 1, 2)


def slices(**sizes: int) -> Mapping[str, slice]:
    """Columns by block, one after the other, of so many numbers each."""
    stops = np.cumsum(list(sizes.values())).tolist()
    return {name: slice(stop - sizes[name], stop) for name, stop in zip(sizes, stops, strict=True)}


def size(blocks: Mapping[str, slice]) -> int:
    """How many numbers a vector of such blocks has."""
    return max(columns.stop for columns in blocks.values())


def around(
    root: NDArray, yaw: NDArray, t: NDArray, offsets: NDArray
) -> tuple[NDArray, NDArray, NDArray[np.int64]]:
    """The trajectory around frames t [M] at offsets [K] of them, in their roots.

    root [T, 2] and yaw [T] are those of a range; beyond its ends the root goes on as it did there, facing
    where it faced. Returns positions and directions [M, K, 2], and the frames [M, K] that they are taken of.
    """
    places, at = beyond(root, t[:, None] + offsets)
    here = root[t], yaw[t]
    return (
        ground_plane.points_to_local(places, *here),
        ground_plane.directions_to_local(ground_plane.facing(yaw[at]), yaw[t]),
        at,
    )


def beyond(root: NDArray, wanted: NDArray) -> tuple[NDArray, NDArray[np.int64]]:
    """Where a root [T, 2] is at frames of its range, which may lie beyond its ends: as `around` has it.

    Returns positions [.., 2] and the frames that they are taken of, for wanted of any shape.
    """
    at = np.clip(wanted, 0, len(root) - 1)
    first, last = root[1] - root[0], root[-1] - root[-2]
    places = (
        root[at] + np.minimum(wanted, 0)[..., None] * first + np.maximum(wanted - at, 0)[..., None] * last
    )
    return places, at
