"""The thesis's measurements: responsivity lap by lap, accuracy file by file, times and sizes on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench import timing
from lmm import models
from lmm.evaluation import cost, frames
from lmm.locomotion.labelling import labels_of
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.spline import SETS, Mode
from lmm.training import log
from mm import courses, metrics
from mm.course import Course
from mm.driver import Driver
from mm.driving import at_data_speeds
from mm.enlarged import shared
from motion import console, quat
from motion.errors import UserError

from . import published
from .rows import Databases, Row

COURSE = "thesis"
WARM = 120  # steps that do not count
FRAMES = 600  # of a lap, of which the time of a frame is taken in each mode


@dataclass(eq=False)
class Thesis:
    """What was found.

    Attributes
    ----------
    summary : a row a configuration, AVA-M too, what was measured beside what the thesis has (`published_`);
        without a model only the latter.
    laps : a row a lap and configuration: mean_ms, sd_ms and median_ms of its frames, path_cm and path_max_cm.
    files : a row a file and configuration: relative, relative_sd, position_cm.
    differences : a row a pair of configurations: significance of what was measured, and of the thesis's.
    modes : a row a configuration and way to evaluate the phase: frame_ms, weights_mb, memory_mb.
    pipeline, sizes : a row a step and a kind of data: seconds and MB by configuration, and the thesis's.
    training : epochs and mean squared error of the outputs by configuration, as logged.
    line : milliseconds by operations, slope and intercept; None from less than two sizes of network.
    notes : what a reader must know.
    course, mode : what was driven over, and how weights were made of the phase there.
    """

    summary: pd.DataFrame
    laps: pd.DataFrame
    files: pd.DataFrame
    differences: pd.DataFrame
    modes: pd.DataFrame
    pipeline: pd.DataFrame
    sizes: pd.DataFrame
    training: dict[str, dict[str, list[float]]]
    line: tuple[float, float] | None
    notes: list[str]
    database: dict[str, Any]
    models: dict[str, dict[str, Any]]
    course: dict[str, Any]
    mode: str
    machine: dict[str, str] = field(default_factory=timing.machine)


def measure(
    databases: Databases,
    rows: Mapping[str, Row],
    *,
    laps: int = published.LAPS,
    mode: Mode = "constant",
    name: str = "",
    progress: Callable[..., Any] = console.silent,
) -> Thesis:
    """Reproduce the experiment with models by configuration (`rows.placed`).

    laps of the six-waypoint course at the data's speeds; mode is how the phase's weights are made there, in
    the thesis constant. name is what the database is called.
    """
    if laps < 2:
        raise UserError(f"{laps} laps", remedy="ask for at least 2: a deviation is of several")
    database, notes = databases.database, _missing(rows)
    begun = time.perf_counter()
    labels = labels_of(database)
    labelled = time.perf_counter() - begun
    course = replace(at_data_speeds(courses.load(COURSE), database), laps=laps)
    found = _Found(databases, course, labels, mode)
    for row in progress(list(rows.values()), label="thesis", unit="models"):
        found.take(row)
    notes += found.notes
    return Thesis(
        summary=_summary(found, rows),
        laps=pd.DataFrame(found.laps, columns=_LAPS),
        files=pd.DataFrame(found.files, columns=_FILES),
        differences=_differences(found),
        modes=pd.DataFrame(found.modes, columns=_MODES),
        pipeline=_steps(found, rows, labelled),
        sizes=_sizes(found, rows, databases, labels),
        training={row.name: curve for row in rows.values() if (curve := _curve(row))},
        line=_line(found),
        notes=notes,
        database={
            "name": name,
            "fingerprint": database.fingerprint,
            "frames": len(database),
            "fps": database.fps,
            "minutes": database.seconds / 60,
            "ranges": len(database.starts),
            "joints": len(database.skeleton),
        },
        models={
            row.name: {
                "path": str(row.path),
                "fingerprint": row.model.fingerprint,
                "parameters": row.model.parameters,
                "sizes": list(row.model.network.sizes),
                "held_out": list(row.model.held_out),
                "training": row.model.training,
            }
            for row in rows.values()
        },
        course=course.to_dict(),
        mode=mode,
    )


_LAPS = ("configuration", "lap", "frames", "mean_ms", "sd_ms", "median_ms", "path_cm", "path_max_cm")
_FILES = (
    *("configuration", "file", "mirrored", "held_out", "frames"),
    *("relative", "relative_sd", "position_cm"),
)
_MODES = ("configuration", "mode", "frame_ms", "weights_mb", "memory_mb")


class _Found:
    """What is found of one model after the other."""

    def __init__(self, databases: Databases, course: Course, labels: Any, mode: Mode) -> None:
        self._databases, self._course, self._labels, self._mode = databases, course, labels, mode
        self.laps: list[dict[str, Any]] = []
        self.files: list[dict[str, Any]] = []
        self.modes: list[dict[str, Any]] = []
        self.operations: dict[str, int] = {}
        self.load_s: dict[str, float] = {}
        self.vectors_s: dict[str, float] = {}
        self.vectors_mb: dict[str, float] = {}
        self.notes: list[str] = []

    def take(self, row: Row) -> None:
        self.operations[row.name] = cost.of_model(row.model)
        begun = time.perf_counter()
        system = PhaseController(models.load(row.path), mode=self._mode)  # type: ignore[arg-type]
        self.load_s[row.name] = time.perf_counter() - begun
        driven = drive(system, self._course)
        self.laps += [{"configuration": row.name, **lap} for lap in driven]
        if len(driven) < self._course.laps:
            done = f"{len(driven)} of {self._course.laps} laps"
            self.notes.append(f"{row.name} did {done} in twice the time that all of them should take")
        for mode in SETS:
            system = PhaseController(row.model, mode=mode)
            self.modes.append(
                {
                    "configuration": row.name,
                    "mode": mode,
                    "frame_ms": 1000 * _frame(system, self._course),
                    "weights_mb": row.model.network.weight_bytes(mode) / 1e6,
                    "memory_mb": sum(system.memory().values()) / 1e6,
                }
            )
        self._accuracy(row)

    def _accuracy(self, row: Row) -> None:
        truth = frames.Truth(row.model, row.database, self._labels)
        begun = time.perf_counter()
        vectors = truth.frames
        self.vectors_s[row.name] = time.perf_counter() - begun
        self.vectors_mb[row.name] = (vectors.x.nbytes + vectors.y.nbytes) / 1e6
        made = frames.step(truth)
        self.files += [{"configuration": row.name, **one} for one in frames.by_file(truth, made)]
        if row.name == "AVA":
            own = shared(self._databases.database.skeleton, row.database.skeleton)
            masked = frames.by_file(truth, made, joints=[j - 1 for j in own])
            self.files += [{"configuration": published.MASKED, **one} for one in masked]

    def series(self, what: str, name: str) -> NDArray[np.float64]:
        """What was found of a configuration: "laps", mean milliseconds; "files", relative errors."""
        rows, column = (self.laps, "mean_ms") if what == "laps" else (self.files, "relative")
        return np.array([row[column] for row in rows if row["configuration"] == name], np.float64)


def drive(system: Any, course: Course) -> list[dict[str, Any]]:
    """A character's laps of a closed course: rows of their frames' times, and of how far off the path it was.

    Times are those of the step alone, one pinned thread, without garbage collection. A lap that was not ended
    when all of them should long have been is none.
    """
    driver = Driver(course, 1, system.fps)
    times: list[float] = []
    which: list[int] = []
    places: list[NDArray] = []
    with timing.single_thread():
        _warm(system, driver)
        driver.reset()
        system.reset(driver.starts, driver.yaws)
        positions, yaws = driver.starts, driver.yaws
        while not driver.done:
            command = driver.command(len(times) / system.fps, positions, yaws)
            begun = time.perf_counter()
            poses = system.step(command)
            times.append(time.perf_counter() - begun)
            positions, yaws = poses.positions[:, 0, [0, 2]], quat.yaw(poses.rotations[:, 0])
            which.append(int(driver.laps[0]))
            places.append(positions[0].copy())
    off, _ = metrics.nearest_on_path(np.array(places), np.asarray(driver.path))
    lap, took = np.array(which), 1000 * np.array(times)
    ended = int(driver.laps[0] + 1e-6)  # arc lengths are sums
    return [
        {
            "lap": n + 1,
            "frames": int(mine.sum()),
            "mean_ms": float(took[mine].mean()),
            "sd_ms": float(took[mine].std()),
            "median_ms": float(np.median(took[mine])),
            "path_cm": float(100 * off[mine].mean()),
            "path_max_cm": float(100 * off[mine].max()),
        }
        for n in range(ended)
        if (mine := lap == n).any()
    ]


def _warm(system: Any, driver: Driver) -> None:
    system.reset(driver.starts, driver.yaws)
    positions, yaws = driver.starts, driver.yaws
    for frame in range(WARM):
        system.step(driver.command(frame / system.fps, positions, yaws))


def _frame(system: Any, course: Course) -> float:
    """Median seconds of a step at the beginning of the course."""
    driver = Driver(course, 1, system.fps)
    with timing.single_thread():
        _warm(system, driver)
        times = []
        positions, yaws = driver.starts, driver.yaws
        for frame in range(WARM, WARM + FRAMES):
            command = driver.command(frame / system.fps, positions, yaws)
            begun = time.perf_counter()
            poses = system.step(command)
            times.append(time.perf_counter() - begun)
            positions, yaws = poses.positions[:, 0, [0, 2]], quat.yaw(poses.rotations[:, 0])
    return float(np.median(times))


def _missing(rows: Mapping[str, Row]) -> list[str]:
    missing = [name for name in published.CONFIGURATIONS if name not in rows]
    return [
        f"{name} is empty: no model was given. Train one with python -m lmm train "
        f"{'ENLARGED' if name == 'AVA' else 'DB'} --model pfnn --configuration {name.lower()}"
        + (", the database being one that python -m mm enlarge made" * (name == "AVA"))
        for name in missing
    ]


def _summary(found: _Found, rows: Mapping[str, Row]) -> pd.DataFrame:
    out = []
    for name in (*published.CONFIGURATIONS, published.MASKED):
        laps, files = found.series("laps", name), found.series("files", name)
        frame, theirs = published.FRAME_MS.get(name), published.ACCURACY[name]
        row: dict[str, Any] = {"configuration": name, "model": str(rows[name].path) if name in rows else None}
        row |= _mean_sd("frame_ms", laps) | _mean_sd("relative", files)
        lap_rows = [lap for lap in found.laps if lap["configuration"] == name]
        row["frame_median_ms"] = metrics.nanmean([lap["median_ms"] for lap in lap_rows])
        row["path_cm"] = metrics.nanmean([lap["path_cm"] for lap in lap_rows])
        row["path_max_cm"] = max((lap["path_max_cm"] for lap in lap_rows), default=np.nan)
        row["operations"] = found.operations.get(name, np.nan)
        row |= {
            "published_frame_ms": frame[0] if frame else np.nan,
            "published_frame_ms_sd": frame[1] if frame else np.nan,
            "published_relative": theirs[0],
            "published_relative_sd": theirs[1],
            "published_operations": published.OPERATIONS.get(name, np.nan),
        }
        out.append(row)
    return pd.DataFrame(out)


def _mean_sd(name: str, values: NDArray[np.float64]) -> dict[str, float]:
    sd = float(values.std(ddof=1)) if len(values) > 1 else np.nan
    return {name: metrics.mean(values), f"{name}_sd": sd}


def _differences(found: _Found) -> pd.DataFrame:
    rows = []
    for what, theirs in (("laps", published.FRAME_MS), ("files", published.ACCURACY)):
        for a, b in combinations(theirs, 2):
            series = found.series(what, a), found.series(what, b)
            rows.append(
                {
                    "what": {"laps": "responsivity", "files": "accuracy"}[what],
                    "a": a,
                    "b": b,
                    "significance": metrics.significance(*series),
                    "published": significance_of(theirs[a], theirs[b]),
                }
            )
    return pd.DataFrame(rows)


def significance_of(a: tuple[float, float], b: tuple[float, float]) -> float:
    """The thesis's formula 3.2 of means and deviations that are known."""
    return 2 * abs(a[0] - b[0]) / (a[1] + b[1])


