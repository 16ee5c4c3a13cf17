"""What foot locking needs to know about a skeleton: legs, knee hinges, resting heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from motion import contacts, kinematics, quat
from motion.errors import UserError
from motion.plain import plain
from motion.skeleton import Skeleton

from .database import Database

_LIMBS = {
    "toe": ("up_leg", "leg", "foot"),
    "foot": ("up_leg", "leg", "foot"),
    "hand": ("arm", "forearm", "hand"),
}
USUAL = (10, 90)  # percentiles: what is beyond are flaws of the capture
# Enough frames for a percentile; forward kinematics of all of them would take seconds.
_SAMPLE = 2000


@dataclass(eq=False)
class Legs:
    """C limbs that touch the ground.

    Attributes
    ----------
    joints : int64 [C, 4], upper joint, middle joint, end joint, and the joint that touches the ground.
    points : float32 [C, 3], what touches, in that joint's frame (`motion.contacts.touching_points`).
    hinges : float32 [C, 3], the middle joint's axis in the upper joint's frame, unit; a positive turn bends.
    heights : float32 [C, 2], lowest and highest usual height of the touching point in contact, metres.
    needed : int64 [..], every joint from the root to these, parents first.
    """

    joints: NDArray[np.int64]
    points: NDArray[np.float32]
    hinges: NDArray[np.float32]
    heights: NDArray[np.float32]
    needed: NDArray[np.int64]

    def __post_init__(self) -> None:
        for part in fields(self):
            setattr(self, part.name, plain(getattr(self, part.name)))


def joints_of_legs(skeleton: Skeleton, roles: Sequence[str]) -> NDArray[np.int64]:
    """`Legs.joints` of contact roles; a UserError where a leg is not whole."""
    rows = []
    for role in roles:
        side, _, part = role.partition("_")
        try:
            rows.append([skeleton.role(f"{side}_{joint}") for joint in _LIMBS[part]] + [skeleton.role(role)])
        except (UserError, KeyError) as error:
            raise UserError(
                f"foot locking needs the whole leg of the contact {role!r}: {error}",
                remedy="turn foot locking off, or complete the role map",
            ) from error
    return np.array(rows, np.int64).reshape(-1, 4)


def find_legs(database: Database) -> Legs:
    """Legs of a database's contact roles; a skeleton without them is a UserError.

    The hinge is the mean over the data of thigh x shin (bent knees weigh more), the heights percentiles
    over frames in contact (somebody who sits or kneels touches lower).
    """
    skeleton = database.skeleton
    joints = joints_of_legs(skeleton, database.contact_roles)
    needed = sorted({j for leg in joints for end in (leg[2], leg[3]) for j in skeleton.chain(int(end))})
    sample = np.unique(np.linspace(0, len(database) - 1, _SAMPLE).astype(np.int64))
    poses = database.poses[sample]
    positions, rotations = kinematics.forward(skeleton, poses.positions, poses.rotations)
    touching, points = contacts.touching_points(skeleton, database.contact_roles)
    touches = contacts.place_points(positions, rotations, touching, points)
    hinges = np.zeros((len(joints), 3), np.float32)
    heights = np.zeros((len(joints), 2), np.float32)
    for c, (upper, middle, end, _) in enumerate(joints):
        bend = np.cross(positions[:, middle] - positions[:, upper], positions[:, end] - positions[:, middle])
        axis = quat.rotate(quat.inv(rotations[:, upper]), bend).sum(axis=0)
        length = np.linalg.norm(axis)
        hinges[c] = axis / length if length > 0 else (1, 0, 0)
        height, contact = touches[:, c, 1], database.contacts[sample, c] != 0
        heights[c] = np.percentile(height[contact] if contact.any() else height, USUAL)
    return Legs(joints, points.astype(np.float32), hinges, heights, np.array(needed, np.int64))
