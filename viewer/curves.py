"""Numbers by step, for live plots: what a character costs, how fast it goes, how its feet skate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm import metrics

from .moments import costs, touches
from .timeline import Timeline

Array = NDArray[np.floating]

UNITS = {"cost": "", "speed": "m/s", "asked": "m/s", "skate": "cm/s", "step": "ms"}


def of(
    timeline: Timeline,
    *,
    since: int = 0,
    contact_roles: Sequence[str] | None = None,
    rest: ArrayLike | None = None,
) -> dict[str, Array]:
    """The times, and each of `UNITS`, of the steps remembered since a step, [T] each; NaN where not known.

    cost : of what plays on after the last search (`viewer.moments.costs`).
    speed, asked : of the ground root, averaged over 0.2 s, and of the command.
    skate : the mean over the feet of `metrics.skate`, averaged over 0.2 s; rest [C] are the heights at which
        they stand (`Description.legs`), by default those that these steps show.
    step : wall time of the system's step.
    """
    count = timeline.last + 1 - max(since, timeline.first)
    found = {name: np.full(count, np.nan) for name in ("time", *UNITS)}
    found["time"] = np.arange(timeline.last + 1 - count, timeline.last + 1) / timeline.fps
    found["step"] = 1e3 * timeline.step_seconds(since=since)
    if "feature_costs" in timeline.names:
        found["cost"] = costs(timeline, since=since)
    if "command_velocity" in timeline.names:
        found["asked"] = np.linalg.norm(timeline.stack("command_velocity", since=since), axis=-1)
    if count < 2:
        return found
    cuts = timeline.cuts(since=since)[1:]
    root = timeline.stack("positions", since=since)[:, 0, [0, 2]].astype(np.float64)
    found["speed"][1:] = _smooth(
        np.linalg.norm(np.diff(root, axis=0), axis=-1) * timeline.fps, cuts, timeline.fps
    )
    feet = touches(timeline, contact_roles, since=since)
    if feet is not None:
        heights = metrics.resting_heights(feet) if rest is None else np.asarray(rest)
        skate = metrics.skate(feet, timeline.fps, heights).mean(axis=-1)
        found["skate"][1:] = _smooth(skate, cuts, timeline.fps)
    return found


def _smooth(values: Array, cuts: NDArray[np.bool_], fps: float) -> Array:
    """Averages of values [T], to which a cut adds nothing."""
    return metrics.smooth(np.where(cuts, 0.0, values), fps)