def _steps(found: _Found, rows: Mapping[str, Row], labelled: float) -> pd.DataFrame:
    """Seconds of each step of the pipeline; labels are made once, which stands under HOLDEN."""
    trained = {row.name: seconds for row in rows.values() if (seconds := _trained_s(row)) is not None}
    ours: dict[str, dict[str, float]] = {
        "patches": {},
        "labels": {"HOLDEN": labelled},
        "vectors": found.vectors_s,
        "training": trained,
        "loading": found.load_s,
        "frame": {name: metrics.mean(found.series("laps", name)) / 1000 for name in rows},
    }
    theirs: dict[str, Mapping[str, float]] = {
        **published.PIPELINE_S,
        "frame": {name: mean / 1000 for name, (mean, _) in published.FRAME_MS.items()},
    }
    return _beside("step", ours, theirs)


def _sizes(found: _Found, rows: Mapping[str, Row], databases: Databases, labels: Any) -> pd.DataFrame:
    """MB of each kind of data; what all but AVA share stands under HOLDEN."""
    of = {"HOLDEN": databases.database} | {n: row.database for n, row in rows.items() if n == "AVA"}
    arrays = labels.contacts, labels.gait, labels.phase
    constant = [row for row in found.modes if row["mode"] == "constant"]
    ours: dict[str, dict[str, float]] = {
        "height fields": {},
        "patches": {},
        "motion": {name: sum(database.memory().values()) / 1e6 for name, database in of.items()},
        "labels": {"HOLDEN": sum(array.nbytes for array in arrays) / 1e6},
        "vectors": found.vectors_mb,
        "weights": {row["configuration"]: row["weights_mb"] for row in constant},
    }
    return _beside("data", ours, published.SIZES_MB)


