"""A database of a large rig: the same motion with more joints, as rigs of productions have them."""

from __future__ import annotations

from dataclasses import replace

from motion import rig
from motion.pose import Poses
from motion.skeleton import Skeleton

from .database import Database

JOINTS = rig.JOINTS + 1  # the rig's, and the ground root


def enlarged(database: Database, joints: int = JOINTS) -> Database:
    """The database with fingers, face and helper joints (`motion.rig.enlarge`), so many joints in all, the
    ground root among them.

    What is added is fixed to its parent, since nobody captured how it moves; all else, features too, stays.
    A frame takes 52 bytes a joint of memory. Fewer joints than there are is a UserError.
    """
    skeleton = rig.enlarge(database.skeleton, joints)
    own = [skeleton.index(name) for name in database.skeleton.names]
    poses = Poses.empty(len(database), len(skeleton))
    poses.positions[:] = skeleton.offsets
    for mine, its in zip(poses.arrays().values(), database.poses.arrays().values(), strict=True):
        mine[:, own] = its
    return replace(database, skeleton=skeleton, poses=poses, fingerprint="")


def shared(skeleton: Skeleton, larger: Skeleton) -> list[int]:
    """Which joints of a larger skeleton are those of a skeleton, by name, without the ground root."""
    return [larger.index(name) for name in skeleton.names[1:]]
