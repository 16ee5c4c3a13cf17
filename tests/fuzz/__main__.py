"""``python -m tests.fuzz``."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click

from motion import console
from motion.errors import UserError

from .engine import ROOT
from .targets import TARGETS


@click.command(epilog="Example: python -m tests.fuzz bvh --seconds 300 --seed 1")
@click.argument("readers", nargs=-1, type=click.Choice([*TARGETS]), metavar="[READER]...")
@click.option(
    "--seconds", type=console.Number(1, 1e6), default=60, show_default=True, help="For each reader."
)
@click.option("--seed", type=int, default=1, show_default=True, help="Of the mutations.")
@click.option("--compiled", is_flag=True, help="Kernels compiled with bounds checks, not plain to be seen.")
@click.option("-o", "--output", default="out/fuzz", show_default=True, help="Folder for inputs that fail.")
def main(readers: tuple[str, ...], seconds: float, seed: int, compiled: bool, output: str) -> None:
    """Feed readers broken files, led by the code that they reach, and sum up.

    READER is one of bvh, asf, amc, roles, schema and so on; all of them by default. Inputs that end in
    anything but a result or one clear error are made smaller and saved; then the exit status is 1.
    """
    if importlib.util.find_spec("atheris") is None:
        raise UserError("atheris is not installed", remedy="pip install -e '.[fuzz]'")
    rows = [_run(name, seconds, seed, compiled, Path(output)) for name in readers or TARGETS]
    failures = [(row["reader"], *failure) for row in rows for failure in row.pop("failing")]
    console.print_table(rows)
    for name, kind, path, text in failures:
        click.echo(f"{name}: {kind}: {text!r}: {path}")
    sys.exit(1 if failures else 0)


def _run(name: str, seconds: float, seed: int, compiled: bool, output: Path) -> dict[str, Any]:
    """Fuzz one reader; where the process dies, what it read last is a failure, and the rest is run anew."""
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=_memory_disk()) as scratch:
        folder, stop = Path(scratch), time.monotonic() + seconds
        environment = dict(os.environ, PYTHONPATH=os.pathsep.join((str(ROOT), str(ROOT / "tests"))))
        if compiled:
            environment |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(folder / "numba")}
        else:
            environment["NUMBA_DISABLE_JIT"] = "1"
        total: dict[str, Any] = {"inputs": 0, "read": 0, "refused": 0, "slowest_ms": 0.0, "peak_mb": 0.0}
        failing: list[tuple[str, str, str]] = []
        while (left := stop - time.monotonic()) > 0.5 and len(failing) < 50:
            (folder / "report.json").unlink(missing_ok=True)
            arguments = [name, str(folder), str(round(left) or 1), str(seed + len(failing))]
            command = [sys.executable, "-m", "tests.fuzz.engine", *arguments]
            done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True)
            report = _report(folder)
            for key in ("inputs", "read", "refused"):
                total[key] += report.get(key, 0)
            for key in ("slowest_ms", "peak_mb"):
                total[key] = max(total[key], report.get(key, 0.0))
            failing += [(kind, *found) for kind, found in report.get("failures", {}).items()]
            if done.returncode == 0:
                break
            if not report:
                raise UserError(f"{name} does not start: {done.stderr.strip()[-500:]}", remedy="see above")
            last = max((folder / "scratch").iterdir(), key=lambda path: path.stat().st_mtime)
            failing.append((f"died with {done.returncode}", str(last), done.stderr.strip()[-200:]))
        lines = subprocess.run(
            [sys.executable, "-m", "tests.fuzz.engine", "--lines", name, str(folder)],
            env=dict(environment, NUMBA_DISABLE_JIT="1"),
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
        reached = json.loads(lines.stdout).values() if lines.returncode == 0 else []
        return {
            "reader": name,
            **total,
            "corpus": len(list((folder / "corpus").iterdir())),
            "lines": f"{sum(r for r, _ in reached)} of {sum(n for _, n in reached)}",
            "failures": len(failing),
            "failing": [(kind, _keep(path, output), text) for kind, path, text in failing],
        }


def _report(folder: Path) -> dict[str, Any]:
    path = folder / "report.json"
    return json.loads(path.read_text()) if path.is_file() else {}


def _keep(path: str, output: Path) -> str:
    output.mkdir(parents=True, exist_ok=True)
    return str(shutil.copy(path, output)) if Path(path).is_file() else path


def _memory_disk() -> str | None:
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


if __name__ == "__main__":
    try:
        main(prog_name="python -m tests.fuzz")
    except UserError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
