"""What stepping allocates: a frame of a game must not, or the allocator costs time whenever it likes."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

WARM = 30  # frames that grow what grows once


@dataclass(frozen=True)
class Allocations:
    """Of a number of frames.

    Attributes
    ----------
    frame_bytes, search_bytes : the most that a frame holds besides what was held before it, objects of Python
        and data of NumPy arrays: the mean over frames without and with a search; NaN where there is none.
    blocks : small ones a frame that numba's runtime takes: one for each array that is handed to a compiled
        kernel, and one for each that a kernel makes.
    kept_bytes : what is held after all frames and was not before, which must be next to nothing.
    """

    frame_bytes: float
    search_bytes: float
    blocks: float
    kept_bytes: int


def of_steps(system: Any, commands: Sequence[Any]) -> Allocations:
    """Step a system with commands, the first 30 of which are not counted."""
    for command in commands[:WARM]:
        system.step(command)
    counted = commands[WARM:]
    temporaries, searched = np.zeros(len(counted)), np.zeros(len(counted), bool)
    gc.collect()
    tracemalloc.start()
    try:
        for t, command in enumerate(counted):
            before, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            system.step(command)
            temporaries[t] = tracemalloc.get_traced_memory()[1] - before
            searched[t] = _searched(system)
            if t == 0:
                start = tracemalloc.get_traced_memory()[0]
        gc.collect()
        kept = tracemalloc.get_traced_memory()[0] - start
    finally:
        tracemalloc.stop()
    parts = temporaries[~searched], temporaries[searched]
    quiet, busy = (float(part.mean()) if part.size else np.nan for part in parts)
    return Allocations(quiet, busy, _blocks(system, counted), kept)


def _searched(system: Any) -> bool:
    characters = getattr(system, "characters", None)
    return bool(
        characters is not None and "searching" in characters.dtype.names and characters["searching"].any()
    )


def _blocks(system: Any, commands: Sequence[Any]) -> float:
    """Blocks a step that numba's runtime takes."""
    from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]

    counting = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    try:
        before = _nrt_python.memsys_get_stats_alloc()
        for command in commands:
            system.step(command)
        return (_nrt_python.memsys_get_stats_alloc() - before) / max(1, len(commands))
    finally:
        if not counting:
            _nrt_python.memsys_disable_stats()
