"""What a character costs in a crowd: microseconds a character and frame by number of characters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

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
from .systems import called, without_legs

if TYPE_CHECKING:
    from lmm.model import Model

ENDINGS = {"float32": "", "bfloat16": "-bf16"}
NEVER = 1e6  # seconds between searches, metres a second per second: none but at a clip's end


def measure(
    database: Database,
    *,
    counts: Sequence[int] = (1, 16, 256, 1024),
    index: str = "exact",
    models: Mapping[str, Model] | None = None,
    seconds: float = 5.0,
    repeats: int = 3,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """A row a system and count: microseconds a character and frame, one pinned thread, warm.

    Systems are motion matching with an index, and models by name with all three stages learned, once more
    with -bf16 where the processor multiplies bfloat16 numbers; where legs are not whole those that do not
    hold the feet, whose names end in -free.

    Characters are spread over a random user's script, so that no two do the same. us: mean with a search
    every 0.1 s and when the command changes abruptly; p99_us: 99th percentile of the frames; no_search_us:
    median of frames without any search; then the mean of each stage with search. Of each frame the least of
    repeats runs counts, since each run does the same again.
    """
    if not counts or min(counts) < 1:
        raise UserError(f"counts {list(counts)}", remedy="give numbers of at least 1, as 1,16,256")
    shared, locked = build_index(database, index, Settings()), without_legs(database) is None
    systems: dict[str, Callable[..., System]] = {
        called(f"mm-{index}", locked): partial(Controller, database, index=shared)
    }
    for name, model in (models or {}).items():
        model.check(database)
        for products, ending in _products().items():
            systems[called(f"{name}-PSD{ending}", locked)] = _learned(model, products)
    often = Settings(foot_lock=locked)
    never = replace(often, search_interval=NEVER, forced_search_change=NEVER)
    course = at_data_speeds(courses.load("random"), database)
    frames = max(2, round(seconds * database.fps))
    jobs = [(name, count) for name in systems for count in counts]
    rows = []
    for name, count in console.progress(jobs, label="crowd", unit="crowds") if progress else jobs:
        with_search, without = (
            cost(systems[name](count=count, settings=settings), course, frames, repeats)
            for settings in (often, never)
        )
        each = 1e6 / count
        rows.append(
            {
                "system": name,
                "characters": count,
                "us": float(each * with_search.whole.mean()),
                "p99_us": float(each * np.percentile(with_search.whole, 99)),
                "no_search_us": float(each * np.median(without.whole)),
            }
            | {
                f"{stage.replace(' ', '_')}_us": float(each * t.mean())
                for stage, t in with_search.stages.items()
            }
        )
    return rows


def _products() -> dict[Any, str]:
    """What this processor multiplies, and how names of systems say so."""
    from lmm.evaluator import products_here

    return {name: ending for name, ending in ENDINGS.items() if name in products_here()}


def _learned(model: Model, products: Any) -> Callable[..., System]:
    from lmm.controller import controller

    return partial(controller, model, products=products)


def cost(system: System, course: Course, frames: int, repeats: int) -> timing.Cost:
    """What so many frames of a system take whose characters are spread over a course."""
    clock = Clock(course, system.count, system.fps, spread=True)
    next(frame for frame in drive(system, clock) if frame == frames)
    return timing.frame_cost(system, clock, frames, repeats=repeats)
