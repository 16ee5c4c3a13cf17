"""The unit of a file's lengths: applied, and guessed from the size of the body."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from . import kinematics, quat, roles
from .clip import Clip
from .skeleton import Skeleton

UNITS = {
    "metre": 1.0,
    "centimetre": 0.01,
    "millimetre": 0.001,
    "inch": 0.0254,
    "foot": 0.3048,
    "inch / 0.45": 0.0254 / 0.45,  # the CMU mocap library, and what was made from its ASF files
}
_RARITY = {
    "millimetre": 0.5,
    "inch": 0.3,
    "foot": 0.3,
    "inch / 0.45": 0.15,
}  # how much better these must fit, in log size
_METRIC = ("metre", "centimetre", "millimetre")

LEG, QUADRUPED_LEG = 0.84, 0.35  # metres from up_leg over leg to foot
HEIGHT, QUADRUPED_LENGTH = 1.7, 1.0  # metres, the largest extent of a body
_TAIL = re.compile(r"(^|[^a-z])tail|Tail|TAIL")


def to_metres(clip: Clip, unit_to_m: float) -> Clip:
    """The clip with a file unit of unit_to_m metres, which it remembers; a clip's present unit is undone."""
    skeleton, factor = clip.skeleton, unit_to_m / clip.unit_to_m
    if factor == 1:
        return clip
    ends = {j: end * factor for j, end in skeleton.end_sites.items()}
    return clip.replace(
        skeleton=Skeleton(skeleton.names, skeleton.parents, skeleton.offsets * factor, skeleton.roles, ends),
        positions=clip.positions * factor,
        unit_to_m=unit_to_m,
    )


def guess(skeleton: Skeleton, positions: NDArray[np.float64] | None = None) -> float:
    """Metres per unit of a skeleton's lengths, the likeliest of `UNITS`.

    The length of the legs (the body's extent, if no leg is found) is compared with a person's, or with a
    dog's if the body has a tail or arms as long as its legs; animals vary so much that only metric units are
    considered for them.

    positions [J, 3] are local positions in some frame, to use in place of the skeleton's offsets, which may
    be stale where position channels replace them. A skeleton without size gets metres.
    """
    local = skeleton.offsets if positions is None else positions
    found = skeleton.roles or roles.guess(skeleton)
    leg = _limb(local, skeleton, found, ("up_leg", "leg", "foot"))
    arm = _limb(local, skeleton, found, ("arm", "forearm", "hand"))
    animal = any(_TAIL.search(name) for name in skeleton.names) or arm > 0.95 * leg > 0
    if leg > 0:
        size, expected = leg, QUADRUPED_LEG if animal else LEG
    else:
        size, expected = _extent(local, skeleton), QUADRUPED_LENGTH if animal else HEIGHT
    if not (size > 0 and math.isfinite(size)):
        return 1.0
    names = _METRIC if animal else tuple(UNITS)
    return UNITS[
        min(names, key=lambda name: abs(math.log(size * UNITS[name] / expected)) + _RARITY.get(name, 0))
    ]


def _limb(
    local: NDArray[np.float64], skeleton: Skeleton, found: Mapping[str, int], parts: tuple[str, ...]
) -> float:
    """Length along the bones from the first part to the last, of the longer side; 0 if there is none."""
    lengths = [0.0]
    for side in ("left", "right"):
        joints = [found.get(f"{side}_{part}", -1) for part in parts]
        if min(joints) < 0:
            continue
        try:
            below = skeleton.chain(joints[-1], joints[0])[1:]
        except ValueError:
            continue
        lengths.append(float(np.linalg.norm(local[below], axis=-1).sum()))
    return max(lengths)


def _extent(local: NDArray[np.float64], skeleton: Skeleton) -> float:
    """The longest side of the box around the body with all joints unturned."""
    local = np.array(local)
    local[0] = 0
    placed, _ = kinematics.forward(skeleton, local, quat.identity(len(skeleton)))
    return float(np.ptp(placed, axis=0).max())
