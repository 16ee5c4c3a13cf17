"""Ways on the ground: what is asked, what is predicted from it, and what the frame that plays goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.trajectory import facing
from motion import quat

from ..scene import Arrows, Floats, Layer, Lines, Points
from . import colours
from .moment import Moment

Array = NDArray[np.floating]

AHEAD = 1.0  # seconds that a command is drawn for
ARROW = 0.22  # metres of a facing


def asked_and_predicted(moment: Moment) -> dict[str, Layer]:
    """The velocity and facing asked, for a second, and the samples that are predicted of it."""
    record = moment.record
    found: dict[str, Layer] = {}
    if "command_velocity" in record:
        found |= _asked(moment, record["command_velocity"], float(record["command_yaw"]))
    if "trajectory" in record:
        x, z, yaws = record["trajectory"].T
        points, facings = np.stack([x, z], axis=-1), facing(yaws)
        if _all_ahead(moment, len(points)):
            points = np.concatenate([record["simulation_position"][None], points])
            facings = np.concatenate([np.full((1, 2), np.nan), facings])
        found |= along(moment, points, facings, colours.PREDICTED)
    return found


def of_match(moment: Moment) -> dict[str, Layer]:
    """The way that the database's frame that plays goes, from where the character is."""
    frame = int(moment.record.get("frame", -1))
    features = moment.features(frame)
    if features is None or not len(moment.schema.trajectory() if moment.schema else ()):
        return {}
    return along(moment, *moment.way(features, moment.root), colours.MATCHED)


def along(moment: Moment, points: Array, facings: Array, colour: Floats) -> dict[str, Layer]:
    """A line through points [K, 2], with arrows where facings [K, 2] are known."""
    spots, known = moment.on_ground(points), np.isfinite(facings).all(axis=1)
    return {
        "way": Lines(points=spots, colours=colour, width=3.5, through=0.35),
        "samples": Points(positions=spots[known], colours=colour, size=8.0, through=0.35),
        "facings": _arrows(spots[known], facings[known] * ARROW * moment.size, colour, 0.011 * moment.size),
    }


def _asked(moment: Moment, velocity: Array, yaw: float) -> dict[str, Layer]:
    """An arrow as long as the way that is asked for in a second; whoever is to stand has only a facing."""
    start = moment.on_ground(moment.root.position, lift=0.03)
    ends = AHEAD * np.asarray(velocity, np.float64)
    size = moment.size
    begin = start + 0.45 * size * quat.rotate(quat.from_yaw(np.array(yaw)), np.array([0.0, 0.0, 1.0]))
    return {
        "asked": _arrows(start[None], ends[None], colours.ASKED, 0.016 * size),
        "asked facing": _arrows(
            begin[None], size * ARROW * facing(np.array([yaw])), colours.ASKED, 0.011 * size
        ),
    }


def _arrows(origins: Array, level: Array, colour: Floats, radius: float) -> Arrows:
    vectors = np.stack([level[:, 0], np.zeros(len(level)), level[:, 1]], axis=-1)
    return Arrows(origins=origins, vectors=vectors, colours=colour, radius=radius)


def _all_ahead(moment: Moment, count: int) -> bool:
    """Whether samples are those of a schema that begins after now, so that the way to them is not told."""
    times = moment.schema.trajectory().times if moment.schema is not None else np.zeros(0)
    return len(times) == count and bool(times[0] > 0)
