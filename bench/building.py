"""How many times faster than real time a database is built."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mm.build import build
from mm.database import Database
from motion.errors import UserError


def measure(
    sources: Sequence[str], *, repeats: int = 3, options: Mapping[str, Any] | None = None
) -> list[dict[str, Any]]:
    """Two rows: a new process (Python's start and imports included), and a warm one, the best of repeats.

    Both go from files to a database on disk. Real time is that of the clips themselves; mirrored copies do
    not count. options are those of `mm.build.build` that ``python -m mm build`` has, too.
    """
    options = dict(options or {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "database.mmdb"

        def warm() -> Database:
            database = build(list(sources), **options)
            database.save(path)
            return database

        database = warm()  # also finds the user's faults before a process does
        times = []
        for _ in range(repeats):
            start = time.perf_counter()
            warm()
            times.append(time.perf_counter() - start)
        command = [sys.executable, "-m", "mm", "build", *sources, "-o", str(path), *_flags(options)]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        cold = time.perf_counter() - start
        if done.returncode:
            raise UserError(f"the build in a new process failed: {done.stderr.strip()}")
    own = np.asarray(~database.mirrored)
    real = float((database.stops - database.starts)[own].sum()) / database.fps
    return [
        {
            "process": name,
            "clips": int(own.sum()),
            "minutes": real / 60,
            "seconds": took,
            "times_real_time": real / took,
        }
        for name, took in (("new", cold), ("warm", min(times)))
    ]


def _flags(options: Mapping[str, Any]) -> list[str]:
    """Options of the command line from those of the function."""
    flags = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if name in ("mirror", "check", "retarget"):
            flags.append(flag if value else f"--no-{name}")
        elif value is True:
            flags.append(flag)
        elif isinstance(value, tuple):
            flags += [word for each in value for word in (flag, str(each))]
        elif value not in (None, False):
            flags += [flag, str(value)]
    return flags
