"""The whole judgement of a model: its networks alone, all together, and for a long time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Heightmap
from lmm.mixtures import COMBINATIONS
from lmm.model import Model
from mm import queries as recorded
from mm.database import Database
from mm.driving import COURSES, SECONDS
from motion import console

from . import blame, decompressor, driving, projector, stepper

SEED = 20_000

# What is good enough: at most so much.
WHOLE_CM, HELD_OUT_CM, DRIFT_STEPS, DRIFT_CM, REGRET, SHARE_OF_MM = 1.0, 2.0, 10, 5.0, 1.05, 1.1


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is measured.

    Attributes
    ----------
    starts : free runs of the stepper, of each part of the data.
    queries : asked of the projector, of each kind.
    courses, mixed : names of courses for the model and motion matching, and for all mixtures of stages.
    seconds, mixed_seconds : of each course, at most.
    each : characters on a course; one alone may be lucky.
    minutes, characters : of the long run.
    """

    starts: int = stepper.STARTS
    queries: int = 20_000
    courses: tuple[str, ...] = COURSES
    seconds: float = SECONDS
    mixed: tuple[str, ...] = driving.MIXED
    mixed_seconds: float = 20.0
    each: int = 8
    minutes: float = 10.0
    characters: int = 16


QUICK = Plan(
    starts=500,
    queries=5_000,
    courses=("circle", "star", "random"),
    seconds=10.0,
    mixed=("circle", "random"),
    mixed_seconds=5.0,
    each=2,
    minutes=1.0,
    characters=8,
)


