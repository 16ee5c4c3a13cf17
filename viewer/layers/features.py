"""Features of a search in the world: joints and ways, as the query has them and as its answer does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from motion import kinematics, quat

from ..scene import Arrows, Layer, Lines, Points
from . import colours
from .moment import Moment, Root
from .trajectory import along

Array = NDArray[np.floating]

SECONDS = 0.15  # of a velocity that its arrow goes


def compared(moment: Moment) -> dict[str, Layer]:
    """The last search's query and the frame that played on after it: joints, their velocities, their ways.

    They stand where the character was then. Lines go from where the query has a joint, or a place on its way,
    to where the frame has it: what they differ by.
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
        at = np.concatenate([spots, _bare(moment, record)])
        tips = np.stack([at, at + SECONDS * velocities], axis=1).reshape(-1, 3)
        found |= {
            f"{name} points": Points(positions=at, colours=shade, size=11.0, through=0.9),
            f"{name} shafts": Lines(
                points=tips, starts=np.arange(0, len(tips), 2), colours=shade, width=3.0, through=0.9
            ),
            f"{name} velocities": Arrows(
                origins=at, vectors=SECONDS * velocities, colours=shade, radius=0.008 * moment.size
            ),
        }
        if moment.schema is not None and len(moment.schema.trajectory()):
            points, facings = moment.way(features, root)
            found |= {
                f"{name} {part}": layer for part, layer in along(moment, points, facings, shade).items()
            }
            spots = np.concatenate([spots, moment.on_ground(points)])
        ends.append(spots)
    if len(ends) == 2:
        pairs = np.stack(ends, axis=1).reshape(-1, 3)
        found["differences"] = Lines(
            points=pairs, starts=np.arange(0, len(pairs), 2), colours=colours.SOUGHT, through=0.5
        )
    return found


def joints(moment: Moment, features: Array, root: Root) -> tuple[Array, Array]:
    """World positions [P, 3] of the joints whose positions features [F] hold, and velocities [V, 3]: first
    theirs, 0 where they are not held, then those of `_bare`."""
    assert moment.schema is not None
    spots, velocities, slices = [], [], moment.schema.slices
    speeds = {f.role: slices[f.name] for f in moment.schema.features if f.kind == "velocity"}
    for feature in moment.schema.features:
        if feature.kind == "position":
            spots.append(features[slices[feature.name]])
            at = speeds.pop(feature.role, None)
            velocities.append(np.zeros(3) if at is None else features[at])
    velocities += [features[at] for at in speeds.values()]
    turn = quat.from_yaw(np.array(root.yaw))
    where = moment.on_ground(root.position, lift=0.0)
    return (
        where + quat.rotate(turn, np.array(spots, np.float64).reshape(-1, 3)),
        quat.rotate(turn, np.array(velocities, np.float64).reshape(-1, 3)),
    )


def _bare(moment: Moment, record: Mapping[str, NDArray]) -> Array:
    """Where the joints were [K, 3] of which features hold velocities alone, in the order of these."""
    assert moment.schema is not None
    skeleton = moment.member.timeline.skeleton
    placed = {f.role for f in moment.schema.features if f.kind == "position"}
    bare = [f.role for f in moment.schema.features if f.kind == "velocity" and f.role not in placed]
    joints = [skeleton.roles[role] for role in dict.fromkeys(bare) if role is not None]
    world, _ = kinematics.forward(skeleton, record["positions"][None], record["rotations"][None])
    return np.asarray(world[0][np.array(joints, np.int64)], np.float64)
