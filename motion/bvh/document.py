"""What a BVH file says, before anything is made of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .rates import frame_rate

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
SCALES = tuple(f"{axis}scale" for axis in "XYZ")  # read where they say 1 throughout; a clip has none


@dataclass(eq=False)
class BvhDocument:
    """What a BVH file says, in its own units and degrees.

    Attributes
    ----------
    names : J joint names, in file order (depth first).
    parents : int32 [J], -1 for the root, joint 0.
    offsets : float64 [J, 3].
    end_sites : per joint, the offsets of its end sites.
    channels : per joint, its channels in file order, spelled as in `CHANNELS` and `SCALES`.
    frame_time : seconds per frame, as printed.
    values : float64 [T, C], C the number of all channels.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]
    offsets: NDArray[np.float64]
    end_sites: tuple[tuple[NDArray[np.float64], ...], ...]
    channels: tuple[tuple[str, ...], ...]
    frame_time: str
    values: NDArray[np.float64]

    @property
    def fps(self) -> float:
        """Frames per second, see `frame_rate`."""
        return frame_rate(self.frame_time)
