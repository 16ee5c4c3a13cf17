"""What is stored of a compressed database's poses: what a decoder reads, in memory as in a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..stages import plain


class Tables(NamedTuple):
    """T frames of J joints; of the ways to store a thing one is filled, the others have no rows.

    K rows are all frames, or those that keys int32 [K] says (then else empty): the others lie between.

    floats : float32 [K, J-1, 7], translations and rotations of the joints but the root.
    halves : the same as half floats, seen as uint16.
    packed : uint8 [K, B], rotations of the joints turning int32 [M], see `smallest_three`, bits a component.
    translations : uint16 [K, P], of the columns moving int32 [P] of the pose [J * 3]: offset + scale * code.
    bones, rest : float32 [J, 3] and [J, 4], what does not vary. Without packed they are empty.
    rates : float32 [T, J-1, 6], velocities and angular velocities; half_rates likewise; both empty where
        they are recomputed.
    root : float32 [T, 6], the ground root's motion (`mm.stages.root_steps`); half_root; or coded_root int16
        times root_scale float32 [6].
    contacts : uint8, a bit a frame and foot, frame by frame.
    starts, stops : int32 [R].
    fps : frames per second.
    """

    floats: NDArray[np.float32]
    halves: NDArray[np.uint16]
    packed: NDArray[np.uint8]
    bits: int
    turning: NDArray[np.int32]
    translations: NDArray[np.uint16]
    moving: NDArray[np.int32]
    offset: NDArray[np.float32]
    scale: NDArray[np.float32]
    bones: NDArray[np.float32]
    rest: NDArray[np.float32]
    keys: NDArray[np.int32]
    rates: NDArray[np.float32]
    half_rates: NDArray[np.uint16]
    root: NDArray[np.float32]
    half_root: NDArray[np.uint16]
    coded_root: NDArray[np.int16]
    root_scale: NDArray[np.float32]
    contacts: NDArray[np.uint8]
    starts: NDArray[np.int32]
    stops: NDArray[np.int32]
    fps: float

    def arrays(self) -> dict[str, NDArray]:
        """The arrays by name."""
        return {name: value for name, value in self._asdict().items() if isinstance(value, np.ndarray)}

    def having(self, arrays: Mapping[str, Any]) -> Tables:
        """With other arrays by name, as the kernels are compiled for: contiguous and read-only."""
        changed = self._replace(**arrays)
        return changed._replace(**dict[str, Any]((n, plain(a)) for n, a in changed.arrays().items()))

    def memory(self) -> dict[str, int]:
        """Bytes by part."""
        return {
            part: sum(getattr(self, name).nbytes for name in names.split()) for part, names in _PARTS.items()
        }


_PARTS = {
    "poses": "floats halves packed turning translations moving offset scale bones rest keys",
    "velocities": "rates half_rates",
    "root motion": "root half_root coded_root root_scale",
    "contacts": "contacts",
    "clips": "starts stops",
}


def empty(joints: int, fps: float, bits: int) -> Tables:
    """Tables of no frames, to be filled."""
    return Tables(
        floats=np.zeros((0, joints - 1, 7), np.float32),
        halves=np.zeros((0, joints - 1, 7), np.uint16),
        packed=np.zeros((0, 0), np.uint8),
        bits=bits,
        turning=np.zeros(0, np.int32),
        translations=np.zeros((0, 0), np.uint16),
        moving=np.zeros(0, np.int32),
        offset=np.zeros(0, np.float32),
        scale=np.zeros(0, np.float32),
        bones=np.zeros((0, 3), np.float32),
        rest=np.zeros((0, 4), np.float32),
        keys=np.zeros(0, np.int32),
        rates=np.zeros((0, joints - 1, 6), np.float32),
        half_rates=np.zeros((0, joints - 1, 6), np.uint16),
        root=np.zeros((0, 6), np.float32),
        half_root=np.zeros((0, 6), np.uint16),
        coded_root=np.zeros((0, 6), np.int16),
        root_scale=np.zeros(6, np.float32),
        contacts=np.zeros(0, np.uint8),
        starts=np.zeros(0, np.int32),
        stops=np.zeros(0, np.int32),
        fps=float(fps),
    )
