"""Bones that keep their length, laid so that limbs end where a network puts hands and feet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion.skeleton import Skeleton

LIMBS = ("up_leg", "leg", "foot"), ("arm", "forearm", "hand")  # roles of each side
LONG = 0.1  # metres; the direction of a shorter bone is told better by rotations than by its joints
ALIGNED = np.cos(np.deg2rad(30))  # bones that part further leave their joint's rotation to the network


def aims(skeleton: Skeleton) -> NDArray[np.int64]:
    """What each joint [J] is turned for [J, 2]: the end of its bone, and what it and the next bone reach
    for together, as thighs and shins do for feet; -1 for none.

    A bone ends at the furthest child that is not near; there is none where others that are not near lie
    another way, as hips do of a pelvis. Limbs are known by their roles.
    """
    lengths = np.linalg.norm(skeleton.offsets, axis=-1)
    found = np.full((len(skeleton), 2), -1, np.int64)
    for joint in range(1, len(skeleton)):
        ends = np.flatnonzero((skeleton.parents == joint) & (lengths >= LONG))
        ways = skeleton.offsets[ends] / lengths[ends, None]
        if len(ends) and (ways @ ways.T).min() > ALIGNED:
            found[joint, 0] = ends[lengths[ends].argmax()]
    for side in ("left", "right"):
        for limb in LIMBS:
            upper, middle, last = (skeleton.roles.get(f"{side}_{role}", -1) for role in limb)
            while last >= 0 and skeleton.parents[last] != middle:  # a wrist may lie before the hand
                last = int(skeleton.parents[last])
            if min(upper, middle, last) >= 0 and skeleton.parents[middle] == upper:
                found[upper], found[middle, 0] = (middle, last), last
    return found
