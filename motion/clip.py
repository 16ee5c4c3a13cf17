"""What a clip is: a skeleton moving at a frame rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .skeleton import Skeleton


@dataclass(frozen=True, eq=False, repr=False)
class Clip:
    """Local joint transforms over time, in metres, right-handed, Y up.

    Clips are float64: files print more digits than float32 holds and velocities are differences.
    Databases and kernels are float32.

    Attributes
    ----------
    name : short name, usually the file's stem.
    skeleton : J joints.
    fps : frames per second.
    positions : [T, J, 3] position in the parent's frame (of joint 0: in the world), metres.
    rotations : [T, J, 4] rotation in the parent's frame, unit quaternions (w, x, y, z), unrolled over time.
    unit_to_m : the factor that turned the file's lengths into metres.
    source : the file it was read from, if any.
    """

    name: str
    skeleton: Skeleton
    fps: float
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    unit_to_m: float = 1.0
    source: Path | None = None

    def __post_init__(self) -> None:
        positions = np.ascontiguousarray(self.positions, np.float64)
        rotations = np.ascontiguousarray(self.rotations, np.float64)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "rotations", rotations)
        frames, joints = len(positions), len(self.skeleton)
        if positions.shape != (frames, joints, 3) or rotations.shape != (frames, joints, 4):
            raise ValueError(
                f"clip {self.name!r}: positions {positions.shape}, rotations {rotations.shape}, "
                f"expected ({frames}, {joints}, 3) and ({frames}, {joints}, 4)"
            )
        if not self.fps > 0:
            raise ValueError(f"clip {self.name!r}: frame rate {self.fps}, expected a positive number")

    def __repr__(self) -> str:
        return f"Clip({self.name!r}, {len(self)} frames at {self.fps:g} fps, {len(self.skeleton)} joints)"

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def seconds(self) -> float:
        """Duration, frames / fps."""
        return len(self) / self.fps

    def replace(self, **changes: Any) -> Clip:
        """A copy with some attributes changed."""
        return replace(self, **changes)
