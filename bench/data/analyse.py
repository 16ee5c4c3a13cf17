"""All that is told of a database, and of a run on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mm import quality
from mm.course import Course
from mm.database import Database
from mm.quality import Feet
from mm.recording import Recording
from motion import console

from .. import coverage
from ..coverage import Coverage
from . import components, costs, duplicates, features, glitches, reach
from .clips import Clips
from .components import Components
from .costs import Run
from .duplicates import Twice
from .glitches import Bounds

STEPS = ("features", "components", "neighbours", "spare frames", "glitches", "coverage")


@dataclass(eq=False)
class Analysis:
    """What was found.

    Attributes
    ----------
    name, database, clips : what it is about; clips are the database's without mirrored copies.
    values : float32 [T, F], the features in their units; states [T, 3] speed, direction, turn of each frame.
    columns, weights, correlations, redundant, outliers : see `features`.
    components : see `components`.
    twice, near, price : what is there twice, within what seconds, and what searches lose without the spare.
    bounds, leaps : see `glitches`.
    coverage, speeds : what courses ask for (None without courses), and how fast it goes in each direction.
    run : of the recording, None without one.
    """

    name: str
    database: Database
    clips: Clips
    values: NDArray[np.float32]
    states: NDArray[np.floating]
    columns: pd.DataFrame
    weights: pd.DataFrame
    correlations: pd.DataFrame
    redundant: pd.DataFrame
    outliers: pd.DataFrame
    components: Components
    twice: Twice
    near: float
    price: float | None
    bounds: Bounds
    leaps: pd.DataFrame
    coverage: Coverage | None
    speeds: pd.DataFrame
    run: Run | None

    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables by the names that they have on disk."""
        database, clips, twice = self.database, self.clips, self.twice
        found = {
            "features": self.columns,
            "weights": self.weights,
            "correlations": self.correlations.rename_axis("column").reset_index(),
            "redundant": self.redundant,
            "outliers": self.outliers,
            "leaps": self.leaps,
            "components": components.table(self.components, database.schema.columns),
            "speeds": self.speeds,
            "clips": duplicates.by_clip(twice, clips),
            "twice": duplicates.stretches(twice, clips),
            "spare": duplicates.spares(twice, clips),
            "alone": duplicates.alone(twice, clips),
        }
        if self.coverage is not None:
            found["holes"] = pd.DataFrame(self.coverage.holes())
        if self.run is not None:
            found |= {
                "run_features": costs.by_feature(self.run),
                "run_glitches": costs.by_kind(self.run),
                "run_moments": self.run.moments,
                "run_costs": costs.over_time(self.run),
            }
        return found


def analyse(
    database: Database,
    *,
    name: str = "",
    courses: Sequence[Course] = (),
    seconds: float = 20.0,
    near: float = duplicates.NEAR,
    recording: Recording | None = None,
    recording_name: str = "",
    character: int = 0,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> Analysis:
    """Of a database, and of one character of a recording that was made on it.

    courses : what is asked of the data, to say what of it is missing; seconds of each at most.
    near : seconds of ordinary motion, so far apart in cost are two frames that are the same.
    progress : wraps the list of steps.
    """
    steps = progress(STEPS, label="analyse", unit="steps")
    schema, clips = database.schema, Clips.of(database)
    normalised = np.asarray(database.features)
    next(steps)
    values = features.raw(database)
    columns = features.columns(schema, values)
    correlations = features.correlation(schema, values)
    next(steps)
    principal = components.find(normalised)
    next(steps)
    poses = database.poses[clips.frames]
    local = quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
    twice = duplicates.find(database, clips, local, near=near)
    known = np.flatnonzero(twice.nearest >= 0)
    pairs = (normalised[clips.frames[which]] for which in (known, twice.nearest[known]))
    next(steps)
    price = duplicates.price(database, clips, twice) if twice.spare.any() else 0.0
    next(steps)
    feet, pops = Feet.of(database), glitches.pops(local, clips)
    bounds = glitches.bounds(twice.cost, pops, glitches.slips_of(database, clips, feet))
    next(steps)
    states, _ = coverage.frames_of(database)
    done = Analysis(
        name=name,
        database=database,
        clips=clips,
        values=values,
        states=states,
        columns=columns,
        weights=features.weights(schema, normalised, *pairs),
        correlations=correlations,
        redundant=features.redundant(correlations),
        outliers=features.outliers(columns, values[clips.frames], clips),
        components=principal,
        twice=twice,
        near=near,
        price=price,
        bounds=bounds,
        leaps=glitches.leaps(local, pops, clips, bounds.pop_cm, database.skeleton.names[1:]),
        coverage=coverage.measure(database, courses, seconds=seconds) if courses else None,
        speeds=reach.by_speed(states, database.ranges(), database.fps),
        run=None
        if recording is None
        else costs.of_run(recording, database, feet, bounds, name=recording_name, character=character),
    )
    next(steps, None)
    return done
