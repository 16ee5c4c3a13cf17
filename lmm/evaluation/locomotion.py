"""The whole judgement of a network of locomotion: alone, beside motion matching, and for a long time."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground, Heightmap
from lmm import models
from lmm.locomotion import given_labels
from lmm.locomotion.labelling import labels_of
from lmm.locomotion.model import LocomotionModel
from lmm.locomotion.settings import LocomotionSettings
from lmm.pfnn.model import PhaseModel
from mm import metrics, quality
from mm import queries as recorded
from mm.controller import Controller
from mm.database import Database
from mm.grounded import on_ground
from mm.settings import Settings
from motion import console
from motion.errors import Note

from . import cost, driving, free_runs
from . import frames as one_step
from .evaluate import (
    HELD_OUT_CM,
    SEED,
    Plan,
    about,
    beside_matching,
    drifting,
    lasting,
    plain,
    system_of,
    target,
)

# What is good enough, besides: at most so much.
HELD_OUT_DEG, OFF_PATH_CM, STALL_S = 10.0, 50.0, 2.0
DIED_S = 10.0  # without a step, while a user asks for something else every few seconds
THESIS_FRAME_US = 376.0  # HOLDEN's mean frame in the thesis's Table 5.1

WHOLE = Plan()
Progress = Callable[..., Iterator[Any]]


def evaluate(
    model: LocomotionModel,
    database: Database,
    plan: Plan = WHOLE,
    *,
    labels: str | os.PathLike[str] | None = None,
    against: LocomotionModel | None = None,
    ground: Heightmap | None = None,
    seed: int = SEED,
    progress: Progress = console.silent,
) -> dict[str, Any]:
    """All numbers, as plain data (None where there is none); a model of other data is a UserError.

    poses : `frames.poses`, one step from true frames, of the training and the held-out clips.
    free_run : of both, rows of `free_runs.Drift.table` and the whole curves.
    files, accuracy : `frames.by_file` and `frames.over_files`, the thesis's accuracy.
    against : the same two of another network of the same data, and the significance of the difference
        (`mm.metrics.significance`); only where one is given.
    costs : `cost.costs`.
    courses, systems : rows of the model and of motion matching, feet held and not (`driving.Judge`).
    ground : facts of what is walked on there, where that is given; all else is of level ground.
    endurance : `driving.last`; what a network goes on from are its joints in root space.
    targets : what is good enough, what was found, and whether it is met.

    labels is a folder of labels to take in place of those found (`lmm.locomotion.given_labels`).
    """
    model.check(database)
    if against is not None:
        against.check(database)
    with np.errstate(over="ignore", invalid="ignore"):  # networks that run away are told of, not warned of
        truth = truth_of(model, database, labels)
        found: dict[str, Any] = {
            "kind": model.family,
            "database": about(database),
            "model": _about_model(model),
            "ground": ground and ground.facts(),
        }
        found |= _frames(truth, plan, progress)
        if against is not None:
            found["against"] = compared(found["files"], truth_of(against, database, labels))
        found["costs"] = cost.costs(model, database, seconds=min(cost.SECONDS, plan.seconds))
        found |= _driven(model, database, plan, ground, progress)
        found["endurance"] = endure(model, database, plan, seed=seed, progress=progress)
    found["targets"] = targets(found)
    return plain(found)


def truth_of(
    model: LocomotionModel, database: Database, labels: str | os.PathLike[str] | None = None
) -> one_step.Truth:
    """A database with its labels, found or given, for a model; a `motion.errors.Note` where a level ground,
    which all networks are judged on, is not that of the motion."""
    if model.training.get("terrain", {}).get("level_motion") is False:
        line = (
            "feet go up and down in the data, and the network is told of level ground: it is better than this"
        )
        warnings.warn(line, Note, stacklevel=2)
    given = None if labels is None else given_labels.read(labels, database)
    phased = isinstance(model, PhaseModel)
    return one_step.Truth(model, database, labels_of(database, phase=phased, given=given))


def _frames(truth: one_step.Truth, plan: Plan, progress: Progress) -> dict[str, Any]:
    runs = {}
    made = one_step.step(truth)
    for part in progress(list(truth.parts), label="free runs", unit="parts of the data"):
        drift = free_runs.drift(truth, part, runs=plan.starts)
        runs[part] = {"drift": drift.table(), "curves": drift.curves()}
    files = one_step.by_file(truth, made)
    return {
        "poses": one_step.poses(truth, made),
        "free_run": runs,
        "files": files,
        "accuracy": one_step.over_files(files),
    }


def compared(files: list[dict[str, Any]], other: one_step.Truth) -> dict[str, Any]:
    """The accuracy of another network, and how it differs from that of rows of `frames.by_file`."""
    its = one_step.by_file(other, one_step.step(other))
    series = [[row["relative"] for row in rows] for rows in (files, its)]
    return {
        "model": _about_model(other.model),
        "files": its,
        "accuracy": one_step.over_files(its),
        "significance": metrics.significance(*series),
    }


def _driven(
    model: LocomotionModel, database: Database, plan: Plan, ground: Heightmap | None, progress: Progress
) -> dict[str, Any]:
    judge = driving.Judge(database, plan.courses, seconds=plan.seconds, ground=ground)
    driven = systems(model, database, count=plan.each, ground=ground)
    jobs = [(system, course) for system in driven for course in judge.courses]
    rows = [judge.judge(*job) for job in progress(jobs, label="courses", unit="runs")]
    return {"courses": rows, "systems": driving.summary(rows)}


def systems(
    model: LocomotionModel, database: Database, *, count: int, ground: Ground | None = None
) -> Iterator[Any]:
    """Motion matching and the network, feet held where legs are whole, then both with their feet free; on a
    ground, of which a network that knows grounds is told."""
    index = recorded.index_of(database)
    (_, make), *_ = models.controllers(model).items()
    for locked in (True, False) if model.description.legs is not None else (False,):
        free = "" if locked else "-free"
        settings, of_network = Settings(foot_lock=locked), LocomotionSettings(foot_lock=locked)
        matching = partial(Controller, database, settings=settings, index=index, name=f"mm{free}")
        network = partial(make, settings=of_network, name=f"{model.family}{free}")
        yield on_ground(partial(matching, count=count), ground)
        yield on_ground(partial(network, count=count), ground, sees=model.sees_ground)


def endure(
    model: LocomotionModel, database: Database, plan: Plan, *, seed: int = SEED, progress: Progress
) -> dict[str, Any]:
    """`driving.last` of a network whose feet are free: does it leave the data, or die out?

    Hips may be at any height: they are where it puts them. Who takes no step for 10 s does not pass.
    """
    (_, make), *_ = models.controllers(model).items()
    driven = make(count=plan.characters, settings=LocomotionSettings(foot_lock=False))
    skeleton = database.skeleton

    def joints() -> NDArray[np.floating]:
        poses = driven.poses()
        return quality.in_root_space(skeleton, poses.positions, poses.rotations).reshape(driven.count, -1)

    run = driving.last(
        driven,
        database,
        states=joints,
        ranges=_ranges(database),
        columns=[f"{name} {axis}" for name in skeleton.names[1:] for axis in "xyz"],
        hips_loose_cm=np.inf,
        seconds=60 * plan.minutes,
        seed=seed,
        progress=progress,
    )
    return run | {"passed": run["passed"] and not run["stall_s"] > DIED_S}


def _ranges(database: Database, chunk: int = 4096) -> tuple[NDArray[np.floating], ...]:
    """The least and the most [3 (J - 1)] of the joints in root space, and how far a joint moves there along
    the axis along which it moves most: a spine that hardly ever leans aside may do so."""
    lows, highs = [], []
    for start in range(0, len(database), chunk):
        poses = database.poses[slice(start, start + chunk)]
        local = quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
        lows.append(local.min(axis=0))
        highs.append(local.max(axis=0))
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return low.ravel(), high.ravel(), np.repeat((high - low).max(axis=1), 3)


def targets(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows: what, the most that is good enough, what was found, whether it is met."""
    rows = []
    if "held_out" in found["poses"]:
        errors = found["poses"]["held_out"]
        for what, most, error in (
            ("joint error of one step, held-out clips, cm", HELD_OUT_CM, errors["position_cm"]),
            ("rotation error of one step, held-out clips, °", HELD_OUT_DEG, errors["rotation_deg"]),
        ):
            rows.append(target(what, most, error["mean"]))
    rows += drifting(found["free_run"], found["database"]["fps"])
    family = found["kind"]
    mine = system_of(found, family)
    if mine:
        rows += _of_courses(found, mine["system"])
    rows += beside_matching(found, family)
    own = [row["frame_us"] for row in found["costs"] if "network_us" in row]
    if own:
        rows.append(target("a frame of one character, µs", THESIS_FRAME_US, min(own)))
    return [*rows, lasting(found)]


def _of_courses(found: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Targets of a system on every course: who strays, dies out or breaks on one of them misses them."""
    most = max(STALL_S, (system_of(found, "mm") or {}).get("stall_s") or 0)  # or as motion matching does
    runs = [row for row in found["courses"] if row["system"] == name]
    rows = []
    for column, what, limit in (
        ("path_max_cm", "furthest from the path on any course, cm", OFF_PATH_CM),
        ("stall_s", "longest time without a step when asked to go, on any course, s", most),
    ):
        known = {
            run["course"]: np.inf if "broke" in run else run[column]
            for run in runs
            if "broke" in run or np.isfinite(run.get(column, np.nan))
        }
        worst = max(known, key=lambda course: known[course], default=None)
        where = f"{what} ({worst})" if worst else what
        rows.append(target(where, limit, known[worst] if worst else None))
    return rows


def _about_model(model: LocomotionModel) -> dict[str, Any]:
    return {
        "fingerprint": model.fingerprint,
        "parameters": model.parameters,
        "memory": model.weight_bytes(),
        "sizes": list(model.network.sizes),
        "weights": model.network.weight_type,
        "held_out": list(model.held_out),
        "training": model.training,
    }
