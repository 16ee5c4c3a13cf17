"""What a character costs in a crowd: microseconds a character and frame by number of characters.

`measure` looks at stages, and at frames with and without search; `of_entries` at any systems that there are.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mm import courses
from mm.control import System
from mm.controller import Controller, build_index
from mm.course import Course
from mm.database import Database
from mm.driving import Clock, at_data_speeds, drive
from mm.settings import Settings
from motion import console
from motion.errors import UserError

from . import timing
from .entry import Entry, called
from .kept import NOTHING, Kept
from .learned import ENDINGS
from .memory import allocations
from .systems import without_legs

if TYPE_CHECKING:
    from lmm.models import AnyModel

NEVER = 1e6  # seconds between searches, metres a second per second: none but at a clip's end
COUNTS = (1, 16, 256, 1024, 4096)
# Frames of large crowds are many characters' each: so many characters' frames in all, but some searches.
SHARED_FRAMES, FEWEST, WARM = 60_000, 24, 3
ALLOCATING = 60  # frames in which a crowd is watched for what it allocates, half of which count
MOST_FRAMES = 300_000  # of all characters together, of which `measure` takes stages and searches apart


def measure(
    database: Database,
    *,
    counts: Sequence[int] = COUNTS,
    index: str = "exact",
    models: Mapping[str, AnyModel] | None = None,
    seconds: float = 5.0,
    repeats: int = 3,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """A row a system and count: microseconds a character and frame, one pinned thread, warm.

    Systems are motion matching with an index, and models by name: with all three stages learned, or a network
    of locomotion in all its ways; once more with -bf16 where the processor multiplies bfloat16 numbers. Where
    legs are not whole they are those that do not hold the feet, whose names end in -free.

    Characters are spread over a random user's script, so that no two do the same. us: mean with a search
    every 0.1 s and when the command changes abruptly; p99_us: 99th percentile of the frames; no_search_us:
    median of frames without any search, None of systems that never search; then the mean of each stage with
    search; last frame_bytes, see `allocated`. Of each frame the least of
    repeats runs counts, since each run does the same again. seconds are of a run, or less of large crowds.
    """
    if not counts or min(counts) < 1:
        raise UserError(f"counts {list(counts)}", remedy="give numbers of at least 1, as 1,16,256")
    systems = _systems(database, index, models or {}, locked=without_legs(database) is None)
    course = at_data_speeds(courses.load("random"), database)
    jobs = [(name, count) for name in systems for count in counts]
    rows = []
    for name, count in console.progress(jobs, label="crowd", unit="crowds") if progress else jobs:
        frames = max(2, min(round(seconds * database.fps), MOST_FRAMES // count))
        with_search, *without = (cost(make(count=count), course, frames, repeats) for make in systems[name])
        each = 1e6 / count
        rows.append(
            {
                "system": name,
                "characters": count,
                "us": float(each * with_search.whole.mean()),
                "p99_us": float(each * np.percentile(with_search.whole, 99)),
                "no_search_us": float(each * np.median(without[0].whole)) if without else None,
            }
            | {
                f"{stage.replace(' ', '_')}_us": float(each * t.mean())
                for stage, t in with_search.stages.items()
            }
            | {"frame_bytes": allocated(systems[name][0](count=count))}
        )
    return rows


def _systems(
    database: Database, index: str, models: Mapping[str, AnyModel], *, locked: bool
) -> dict[str, list[Callable[..., System]]]:
    """What makes each system, of a count: as it is, and if it searches, once more without any search."""
    from lmm.controller import controller
    from lmm.evaluator import Products, products_here
    from lmm.locomotion.settings import LocomotionSettings
    from lmm.models import Model, controllers

    often = Settings(foot_lock=locked)
    never = replace(often, search_interval=NEVER, forced_search_change=NEVER)
    shared = build_index(database, index, often)
    search: dict[str, Callable[..., System]] = {f"mm-{index}": partial(Controller, database, index=shared)}
    networks: dict[str, Callable[..., System]] = {}
    kinds: tuple[Products, ...] = ("float32", "bfloat16")
    for name, model in models.items():
        model.check(database)
        for products in (kind for kind in kinds if kind in products_here()):
            ending = ENDINGS[None if products == "float32" else products]
            if isinstance(model, Model):
                search[f"{name}-PSD{ending}"] = partial(controller, model, products=products)
            else:
                for way, make in controllers(model).items():
                    networks[f"{name}-{way}{ending}"] = partial(make, products=products)
    systems: dict[str, list[Callable[..., System]]] = {
        name: [partial(make, settings=settings) for settings in (often, never)]
        for name, make in search.items()
    }
    own = LocomotionSettings(foot_lock=locked)
    systems |= {name: [partial(make, settings=own)] for name, make in networks.items()}
    return {called(name, locked): ways for name, ways in systems.items()}


def cost(system: System, course: Course, frames: int, repeats: int, **options: Any) -> timing.Cost:
    """What so many frames of a system take whose characters are spread over a course; options are those of
    `timing.frame_cost`."""
    clock = Clock(course, system.count, system.fps, spread=True)
    next(frame for frame in drive(system, clock) if frame == frames)
    return timing.frame_cost(system, clock, frames, repeats=repeats, **options)


def allocated(system: System) -> float:
    """Bytes that a frame of all characters together allocates, and frees again (see `memory.allocations`);
    of frames with a search where any search."""
    found = allocations.of_steps(system, allocations.wander(system.count, frames=ALLOCATING))
    return found.frame_bytes if np.isnan(found.search_bytes) else found.search_bytes


def of_entries(
    database: Database,
    entries: Sequence[Entry],
    *,
    counts: Sequence[int] = COUNTS,
    seconds: float = 5.0,
    repeats: int = 3,
    kept: Kept = NOTHING,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> list[dict[str, Any]]:
    """A row a system and count: microseconds a character and frame, one pinned thread, warm.

    us, median_us, p99_us: mean, median and 99th percentile of frames, searches included, of each the least of
    the repeats;
    least_us, most_us: means of the fastest and of the slowest repeat, which tell what else the machine did;
    frames: how many were timed, the fewer the larger the crowd; frame_bytes: see `allocated`. Characters are
    spread over a random user's script. A system that cannot be, or breaks, has no row; what is kept is not
    measured again.
    """
    if not counts or min(counts) < 1:
        raise UserError(f"counts {list(counts)}", remedy="give numbers of at least 1, as 1,16,256")
    course = at_data_speeds(courses.load("random"), database)
    jobs = [(entry, count) for entry in entries for count in counts]
    rows: dict[tuple[str, int], dict[str, Any]] = {}
    missing = []
    for entry, count in jobs:
        frames = max(FEWEST, min(round(seconds * database.fps), SHARED_FRAMES // count))
        of: dict[str, Any] = {"crowd": entry.name, "made_of": entry.made_of, "characters": count}
        of |= {"frames": frames, "repeats": repeats, "played": course.to_dict()}
        before = None if entry.made_of is None else kept.find(of)
        if before is None:
            missing.append((entry, count, frames, of))
        else:
            rows[entry.name, count] = before[0]
    done = len(jobs) - len(missing)
    for entry, count, frames, of in progress(
        missing, label="crowds", total=len(jobs), first=done, unit="crowds"
    ):
        with contextlib.suppress(UserError):
            row = _row(entry.make(database, count), entry.name, course, frames, repeats)
            rows[entry.name, count] = row
            if entry.made_of is not None:
                kept.keep(of, row, {})
    return [rows[entry.name, count] for entry, count in jobs if (entry.name, count) in rows]


def _row(system: System, name: str, course: Course, frames: int, repeats: int) -> dict[str, Any]:
    with timing.single_thread():
        found = cost(system, course, frames, repeats, warm=WARM, stages=False)
    each = 1e6 / system.count
    return {
        "system": name,
        "characters": system.count,
        "us": float(each * found.whole.mean()),
        "median_us": float(each * np.median(found.whole)),
        "p99_us": float(each * np.percentile(found.whole, 99)),
        "least_us": float(each * found.means.min()),
        "most_us": float(each * found.means.max()),
        "frames": len(found.whole),
        "frame_bytes": allocated(system),
    }
