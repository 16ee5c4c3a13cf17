"""The coverage-guided loop over one target, in a process of its own: atheris ends the process it runs in.

    python -m tests.fuzz.engine TARGET FOLDER SECONDS SEED

FOLDER gets ``corpus/``, ``failures/``, ``report.json`` and the input under test. With ``NUMBA_DISABLE_JIT=1``
the kernels are plain Python, whose branches count; with ``NUMBA_BOUNDSCHECK=1`` they are compiled and every
index is checked.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import random
import resource
import sys
import time
import traceback
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["motion", "features", "mm", "lmm"]
SLOW = 5.0  # seconds; a reader that needs so long for a few kilobytes is a defect
MEMORY = 2 << 30  # bytes that reading a few kilobytes may map beyond what the process has
LONGEST = 16_384  # bytes of an input


class Slow(Exception):
    """An input took too long."""


@dataclass
class Report:
    """What came of a run; `failures` are signature to file and message."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    slowest_ms: float = 0.0
    peak_mb: float = 0.0
    first_mb: float = 0.0
    failures: dict[str, list[str]] = field(default_factory=dict)


def main(name: str, folder: Path, seconds: int, seed: int) -> None:
    """Fuzz until the time is over; does not return."""
    import atheris

    sys.path.insert(0, str(ROOT))
    with atheris.instrument_imports(include=PACKAGES, exclude=_compiled()):
        from . import targets

        target = targets.get(name)
        seeds = target.seeds()
        corpus, failures, scratch = (folder / part for part in ("corpus", "failures", "scratch"))
        for path in (corpus, failures, scratch):
            path.mkdir(parents=True, exist_ok=True)
        for i, content in enumerate(seeds):
            (corpus / f"seed_{i}").write_bytes(content)
            targets.run(target, content, scratch)
    report = Report(first_mb=_peak())
    _limit_memory()
    last_saved = time.monotonic()

    def signature(data: bytes) -> tuple[str, str]:
        """What is wrong with an input, as a short name and as text; empty if nothing is."""
        start = time.perf_counter()
        try:
            found = targets.run(target, data, scratch)
            if time.perf_counter() - start > SLOW:
                raise Slow(f"{time.perf_counter() - start:.1f} s")
            setattr(report, found, getattr(report, found) + 1)
            return "", ""
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:
            frames = traceback.extract_tb(error.__traceback__)
            ours = [
                f for f in frames if f.filename.startswith(str(ROOT)) and "site-packages" not in f.filename
            ]
            where = f"{Path(ours[-1].filename).relative_to(ROOT)}:{ours[-1].lineno}" if ours else "?"
            return f"{type(error).__name__} at {where}", f"{error}"[:300]

    def one(data: bytes) -> None:
        nonlocal last_saved
        start = time.perf_counter()
        kind, text = signature(data)
        spent = 1000 * (time.perf_counter() - start)
        report.inputs += 1
        if spent > report.slowest_ms:
            report.slowest_ms = spent
            (folder / "slowest").write_bytes(data)
        if kind and kind not in report.failures and len(report.failures) < 50:
            data = minimised(data, lambda smaller: signature(smaller)[0] == kind)
            path = failures / f"{name}-{hashlib.sha256(data).hexdigest()[:12]}{target.suffix}"
            path.write_bytes(data)
            report.failures[kind] = [str(path), text]
            _save(report, folder)
        elif time.monotonic() - last_saved > 1:
            last_saved = time.monotonic()
            _save(report, folder)

    def spoil(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if target.inside is None and rng.random() < 0.2:
            return atheris.Mutate(data, most)
        if rng.random() < 0.3:  # what has been spoiled many times is refused early
            data = rng.choice(seeds)
        return targets.spoil(target, rng, data, rng.choice(seeds))[:most]

    limits = f"-max_total_time={seconds} -timeout=60 -max_len={LONGEST} -len_control=0 -rss_limit_mb=0"
    options = [*limits.split(), f"-seed={seed or 1}", f"-artifact_prefix={folder}/", "-verbosity=0"]
    atheris.Setup(["fuzz", *options, str(corpus)], one, custom_mutator=spoil)
    atheris.Fuzz()


def minimised(data: bytes, fails: Any, budget: float = 10.0) -> bytes:
    """A shorter input that fails alike: pieces are cut out, large ones first, until the time is over."""
    stop, size = time.monotonic() + budget, len(data) // 2
    while size >= 1 and time.monotonic() < stop:
        at = 0
        while at < len(data) and time.monotonic() < stop:
            shorter = data[:at] + data[at + size :]
            if fails(shorter):
                data = shorter
            else:
                at += size
        size //= 2
    return data


def _compiled() -> list[str]:
    """Modules with kernels, which cannot be compiled with the engine's own calls among their lines."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        return []
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    kernels = [path for path in files if "numba.njit" in path.read_text()]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in kernels]


def _peak() -> float:
    """The most memory that the process has had so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _limit_memory() -> None:
    with contextlib.suppress(OSError, ValueError):
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))


def _save(report: Report, folder: Path) -> None:
    report.peak_mb = _peak()
    temporary = folder / "report.tmp"
    temporary.write_text(json.dumps(asdict(report)))
    temporary.replace(folder / "report.json")


def lines_reached(name: str, folder: Path, most: int = 3000) -> dict[str, tuple[int, int]]:
    """Lines of the target's modules that the corpus runs, and how many there are, by file."""
    from . import targets

    target = targets.get(name)
    files = sorted(
        path
        for module in target.modules
        for path in ([ROOT / module] if module.endswith(".py") else (ROOT / module).rglob("*.py"))
    )
    reached: dict[str, set[int]] = {str(path): set() for path in files}

    def trace(frame: Any, event: str, argument: Any) -> Any:
        lines = reached.get(frame.f_code.co_filename)
        if lines is None:
            return None
        lines.add(frame.f_lineno)
        return trace

    corpus = sorted((folder / "corpus").iterdir())
    sys.settrace(trace)
    try:
        for path in corpus[:most]:
            with contextlib.suppress(Exception):
                targets.run(target, path.read_bytes(), folder / "scratch")
    finally:
        sys.settrace(None)
    found = {}
    for path in files:
        lines = _lines_of_functions(path)
        found[str(path.relative_to(ROOT))] = (len(lines & reached[str(path)]), len(lines))
    return found


def _lines_of_functions(path: Path) -> set[int]:
    """Line numbers of what is in functions; the rest runs on import."""
    lines: set[int] = set()
    stack = [(compile(path.read_text(), str(path), "exec"), True)]
    while stack:
        code, outside = stack.pop()
        if not outside:
            lines |= {n for _, _, n in code.co_lines() if n is not None and n != code.co_firstlineno}
        for constant in code.co_consts:
            if hasattr(constant, "co_lines"):
                stack.append((constant, outside and constant.co_flags & 0x2 == 0))
    return lines


if __name__ == "__main__":
    if sys.argv[1] == "--lines":
        print(json.dumps(lines_reached(sys.argv[2], Path(sys.argv[3]))))
    else:
        main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
