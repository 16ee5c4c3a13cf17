"""Two characters at one place: one of them clear, and how far their joints are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion import quat
from motion.skeleton import Skeleton

from ..scene import Labels, Layer, Lines, Points, Solids
from . import colours
from .moment import Moment

Array = NDArray[np.floating]

OPACITY = 0.38
FAR = 0.2  # metres between two joints that are red
WORTH = 0.01  # metres below which no line is drawn


def over(moment: Moment, other: Moment) -> dict[str, Layer]:
    """Another character's body over one, at its root, and lines between their joints, green to red."""
    turn = quat.from_yaw(np.array(moment.root.yaw - other.root.yaw))
    positions, rotations = other.world
    there, here = (each.on_ground(each.root.position, 0.0) for each in (other, moment))
    positions = quat.rotate(turn, positions - there) + here
    rotations = quat.mul(np.broadcast_to(turn, rotations.shape), rotations)
    show = other.member.show
    transforms = show.body.transforms(positions[None], rotations[None])
    found: dict[str, Layer] = {
        "body": Solids(parts=show.body.parts, transforms=transforms, opacity=OPACITY, shadow=False)
    }
    mine, its = pairs(moment.member.show.skeleton, show.skeleton)
    if not len(mine):
        return found
    ours, theirs = moment.world[0][mine], positions[its]
    apart = np.linalg.norm(ours - theirs, axis=-1)
    shades = colours.graded(apart / FAR)
    far = apart > WORTH
    ends = np.stack([ours[far], theirs[far]], axis=1).reshape(-1, 3)
    found["joints"] = Points(positions=ours, colours=shades, size=9.0, through=0.85)
    found["distances"] = Lines(
        points=ends, starts=np.arange(0, max(len(ends), 1), 2), colours=np.repeat(shades[far], 2, axis=0),
        width=3.0, through=0.85,
    )  # fmt: skip
    where = here + np.array([0.0, ours[:, 1].max() - here[1] + 0.22, 0.0])
    words = f"{moment.member.name} and {other.member.name} (clear): {100 * apart.mean():.1f} cm apart"
    found["mean"] = Labels(texts=[words], positions=where[None], size=18.0)
    return found


def pairs(one: Skeleton, other: Skeleton) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Joints that two skeletons share, but for ground roots: of the same names, or else roles."""
    if one.same_joints(other):
        both = [(j, j) for j in range(len(one))]
    else:
        both = [(one.roles[role], other.roles[role]) for role in one.roles if role in other.roles]
    both = [pair for pair in both if pair[0] != one.roles.get("root")]
    found = np.array(sorted(set(both)), np.int64).reshape(-1, 2)
    return found[:, 0], found[:, 1]
