"""What a system keeps resident: measured in a process of its own, in which it is made and run twice.

The first time loads all code, compiled kernels included. What the process still holds when the system is gone
again is its base; what it holds beyond that while the system is made and run once more is the system's. That
is files read, pages of mapped ones included (all, since checksums are verified), what is built of them, and
what steps allocate; not the interpreter, libraries and kernels.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motion import console

if TYPE_CHECKING:
    from mm.control import System

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
STEPS = 120  # frames
# Large arrays are the system's own pages, which go back to it when they are freed.
ALLOCATOR = {"MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}


@dataclass(frozen=True)
class Subject:
    """A system by its name, and the files that it is made of."""

    system: str
    database: str | None = None
    models: Sequence[str] = ()
    codecs: Sequence[str] = ()


@dataclass(frozen=True)
class Resident:
    """Bytes: the most while the system is made and run, what it keeps then, and the process's own base."""

    peak: int
    kept: int
    base: int


def known_here() -> bool:
    """Whether this machine tells: Linux does."""
    return STATUS.exists() and os.access(FORGET, os.W_OK)


def measure(subject: Subject) -> Resident:
    """Measure a system in a process of its own."""
    command = [sys.executable, "-m", "bench.memory.resident", json.dumps(asdict(subject))]
    here = Path(__file__).resolve().parents[2]
    path = os.pathsep.join(filter(None, (str(here), os.environ.get("PYTHONPATH"))))
    environment = os.environ | ALLOCATOR | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{subject.system} could not be measured: {done.stderr.strip()}")
    return Resident(**json.loads(done.stdout))


def _made(subject: Subject) -> System:
    """The system, which alone holds what it needs of its files from here on."""
    from bench import systems
    from mm.database import Database

    models = systems.load_models(subject.models) if subject.models else {}
    database = None if subject.database is None else Database.load(subject.database)
    (entry,) = systems.choose([subject.system], models=models, codecs=subject.codecs)
    return entry.make(database, 1)


def _run(subject: Subject) -> int:
    """Make a system and step it; bytes resident at the end."""
    from mm.control import Command

    system, command = _made(subject), Command.still(1)
    for t in range(STEPS):
        command.velocity[0, 1] = 1.5 * (t > STEPS // 3)
        system.step(command)
    return _status("VmRSS")


def _status(name: str) -> int:
    """Bytes of a line of the process's status."""
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith(f"{name}:"))
    return 1024 * int(line.split()[1])


def _free() -> None:
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def main() -> None:
    subject = Subject(**json.loads(sys.argv[1]))
    _run(subject)
    _free()
    base = _status("VmRSS")
    FORGET.write_text("5")  # the peak is that from here on
    kept = _run(subject)
    console.print_json(asdict(Resident(_status("VmHWM") - base, kept - base, base)))


if __name__ == "__main__":
    main()
