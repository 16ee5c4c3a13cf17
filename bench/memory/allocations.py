"""What stepping allocates: a frame of a game must not, or the allocator costs time whenever it likes."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from mm.control import Command

WARM, FRAMES = 30, 90  # frames that grow what grows once, and that are counted
CHANGE, FASTEST = 20, 2.0  # frames after which something else is asked for, and m/s at most


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


def wander(count: int, *, frames: int = WARM + FRAMES, seed: int = 0) -> list[Command]:
    """Commands of characters that each are asked for something else three times a second."""
    rng, command, out = np.random.default_rng(seed), Command.still(count), []
    for t in range(frames):
        if t % CHANGE == 0:
            command = Command.still(count)
            command.yaw[:] = rng.uniform(-np.pi, np.pi, count)
            speed = rng.uniform(0, FASTEST, count)
            command.velocity[:] = speed[:, None] * np.column_stack([np.sin(command.yaw), np.cos(command.yaw)])
        out.append(command)
    return out


def of_steps(system: Any, commands: Sequence[Any]) -> Allocations:
    """Step a system with commands, the first 30 of which are not counted."""
    for command in commands[:WARM]:
        system.step(command)
    counted = commands[WARM:]
    temporaries, searched = np.zeros(len(counted)), np.zeros(len(counted), bool)
    gc.collect()
    with _counting_blocks() as taken:
        tracemalloc.start()
        try:
            start, _ = tracemalloc.get_traced_memory()
            for t, command in enumerate(counted):
                before, _ = tracemalloc.get_traced_memory()
                tracemalloc.reset_peak()
                system.step(command)
                temporaries[t] = tracemalloc.get_traced_memory()[1] - before
                searched[t] = _searched(system)
            gc.collect()
            kept = tracemalloc.get_traced_memory()[0] - start
        finally:
            tracemalloc.stop()
        blocks = taken() / max(1, len(counted))
    parts = temporaries[~searched], temporaries[searched]
    quiet, busy = (float(part.mean()) if part.size else np.nan for part in parts)
    return Allocations(quiet, busy, blocks, kept)


def _searched(system: Any) -> bool:
    """Whether anyone searched in the last step."""
    characters = getattr(getattr(system, "controller", system), "characters", None)
    if characters is None or "searching" not in characters.dtype.names:
        return False
    return bool(characters["searching"].any())


@contextmanager
def _counting_blocks() -> Iterator[Any]:
    """What gives the blocks that numba's runtime has taken since here."""
    from numba.core.runtime import _nrt_python as runtime  # type: ignore[attr-defined]

    counting = runtime.memsys_stats_enabled()
    runtime.memsys_enable_stats()
    before = runtime.memsys_get_stats_alloc()
    try:
        yield lambda: runtime.memsys_get_stats_alloc() - before
    finally:
        if not counting:
            runtime.memsys_disable_stats()
