"""Features of a search in the world: where the query has joints, and where the frame that answers it has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion import quat

from ..scene import Arrows, Layer, Lines, Points
from . import colours
from .moment import Moment, Root

Array = NDArray[np.floating]

SECONDS = 0.1  # of a velocity that its arrow goes


def compared(moment: Moment) -> dict[str, Layer]:
    """The last search's query and the frame that played on after it: joints and their velocities.

    They stand where the character was then. Lines go from where the query has a joint to where the frame has
    it: what a jump would have to make up for.
    """
    if moment.search is None:
        return {}
    record, root = moment.search
    found: dict[str, Layer] = {}
    ends = []
    for name, features, shade in (
        ("query", moment.raw(record["query"]), colours.SOUGHT),
        ("match", moment.features(int(record["frame"])), colours.MATCHED),
    ):
        if features is None:
            continue
        spots, velocities = joints(moment, features, root)
        found |= {
            f"{name} points": Points(positions=spots, colours=shade, size=11.0, through=0.5),
            f"{name} velocities": Arrows(
                origins=spots, vectors=SECONDS * velocities, colours=shade, radius=0.007
            ),
        }
        ends.append(spots)
    if len(ends) == 2:
        pairs = np.stack(ends, axis=1).reshape(-1, 3)
        found["differences"] = Lines(
            points=pairs, starts=np.arange(0, len(pairs), 2), colours=colours.SOUGHT, through=0.5
        )
    return found


def joints(moment: Moment, features: Array, root: Root) -> tuple[Array, Array]:
    """World positions and velocities [P, 3] of the joints whose positions features [F] hold; a velocity that
    they do not hold is 0."""
    assert moment.schema is not None
    spots, velocities = [], []
    slices = moment.schema.slices
    speeds = {f.role: slices[f.name] for f in moment.schema.features if f.kind == "velocity"}
    for feature in moment.schema.features:
        if feature.kind == "position":
            spots.append(features[slices[feature.name]])
            at = speeds.get(feature.role)
            velocities.append(np.zeros(3) if at is None else features[at])
    turn = quat.from_yaw(np.array(root.yaw))
    where = moment.on_ground(root.position, lift=0.0)
    return (
        where + quat.rotate(turn, np.array(spots, np.float64).reshape(-1, 3)),
        quat.rotate(turn, np.array(velocities, np.float64).reshape(-1, 3)),
    )