def _beside(
    what: str, ours: Mapping[str, Mapping[str, float]], theirs: Mapping[str, Mapping[str, float]]
) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {what: name}
            | {c: ours.get(name, {}).get(c, np.nan) for c in published.CONFIGURATIONS}
            | {f"published {c}": theirs.get(name, {}).get(c, np.nan) for c in published.CONFIGURATIONS}
            for name in ours
        ]
    )


def _trained_s(row: Row) -> float | None:
    """Seconds of training, as the log beside the model has it."""
    records = _log(row)
    return float(records[-1]["seconds"]) if records else None


def _curve(row: Row) -> dict[str, list[float]] | None:
    """Epochs, and the mean squared error of the normalised outputs after them."""
    settings = row.model.training.get("settings", {}).get("pfnn", {})
    batch, frames_ = settings.get("batch"), row.model.frames
    points = [
        (record["iteration"] * batch / frames_, record["loss"]["frames"])
        for record in _log(row)
        if batch and frames_ and "frames" in record["loss"]
    ]
    if not points:
        return None
    epochs, errors = zip(*points, strict=True)
    return {"epochs": list(epochs), "mse": list(errors)}


def _log(row: Row) -> Sequence[log.Record]:
    path = log.path_of(row.path)
    return log.read(path) if path.is_file() else []


def _line(found: _Found) -> tuple[float, float] | None:
    """Milliseconds by operations: the least squares' slope and intercept."""
    points = [
        (count, float(found.series("laps", name).mean()))
        for name, count in found.operations.items()
        if len(found.series("laps", name))
    ]
    if len({count for count, _ in points}) < 2:
        return None
    counts, times = np.array(points, np.float64).T
    slope, intercept = np.polyfit(counts, times, 1)
    return float(slope), float(intercept)
