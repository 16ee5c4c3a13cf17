"""A recorded run: what its searches cost by feature and time, and the moments at which it looks wrong.

Costs are those of the last search: the query against the frame that plays on after it, feature by feature,
normalised and weighted as the search counts. They stay until the next search, which has its own query.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mm import metrics, quality
from mm.database import Database
from mm.quality import Feet
from mm.recording import Recording
from motion.errors import UserError

from . import glitches
from .clips import Clips
from .glitches import Bounds

Array = NDArray[np.floating]

KINDS = ("cost", "pop", "slip")
JOINED = 0.2  # seconds between two peaks that are one moment
AFTER = 0.35  # seconds for which a transition is blended, so that what looks wrong then is its doing
NEEDED = ("feature_costs", "searched", "transition", "frame")
MOMENT = [
    "kind",
    "from_s",
    "to_s",
    "at_s",
    "value",
    "unit",
    "bound",
    "times",
    "what",
    "clip",
    "clip_s",
    "after_s",
]


@dataclass(frozen=True, eq=False)
class Run:
    """T frames of one character.

    Attributes
    ----------
    name, system, course, fps : of the recording.
    features : K names of the schema's.
    costs : [T, K] by feature.
    searched, transition : bool [T].
    pops : [T], cm.
    stances : see `glitches.stances`.
    feet, joints : names of the feet, and of the joints but the ground root.
    bounds : what the clips themselves stay below.
    moments : a row a glitch, the worst first: kind "cost" (a search that found nothing like what it was
        asked), "pop", "slip"; its worst time and value, times the bound; what it is about (feature, joint,
        foot); the clip that then played and its time; seconds since the last transition.
    """

    name: str
    system: str
    course: str
    fps: float
    features: tuple[str, ...]
    costs: Array
    searched: NDArray[np.bool_]
    transition: NDArray[np.bool_]
    pops: Array
    stances: pd.DataFrame
    feet: tuple[str, ...]
    joints: tuple[str, ...]
    bounds: Bounds
    moments: pd.DataFrame

    def __len__(self) -> int:
        return len(self.costs)

    @property
    def seconds(self) -> float:
        return len(self) / self.fps

    @property
    def blended(self) -> float:
        """Share of the time that lies within `AFTER` of a jump: of moments that have nothing to do with
        jumps, as many do."""
        since = np.arange(len(self)) - np.maximum.accumulate(
            np.where(self.transition, np.arange(len(self)), -len(self))
        )
        return float((since <= AFTER * self.fps).mean())

    @property
    def total(self) -> Array:
        """Costs [T] of all features."""
        return self.costs.sum(axis=1)


def check(recording: Recording, database: Database, path: str, *, character: int = 0) -> None:
    """A UserError unless it is a recording of that character on this database, with what is judged here."""
    missing = [name for name in NEEDED if name not in recording.arrays]
    if missing:
        what = f"a recording of {recording.system!r}, which makes no searches"
        raise UserError(what, path=path, remedy="record one with python -m mm run DB --record FILE")
    if recording.database != database.fingerprint:
        remedy = "name the database that it was recorded on, or record it again"
        raise UserError("recorded on another database", path=path, remedy=remedy)
    if recording.skeleton.names != database.skeleton.names:
        raise UserError(
            "recorded with --rig, on another skeleton", path=path, remedy="record it without --rig"
        )
    recording.clip(character)  # says which characters there are


def of_run(
    recording: Recording,
    database: Database,
    feet: Feet,
    bounds: Bounds,
    *,
    name: str = "",
    character: int = 0,
) -> Run:
    """What one character of a recording did. Feet and bounds: of the database's clips."""
    arrays = {key: array[:, character] for key, array in recording.arrays.items()}
    local = quality.in_root_space(recording.skeleton, arrays["positions"], arrays["rotations"])
    standing = glitches.touches(recording.skeleton, arrays["positions"], arrays["rotations"], feet)
    touching = arrays.get("contacts", np.zeros(standing.shape[:2], np.uint8))
    run = Run(
        name=name,
        system=recording.system,
        course=(recording.course and recording.course.name) or "",
        fps=recording.fps,
        features=tuple(feature.name for feature in database.schema.features),
        costs=np.asarray(arrays["feature_costs"], np.float64),
        searched=np.array(arrays["searched"], bool),
        transition=np.array(arrays["transition"], bool),
        pops=metrics.pops(local),
        stances=glitches.stances(standing, touching, recording.fps, feet.rest),
        feet=database.contact_roles,
        joints=database.skeleton.names[1:],
        bounds=bounds,
        moments=pd.DataFrame(),
    )
    rows = [_row(run, *moment, database, arrays["frame"]) for moment in _moments(run, local)]
    moments = pd.DataFrame(rows, columns=MOMENT)
    return replace(
        run, moments=moments.sort_values("times", ascending=False, kind="stable", ignore_index=True)
    )