def evaluate(
    model: Model,
    database: Database,
    plan: Plan = Plan(),
    *,
    ground: Heightmap | None = None,
    seed: int = SEED,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> dict[str, Any]:
    """All numbers, as plain data (None where there is none); a model of another database is a UserError.

    decompressor : `decompressor.errors` of the whole database, the training and the held-out clips.
    stepper : of the latter two, rows of `stepper.Drift.table` and the whole curves.
    projector : `projector.errors` on real queries, of a user that no training learns from, and on noisy rows
        of the training and the held-out clips.
    courses, systems : rows of the model and of motion matching, feet held and not (`driving.Judge`).
    mixtures : a row for each mixture of learned and classical stages, over fewer courses, `mixed`.
    blame : sentences on which stage makes the learned system worse than motion matching (`blame.told`), over
        those courses.
    ground : facts of what is walked on there, where that is given; all else is of level ground.
    endurance : `driving.endure`.
    targets : what is good enough, what was found, and whether it is met.
    """
    model.check(database)
    with np.errstate(over="ignore", invalid="ignore"):  # networks that run away are told of, not warned of
        return plain(_measured(model, database, plan, ground, seed, progress))


def _measured(
    model: Model,
    database: Database,
    plan: Plan,
    ground: Heightmap | None,
    seed: int,
    progress: Callable[..., Iterator[Any]],
) -> dict[str, Any]:
    latents = model.latents(database)
    trained = model.training_ranges(database)
    parts: dict[str, NDArray[np.bool_] | None] = {"training": trained}
    if not trained.all():
        parts["held_out"] = ~trained
    found: dict[str, Any] = {"database": about(database), "model": _about_model(model)}
    found["ground"] = ground and ground.facts()
    found["decompressor"] = {
        name: decompressor.errors(model, database, latents, ranges=ranges)
        for name, ranges in progress(
            [("whole", None), *parts.items()], label="decompressor", unit="parts of the data"
        )
    }
    found["stepper"] = {}
    for name, ranges in progress(list(parts.items()), label="stepper", unit="parts of the data"):
        drift = stepper.drift(model, database, latents, starts=plan.starts, ranges=ranges, seed=seed)
        found["stepper"][name] = {"drift": drift.table(), "curves": drift.curves()}
    asked = recorded.record(database, plan.queries, seed=seed)
    kinds = {"real": asked} | {
        name: projector.noisy_rows(database, asked, ranges=ranges, seed=seed)
        for name, ranges in parts.items()
    }
    found["projector"] = {
        name: projector.errors(model, database, queries, latents)
        for name, queries in progress(list(kinds.items()), label="projector", unit="kinds of queries")
    }
    found |= _driven(model, database, plan, latents, ground, progress)
    found["endurance"] = driving.endure(
        model,
        database,
        seconds=60 * plan.minutes,
        characters=plan.characters,
        seed=seed,
        progress=progress,
    )
    found["targets"] = targets(found)
    return found


def _driven(
    model: Model,
    database: Database,
    plan: Plan,
    latents: NDArray,
    ground: Heightmap | None,
    progress: Callable[..., Iterator[Any]],
) -> dict[str, Any]:
    judge = driving.Judge(database, plan.courses, seconds=plan.seconds, ground=ground)
    driven = partial(driving.systems, model, database, count=plan.each, latents=latents, ground=ground)
    jobs = [
        (system, course)
        for locked in ((True, False) if model.description.legs is not None else (False,))
        for system in driven(("", "PSD"), locked=locked)
        for course in judge.courses
    ]
    rows = [judge.judge(*job) for job in progress(jobs, label="courses", unit="runs")]
    judge.take(plan.mixed, seconds=plan.mixed_seconds)
    mixtures = []
    for system in progress(
        driven(COMBINATIONS),
        label="mixtures",
        total=len(COMBINATIONS),
        unit="systems",
    ):
        (row,) = driving.summary([judge.judge(system, course) for course in judge.courses])
        mixtures.append(row | {"memory_mb": driving.memory_mb(system)})
    return {
        "courses": rows,
        "systems": driving.summary(rows),
        "mixtures": mixtures,
        "mixed": [course.name for course in judge.courses],
        "blame": blame.told(mixtures),
    }


def targets(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows: what, the most that is good enough, what was found, whether it is met."""
    rows: list[dict[str, Any]] = []

    def add(what: str, most: float, value: float | None) -> None:
        rows.append(target(what, most, value))

    poses = found["decompressor"]
    add("joint error, whole database, cm", WHOLE_CM, poses["whole"]["position_cm"]["mean"])
    if "held_out" in poses:
        add("joint error, held-out clips, cm", HELD_OUT_CM, poses["held_out"]["position_cm"]["mean"])
    rows += drifting(found["stepper"], found["database"]["fps"])
    add("projector's regret on real queries, median", REGRET, found["projector"]["real"]["regret"]["median"])
    return [*rows, *beside_matching(found, "lmm-PSD"), lasting(found)]


def target(what: str, most: float, value: float | None) -> dict[str, Any]:
    """A row of `targets`; what is infinite, as the drift of states that are no numbers any more, is bad."""
    met = None if value is None or np.isnan(value) else bool(value <= most)
    return {"what": what, "at most": most, "found": value, "met": met}


def drifting(runs: dict[str, Any], fps: float) -> list[dict[str, Any]]:
    """Targets of free runs, by part of the data."""
    after = f"drift after {DRIFT_STEPS} frames ({DRIFT_STEPS / fps:.2g} s)"
    return [
        target(f"{after}, {part.replace('_', '-')} clips, cm", DRIFT_CM, row["joints_cm"])
        for part, run in runs.items()
        for row in run["drift"]
        if row["steps"] == DRIFT_STEPS
    ]


def system_of(found: dict[str, Any], name: str) -> dict[str, Any] | None:
    """The row of a system, or of the same one with its feet free where no legs are whole."""
    rows = {row["system"]: row for row in reversed(found["systems"])}
    return rows.get(name, rows.get(f"{name}-free"))


def beside_matching(found: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Targets of a system over the courses that motion matching sets; not known where one broke on any."""
    mm, mine, rows = system_of(found, "mm"), system_of(found, name), []
    for column, what in (("skate_cm_s", "foot skate"), ("path_cm", "distance from the path")):
        if mm and mine:
            known = mine.get(column) is not None and mm.get(column) and not ("broke" in mine or "broke" in mm)
            share = mine[column] / mm[column] if known else None
            rows.append(target(f"{what} / motion matching's", SHARE_OF_MM, share))
    return rows


def lasting(found: dict[str, Any]) -> dict[str, Any]:
    """The target of the long run."""
    run = found["endurance"]
    what = f"{run['minutes']:.3g} minutes without divergence"
    return {"what": what, "at most": None, "found": None, "met": run["passed"]}


def about(database: Database) -> dict[str, Any]:
    return {
        "fingerprint": database.fingerprint,
        "frames": len(database),
        "ranges": len(database.starts),
        "fps": database.fps,
        "joints": len(database.skeleton),
        "schema": database.schema.name,
    }


def _about_model(model: Model) -> dict[str, Any]:
    return {
        "fingerprint": model.fingerprint,
        "parameters": model.parameters,
        "memory": model.memory(),
        "weights": model.decompressor.weight_type,
        "latents": model.L,
        "held_out": list(model.held_out),
        "training": model.training,
    }


def plain(value: Any) -> Any:
    """Plain data for JSON: what is no number becomes None."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
