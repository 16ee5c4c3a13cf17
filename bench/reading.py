"""How fast BVH files are read, beside the fastest public Python reader on the same files in the same run."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from motion import bvh, sources
from motion.errors import UserError

from . import timing

Reader = Callable[[Path], Any]


def measure(files: Sequence[str | os.PathLike[str]], *, repeats: int = 3) -> list[dict[str, Any]]:
    """A row a reader: MB a second (10^6 bytes) over all files, the best of several passes, file cache warm.

    Files and folders; other formats than BVH are left out. pybvh is measured where it is installed, and then
    all readers read the files that it can read, others being counted as left_out.
    """
    paths = [path for path in sources.find(list(files)) if path.suffix.lower() == ".bvh"]
    if not paths:
        raise UserError("no BVH file among them", remedy="name BVH files or folders that hold some")
    readers: dict[str, Reader] = {
        "motion.bvh.parse (numbers)": bvh.parse,
        "motion.bvh.read (clip with quaternions)": bvh.read,
    }
    common, other = paths, _pybvh()
    if other is not None:
        readable = [path for path in paths if _can(other, path)]
        if readable:
            common, readers["pybvh.read_bvh_file (numbers)"] = readable, other
    size = sum(path.stat().st_size for path in common) / 1e6
    rows = []
    for name, read in readers.items():
        best = _best(read, common, repeats)
        rows.append(
            {
                "reader": name,
                "files": len(common),
                "left_out": len(paths) - len(common),
                "mb": size,
                "seconds": best,
                "mb_per_s": size / best,
            }
        )
    return rows


def _best(read: Reader, paths: Sequence[Path], repeats: int) -> float:
    def all_of_them() -> None:
        for path in paths:
            read(path)

    with timing.single_thread():
        return min(timing.best_of(all_of_them, repeats=repeats))


def _pybvh() -> Reader | None:
    try:
        import pybvh
    except ImportError:
        return None
    # The axis given: it would guess it by forward kinematics, which is no part of reading.
    return lambda path: pybvh.read_bvh_file(path, world_up="+y")


def _can(read: Reader, path: Path) -> bool:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
    except Exception:
        return False
    return True
