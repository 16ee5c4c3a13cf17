"""Ctrl-C in a training: it waits for the end of an iteration where that costs little and keeps much."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass
class Stop:
    """What Ctrl-C asks for: to stop at once or, where it waits, after the iteration."""

    asked: bool = False
    waits: bool = False


@contextlib.contextmanager
def patience(path: Path) -> Iterator[Stop]:
    """Ctrl-C is noted where stopping waits; elsewhere, and a second time, it stops at once."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: Any) -> None:
        if stop.asked or not stop.waits:
            known = "; give --resume to go on from the last checkpoint" if path.is_file() else ""
            raise KeyboardInterrupt(f"stopped at once{known or ', before the first checkpoint'}")
        stop.asked = True

    signal.signal(signal.SIGINT, note)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