Moment = tuple[str, int, int, int, float, float, str]


def _moments(run: Run, local: Array) -> Iterator[Moment]:
    """Glitches: kind, first frame, one past the last, the worst frame, its value, the bound, what it is."""
    bounds = run.bounds
    for start, stop, at in _peaks(np.where(run.searched, run.total, 0), bounds.cost, run.fps):
        most = int(run.costs[at].argmax())
        what = f"{run.features[most]}, {run.costs[at, most] / run.total[at]:.0%}"
        yield "cost", start, stop, at, run.total[at], bounds.cost, what
    for start, stop, at in _peaks(run.pops, bounds.pop_cm, run.fps):
        yield "pop", start, stop, at, run.pops[at], bounds.pop_cm, run.joints[glitches.leaping(local, at)]
    for stance in run.stances[run.stances["slip_cm"] > bounds.slip_cm].itertuples():
        frames = int(stance.start), int(stance.stop), int(stance.worst)
        yield "slip", *frames, stance.slip_cm, bounds.slip_cm, run.feet[stance.foot]


def _peaks(values: Array, bound: float, fps: float) -> Iterator[tuple[int, int, int]]:
    """Passages of values [T] beyond a bound: the first frame, one past the last, the worst."""
    for start, stop in Clips.one(len(values), fps).passages(values > bound, join=JOINED):
        yield int(start), int(stop), int(start + np.argmax(values[start:stop]))


def _row(
    run: Run,
    kind: str,
    start: int,
    stop: int,
    at: int,
    value: float,
    bound: float,
    what: str,
    database: Database,
    frames: NDArray[np.integer],
) -> tuple[Any, ...]:
    """A row of the table of moments; frames [T] of the database that played."""
    seconds = start / run.fps, stop / run.fps, at / run.fps
    jumps = np.flatnonzero(run.transition[: at + 1])
    after = (at - jumps[-1]) / run.fps if len(jumps) else np.nan
    unit = "" if kind == "cost" else "cm"
    clip, clip_s = _playing(database, int(frames[at]))
    return kind, *seconds, float(value), unit, bound, float(value / bound), what, clip, clip_s, after


def _playing(database: Database, frame: int) -> tuple[str, float]:
    """Name and seconds of the clip that a frame lies in; nothing for systems that play none."""
    if frame < 0:
        return "", float("nan")
    which = int(np.searchsorted(database.stops, frame, side="right"))
    name = database.names[which] + " mirrored" * bool(database.mirrored[which])
    return name, float((frame - database.starts[which]) / database.fps)


def by_feature(run: Run) -> pd.DataFrame:
    """A row a feature: mean and quantiles of its cost over the searches, its share of all, and of what is a
    glitch."""
    costs = run.costs[run.searched]
    peaks = costs[costs.sum(axis=1) > run.bounds.cost]
    table = pd.DataFrame({"feature": run.features, "mean": costs.mean(axis=0) if len(costs) else np.nan})
    for p in (50, 95, 99):
        table[f"p{p}"] = np.percentile(costs, p, axis=0) if len(costs) else np.nan
    for name, rows in (("share", costs), ("share_at_peaks", peaks)):
        table[name] = rows.sum(axis=0) / rows.sum() if len(rows) and rows.sum() > 0 else np.nan
    return table


def over_time(run: Run) -> pd.DataFrame:
    """A row a frame: costs by feature as of the last search, whether that was now and made a jump, pop."""
    return pd.DataFrame(
        {"time_s": np.arange(len(run)) / run.fps, "searched": run.searched, "transition": run.transition}
        | {name: run.costs[:, i] for i, name in enumerate(run.features)}
        | {"cost": run.total, "pop_cm": run.pops}
    )


def by_kind(run: Run) -> pd.DataFrame:
    """A row a kind of glitch: the bound, how many, how many a minute, how many soon after a transition."""
    rows = []
    for kind, bound in zip(KINDS, (run.bounds.cost, run.bounds.pop_cm, run.bounds.slip_cm), strict=True):
        those = run.moments[run.moments["kind"] == kind]
        rows.append(
            {
                "kind": kind,
                "bound": bound,
                "moments": len(those),
                "per_minute": 60 * len(those) / run.seconds,
                "after_transition": int((those["after_s"] <= AFTER).sum()),
                "worst": float(those["value"].max()) if len(those) else np.nan,
            }
        )
    return pd.DataFrame(rows)
