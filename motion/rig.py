"""A game's rig around a skeleton: fingers, face, twist and corrective joints, IK targets, muscles.

Rigs of productions have some two hundred joints, of which animation moves thirty. This makes one of any size,
always the same, to drive by retargeting: to test with and to measure on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .errors import UserError
from .roles import SIDES
from .skeleton import Skeleton, sort_topologically
from .subset import leg_length

JOINTS = 191  # of the rig that the thesis in REFERENCE drove
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
# Parts of a face: name, place to the left, up and ahead of the head's joint in metres, and how many in a row.
_FACE = (
    ("Jaw", 0.0, 0.02, 0.05, 1),
    ("Tongue", 0.0, 0.01, 0.07, 4),
    ("Nose", 0.0, 0.07, 0.11, 2),
    ("LipUpper", 0.0, 0.04, 0.10, 1),
    ("LipLower", 0.0, 0.02, 0.10, 1),
)
_FACE_SIDES = (
    ("Eye", 0.03, 0.09, 0.08, 1),
    ("EyelidUpper", 0.03, 0.10, 0.09, 3),
    ("EyelidLower", 0.03, 0.08, 0.09, 3),
    ("Brow", 0.03, 0.12, 0.09, 4),
    ("Cheek", 0.05, 0.06, 0.08, 3),
    ("LipUpper", 0.02, 0.04, 0.10, 3),
    ("LipLower", 0.02, 0.02, 0.10, 3),
    ("Nostril", 0.01, 0.06, 0.10, 1),
    ("Ear", 0.08, 0.08, 0.0, 2),
)
_LIMBS = ("arm", "forearm", "up_leg", "leg")
_UP, _AHEAD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def enlarge(skeleton: Skeleton, joints: int = JOINTS) -> Skeleton:
    """The skeleton with more joints, in all as many as asked for.

    Its own joints keep names, places and roles; of those added none plays a role. The order of joints is that
    of a file, depth first. A skeleton that has more already is a UserError.
    """
    if joints < len(skeleton):
        raise UserError(
            f"a rig of {joints} joints from a skeleton of {len(skeleton)}",
            remedy=f"ask for {len(skeleton)} or more",
        )
    names, parents = list(skeleton.names), skeleton.parents.tolist()
    offsets = [*skeleton.offsets]
    for name, parent, offset in _additions(skeleton):
        if len(names) == joints:
            break
        if name not in names:
            names.append(name)
            parents.append(names.index(parent))
            offsets.append(offset)
    order = sort_topologically(parents)
    place = {int(j): i for i, j in enumerate(order)}
    ends = {place[j]: end for j, end in skeleton.end_sites.items() if j not in parents[len(skeleton) :]}
    return Skeleton(
        tuple(names[j] for j in order),
        np.array([place.get(parents[j], -1) for j in order], np.int32),
        np.array([offsets[j] for j in order]),
        {role: place[j] for role, j in skeleton.roles.items()},
        ends,
    )


def _additions(skeleton: Skeleton) -> Iterator[tuple[str, str, NDArray[np.float64]]]:
    """Joints to add, the most usual first and without end: name, parent's name, offset."""
    roles, names, offsets = skeleton.roles, skeleton.names, skeleton.offsets
    size = leg_length(skeleton, offsets) / 0.85
    for side in SIDES:
        hand = roles.get(f"{side}_hand")
        if hand is None or _is_tip(skeleton, hand):
            continue
        along = _direction(offsets[hand])
        spread = _across(along, _AHEAD)
        for i, finger in enumerate(_FINGERS):
            parent = names[hand]
            for k in range(1, 4):
                name = f"{names[hand]}{finger}{k}"
                first = 0.08 * along + (0.04 - 0.02 * i) * spread
                yield name, parent, size * (first if k == 1 else 0.03 * along)
                parent = name
    head = roles.get("head", roles.get("neck"))
    if head is not None:
        up = _direction(offsets[head])
        ahead = _across(up, _AHEAD)
        axes = np.stack([np.cross(up, ahead), up, ahead], axis=-1)
        yield from _row(names[head], names[head], _FACE, size * axes, "")
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            mirrored = size * axes * np.array([sign, 1.0, 1.0])
            yield from _row(names[head], names[head], _FACE_SIDES, mirrored, side.title())
    for count in (1, 2):
        for role in (f"{side}_{part}" for part in _LIMBS for side in SIDES):
            joint, below = roles.get(role), _next(skeleton, role)
            if joint is not None and below is not None:
                yield f"{names[joint]}Twist{count}", names[joint], offsets[below] * count / 3
                side_step = _across(_direction(offsets[below]), _AHEAD)
                yield (
                    f"{names[joint]}Corrective{count}",
                    names[joint],
                    size * 0.04 * side_step * (3 - 2 * count),
                )
    for role in (f"{side}_{part}" for part in ("hand", "foot", "forearm", "leg") for side in SIDES):
        joint = roles.get(role)
        if joint is not None and not _is_tip(skeleton, joint):
            pole = role.endswith("leg") - role.endswith("forearm")  # knees point ahead, elbows back
            ahead = _across(_direction(offsets[joint]), _AHEAD)
            yield f"{names[joint]}Ik{'Pole' if pole else 'Target'}", names[joint], size * 0.3 * pole * ahead
    row = 1
    while True:
        for j in (j for j in sorted(set(roles.values())) if not _is_tip(skeleton, j)):
            angle = 2.4 * row  # the golden angle: rows do not cover each other
            around = np.array([np.cos(angle), 0.0, np.sin(angle)])
            yield f"{names[j]}Muscle{row}", names[j], size * 0.05 * around
        row += 1


def _row(
    parent: str, prefix: str, parts: tuple, axes: NDArray[np.float64], side: str
) -> Iterator[tuple[str, str, NDArray[np.float64]]]:
    for part, left, up, ahead, count in parts:
        for k in range(1, count + 1):
            step = np.array([0.012 * (k - 1) if side else 0.0, 0.0, 0.0 if side else 0.012 * (k - 1)])
            name = f"{side}{prefix}{part}{k}"
            yield name, parent, axes @ (np.array([left, up, ahead]) + step)


def _next(skeleton: Skeleton, role: str) -> int | None:
    """The joint at the far end of the bone that a limb's role names."""
    side, _, part = role.partition("_")
    lower = {"arm": "forearm", "forearm": "hand", "up_leg": "leg", "leg": "foot"}[part]
    joint, end = skeleton.roles.get(role), skeleton.roles.get(f"{side}_{lower}")
    if joint is None or end is None:
        return None
    return skeleton.chain(end, joint)[1]


def _is_tip(skeleton: Skeleton, joint: int) -> bool:
    """Whether a joint ends a limb at its end site, which touches the ground: joints there would hide it."""
    end = skeleton.end_sites.get(joint, np.zeros(3))
    return not np.any(skeleton.parents == joint) and float(np.linalg.norm(end)) > 1e-6


def _direction(v: NDArray[np.float64]) -> NDArray[np.float64]:
    size = float(np.linalg.norm(v))
    return v / size if size > 1e-6 else _UP


def _across(along: NDArray[np.float64], towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """The unit direction perpendicular to one, as near as possible to another."""
    side = towards - along * (along @ towards)
    return _direction(side) if np.linalg.norm(side) > 0.1 else _direction(_UP - along * (along @ _UP))
