"""Progress of a transfer in bytes: a bar on a terminal, plain lines elsewhere, both on standard error."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from .. import console

EVERY = 10.0  # seconds between two plain lines


def amount(count: float | None) -> str:
    """A number of bytes for a person: ``1.47 GB``; a dash where it is not known."""
    if count is None:
        return "-"
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} B"


@contextlib.contextmanager
def meter(label: str, total: int | None, start: int = 0) -> Iterator[Callable[[int], None]]:
    """A function to call with the bytes done so far, of total where known; start of them were there before.

    Without a label nothing is shown.
    """
    began = time.monotonic()
    if not label:
        yield lambda done: None
        return
    if console.is_terminal(sys.stderr):
        from rich.console import Console
        from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
        from rich.progress import TransferSpeedColumn as Speed

        columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), Speed())
        with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=total, completed=start)
            yield lambda done: bar.update(task, completed=done)
        return
    last = began

    def lines(done: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < EVERY:
            return
        last, rate = now, max(done - start, 0) / (now - began)
        share = amount(done) + (f" of {amount(total)}" if total else "")
        left = f", {(total - done) / rate:.0f} s left" if total and rate > 0 else ""
        print(f"{label}: {share}, {amount(rate)}/s{left}", file=sys.stderr, flush=True)

    yield lines
