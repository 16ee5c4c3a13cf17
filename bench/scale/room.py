"""What memory a length of data needs while it is measured, and what there is."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from motion.errors import UserError

from .lengths import Lengths

# Bytes of an index by float32 number of the features, at the most; hnsw's graph has 32 links a row and level.
INDEX = {
    **{"brute": 0.2, "aabb": 1.0, "exact": 4.0, "kdtree": 10.0, "two-phase": 0.5},
    **{"faiss-flat": 8.5, "faiss-ivf": 9.5, "faiss-hnsw": 34.0, "faiss-pq": 5.0},
}
BASE = 0.5e9  # the interpreter, libraries, compiled kernels
CLIP = 8 * 7  # bytes a joint and frame of a clip: positions and rotations, float64
POSE = 4 * 13  # the same of poses in a database, float32


def needed(lengths: Lengths, minutes: float, indexes: Sequence[str]) -> float:
    """Bytes that measuring a length takes at the most, all its indexes held at once."""
    frames = minutes * 60 * lengths.fps
    rows = frames * lengths.copies
    features = 4 * lengths.features * (3 + sum(INDEX[name] for name in indexes) / 4)
    return BASE + frames * CLIP * lengths.joints + rows * (POSE * lengths.joints + features)


def available() -> float:
    """Bytes that the machine has left; infinite where it does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        return 1024.0 * int(line.split()[1])
    except (OSError, StopIteration, ValueError):
        pass
    try:
        return 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return float("inf")


def check(lengths: Lengths, minutes: Sequence[float], indexes: Sequence[str]) -> list[str]:
    """A line a length, of what it needs; a UserError where one does not fit, which names what does."""
    room = available()
    sizes = {length: needed(lengths, length, indexes) for length in minutes}
    for length, size in sizes.items():
        if size > room:
            fitting = [f"{m:g}" for m in minutes if sizes[m] <= room]
            raise UserError(
                f"{length:g} minutes need about {size / 1e9:.1f} GB, {room / 1e9:.1f} GB are free",
                remedy=f"{'--minutes ' + ','.join(fitting) + ' fit' if fitting else 'ask for less'}, "
                "and fewer --indexes or --no-mirror need less",
            )
    return [f"{length:g} minutes need about {size / 1e9:.1f} GB" for length, size in sizes.items()]
