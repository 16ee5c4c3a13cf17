"""How fast BVH files are read, beside the fastest public Python reader on the same files in the same run."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

from motion import bvh, sources
from motion.errors import UserError

from . import timing


def measure(files: Sequence[str | os.PathLike[str]], *, repeats: int = 3) -> list[dict[str, Any]]:
    """A row a reader: MB a second (10^6 bytes) over all files, the best of several passes, file cache warm.

    pybvh is measured where it is installed. Files and folders; other formats than BVH are left out.
    """
    paths = [path for path in sources.find(list(files)) if path.suffix.lower() == ".bvh"]
    if not paths:
        raise UserError("no BVH file among them", remedy="name BVH files or folders that hold some")
    size = sum(path.stat().st_size for path in paths) / 1e6
    readers: dict[str, Callable[[Any], Any]] = {
        "motion.bvh.parse (numbers)": bvh.parse,
        "motion.bvh.read (clip with quaternions)": bvh.read,
    }
    try:
        import pybvh
    except ImportError:
        pass
    else:
        # The axis given: it would guess it by forward kinematics, which is no part of reading.
        readers["pybvh.read_bvh_file (numbers)"] = lambda path: pybvh.read_bvh_file(path, world_up="+y")
    rows = []
    for name, read in readers.items():
        with timing.single_thread():
            best = min(timing.best_of(lambda read=read: [read(path) for path in paths], repeats=repeats))
        rows.append(
            {"reader": name, "files": len(paths), "mb": size, "seconds": best, "mb_per_s": size / best}
        )
    return rows
