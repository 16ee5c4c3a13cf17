"""What a character costs in a crowd: microseconds a character and frame by number of characters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mm import course as courses
from mm.control import System
from mm.controller import Controller, build_index
from mm.course import Course
from mm.database import Database
from mm.driving import Clock, at_data_speeds, drive
from mm.settings import Settings
from motion import console
from motion.errors import UserError

from . import timing

NEVER = 1e6  # seconds between searches, metres a second per second: none but at a clip's end


def measure(
    database: Database,
    *,
    counts: Sequence[int] = (1, 16, 256, 1024),
    index: str = "exact",
    seconds: float = 5.0,
    repeats: int = 3,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """A row a count: microseconds a character and frame, one pinned thread, warm.

    Characters are spread over a random user's script, so that no two do the same. us: mean with a search
    every 0.1 s and when the command changes abruptly; p99_us: 99th percentile of the frames; no_search_us:
    median of frames without any search; then the mean of each stage with search. Of each frame the least of
    repeats runs counts, since each run does the same again.
    """
    if not counts or min(counts) < 1:
        raise UserError(f"counts {list(counts)}", remedy="give numbers of at least 1, as 1,16,256")
    settings = Settings()
    shared = build_index(database, index, settings)
    course = at_data_speeds(courses.load("random"), database)
    frames = max(2, round(seconds * database.fps))
    rows = []
    for count in console.progress(counts, label="crowd", unit="counts") if progress else counts:
        with_search, without = (
            cost(Controller(database, count=count, settings=chosen, index=shared), course, frames, repeats)
            for chosen in (settings, Settings(search_interval=NEVER, forced_search_change=NEVER))
        )
        each = 1e6 / count
        rows.append(
            {
                "characters": count,
                "us": float(each * with_search.whole.mean()),
                "p99_us": float(each * np.percentile(with_search.whole, 99)),
                "no_search_us": float(each * np.median(without.whole)),
            }
            | {
                f"{name.replace(' ', '_')}_us": float(each * t.mean())
                for name, t in with_search.stages.items()
            }
        )
    return rows


def cost(system: System, course: Course, frames: int, repeats: int) -> timing.Cost:
    """What so many frames of a system take whose characters are spread over a course."""
    clock = Clock(course, system.count, system.fps, spread=True)
    next(frame for frame in drive(system, clock) if frame == frames)
    return timing.frame_cost(system, clock, frames, repeats=repeats)
