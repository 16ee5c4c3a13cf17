"""How time is measured: one pinned thread, warm, no collector, the clock around the step alone."""

from __future__ import annotations

import contextlib
import gc
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

LIBRARIES = ("motion-matching", "numpy", "scipy", "numba", "faiss-cpu", "pandas", "safetensors")


@contextlib.contextmanager
def single_thread() -> Iterator[None]:
    """One thread on one processor, without garbage collection; everything as before on leaving."""
    import numba

    pinnable = hasattr(os, "sched_setaffinity")
    processors = os.sched_getaffinity(0) if pinnable else set()
    threads, collecting = numba.get_num_threads(), gc.isenabled()
    faiss: Any = sys.modules.get("faiss")
    faiss_threads = faiss.omp_get_max_threads() if faiss else 1
    try:
        if pinnable:
            os.sched_setaffinity(0, {max(processors)})
        numba.set_num_threads(1)
        if faiss:
            faiss.omp_set_num_threads(1)
        gc.disable()
        yield
    finally:
        if collecting:
            gc.enable()
        if faiss:
            faiss.omp_set_num_threads(faiss_threads)
        numba.set_num_threads(threads)
        if pinnable:
            os.sched_setaffinity(0, processors)


@dataclass(eq=False)
class Cost:
    """Seconds of every frame, [T]: the whole step, and each stage in a run of its own.

    The stages' timers cost time themselves, hence other runs for them. A run does the same again, frame by
    frame, so what a frame costs is the least of several runs: what else the machine did is not counted. How
    much that was is seen by means, those of the whole step of each run [R].
    """

    whole: NDArray[np.float64]
    stages: dict[str, NDArray[np.float64]]
    searched: NDArray[np.bool_]
    means: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def microseconds(self) -> dict[str, float]:
        """The columns of the table: median, mean and p99 of the frame, and how far the means of the runs are
        apart as frame_spread_us; the mean of each stage, and the median of the projection over the frames
        that searched (one in six) as search_us."""
        whole = 1e6 * self.whole
        row = {
            "frame_us": float(np.median(whole)),
            "frame_mean_us": float(whole.mean()),
            "frame_p99_us": float(np.percentile(whole, 99)),
        }
        if len(self.means):
            row["frame_spread_us"] = float(1e6 * np.ptp(self.means))
        row |= {f"{name.replace(' ', '_')}_us": float(1e6 * t.mean()) for name, t in self.stages.items()}
        if "projection" in self.stages and self.searched.any():
            row["search_us"] = float(1e6 * np.median(self.stages["projection"][self.searched]))
        return row

    @staticmethod
    def joined(costs: Sequence[Cost]) -> Cost:
        """The frames of several runs together."""
        return Cost(
            np.concatenate([cost.whole for cost in costs]),
            {name: np.concatenate([cost.stages[name] for cost in costs]) for name in costs[0].stages},
            np.concatenate([cost.searched for cost in costs]),
            np.mean([cost.means for cost in costs], axis=0),
        )


def frame_cost(
    system: Any,
    clock: Any,
    frames: int,
    *,
    searched: NDArray[np.bool_] | None = None,
    warm: int = 30,
    repeats: int = 3,
    stages: bool = True,
) -> Cost:
    """Time a system that gets the first so many commands of a `mm.driving.Clock` again, step after step.

    First whole steps, then stages, where they are asked for and the system tells them. searched [T]: which
    steps of the run that the clock drove made a search.
    """
    commands = clock.commands[:frames]
    with single_thread():
        every = np.array([_replay(system, clock, commands, warm)[0] for _ in range(repeats)])
        by_stage: dict[str, NDArray[np.float64]] = {}
        if stages and hasattr(system, "timed"):
            system.timed = True
            try:
                runs = [_replay(system, clock, commands, warm)[1] for _ in range(repeats)]
            finally:
                system.timed = False
            by_stage = {name: np.min([run[name] for run in runs], axis=0) for name in runs[0]}
    none = np.zeros(len(commands), bool)
    found = none if searched is None else searched[: len(commands)]
    return Cost(every.min(axis=0), by_stage, found, every.mean(axis=1))


def _replay(
    system: Any, clock: Any, commands: Sequence[Any], warm: int
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Seconds [T] of each step, and of each stage of it."""
    system.reset(clock.starts, clock.yaws)
    for command in commands[:warm]:
        system.step(command)
    system.reset(clock.starts, clock.yaws)
    timed = getattr(system, "timed", False)
    whole, rows = np.zeros(len(commands)), []
    for t, command in enumerate(commands):
        start = time.perf_counter()
        system.step(command)
        whole[t] = time.perf_counter() - start
        if timed:
            rows.append(dict(system.stage_seconds))
    names = {name: None for row in rows for name in row}
    return whole, {name: np.array([row.get(name, 0.0) for row in rows]) for name in names}


def best_of(function: Callable[[], Any], *, repeats: int = 5, least: float = 0.0) -> list[float]:
    """Seconds of each of several calls, at least least in all, after one that does not count."""
    function()
    times: list[float] = []
    while len(times) < repeats or sum(times) < least:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return times


def machine() -> dict[str, str]:
    """What the numbers were measured on: processor, memory, system, versions of Python and of libraries, this
    program among them."""
    versions = {}
    for name in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return {
        "processor": _processor(),
        "processors": str(
            len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        ),
        "memory_gb": _memory(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **versions,
    }


def _processor() -> str:
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as lines:
        for line in lines:
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _memory() -> str:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9:.1f}"
    return "unknown"
