"""Where heels and toes rest on the ground: contacts by name, from world transforms.

A part rests while it is slow and hardly rises. Slow is meant against its own swings, since feet slide where
motion was fitted to another body; how much they slide shows in the same spell, which narrows it again.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from motion import contacts as touching
from motion import kinematics, quat
from motion.roles import SIDES
from motion.skeleton import Skeleton

Array = NDArray[np.floating]

# A foot at this share of the speed of the swings around it is about to rest or to leave: it passes through
# there within a few hundredths of a second. At least and at most so fast, in m/s: standing people tremble,
# and what is faster slides.
SHARE, SLOWEST, FASTEST = 0.12, 0.08, 0.7
SLOW = touching.SPEED  # m/s: faster than that nothing rests in clean captures (REFERENCE 2.6)
SWING = 0.6  # seconds to each side in which a swing is looked for: half a slow stride
NOISE = 2.0  # what slides moves at most so many times as fast as the median of its spell
RISE = 0.015  # metres that a part rises while it is still slow: then it has left
WINDOW = 0.05  # seconds of the median filter
BRIEF, GAP = 0.06, 0.1  # seconds: a stance lasts longer, and so does a swing (sprinters: 0.09, 0.3)
# Ground is flat where nine in ten resting places lie so close above the lowest ones. There nothing rests so
# far above where it usually does; where that varies more, no more than so many median deviations.
FLAT, LIFTED, SPREAD = 0.06, 0.1, 5.0  # metres, metres, times
# What rests so much lower at the same place within so many seconds was hovering before it was put down.
HOVER, PLACE, SOON = 0.02, 0.03, 0.6  # metres, metres, seconds
HEEL_BEHIND = 0.4  # how far the heel lies behind the ankle, beside how far the toe joint lies before it
SHORT = 0.03  # metres: a foot whose tip is nearer has no toe to tell apart
STILLEST = 10  # per cent of the frames, the slowest, at which a foot is taken to lie flat


def parts(skeleton: Skeleton, positions: Array) -> tuple[str, ...]:
    """What of a skeleton touches the ground, left before right: heels and toes, else feet; hands too.

    positions [T, J, 3] are world positions of some frames: hands count for a body on all fours. A skeleton
    without feet is a UserError.
    """
    roles = touching.contact_roles(skeleton, positions)
    hands = tuple(role for role in roles if role.endswith("hand"))
    if roles[0].endswith("toe") and "left_foot" in skeleton.roles and "right_foot" in skeleton.roles:
        return ("left_heel", "left_toe", "right_heel", "right_toe", *hands)
    if roles[0].endswith("foot") and not hands and all(_tip(skeleton, side) > SHORT for side in SIDES):
        return ("left_heel", "left_toe", "right_heel", "right_toe")
    return roles


def find(
    skeleton: Skeleton, fps: float, positions: Array, rotations: Array
) -> tuple[tuple[str, ...], NDArray[np.uint8]]:
    """Names of what touches the ground (`parts`), and whether each does, uint8 [T, C].

    positions [T, J, 3], metres, and rotations [T, J, 4] are world transforms; T may be any length.
    """
    names = parts(skeleton, positions[:: max(1, len(positions) // 200)])
    places = points(skeleton, fps, positions, rotations, names)
    return names, resting(places, fps)


def points(skeleton: Skeleton, fps: float, positions: Array, rotations: Array, names: Sequence[str]) -> Array:
    """World positions [T, C, 3] of what touches the ground; heels lie behind the ankle, as low as toes."""
    out = np.empty((len(positions), len(names), 3))
    for c, name in enumerate(names):
        side, part = name.split("_")
        role = f"{side}_foot" if part == "toe" and name not in skeleton.roles else name
        if part != "heel":
            joints, tips = touching.touching_points(skeleton, [role])
            out[:, c] = touching.place_points(positions, rotations, joints, tips)[:, 0]
    for c, name in enumerate(names):
        if name.endswith("heel"):
            foot = skeleton.role(f"{name.split('_')[0]}_foot")
            toe = out[:, names.index(name.replace("heel", "toe"))]
            ankle, turn = positions[:, foot], rotations[:, foot]
            speed = sum(np.linalg.norm(kinematics.velocities(place, fps), axis=-1) for place in (ankle, toe))
            arm = heel(ankle, turn, toe, np.asarray(speed))
            out[:, c] = ankle + quat.rotate(turn, np.broadcast_to(arm, ankle.shape))
    return out


def heel(ankle: Array, rotation: Array, toe: Array, speed: Array) -> Array:
    """Where a heel lies in its foot [3], the ankle's frame, as low as the toe: seen where the foot lies flat.

    Of an ankle and a toe [T, 3] in the world, the ankle's rotation [T, 4], the sum of both speeds [T], m/s.
    """
    flat = speed <= max(SLOW, float(np.percentile(speed, STILLEST)))
    arm = (toe - ankle)[flat] * np.array([-HEEL_BEHIND, 1.0, -HEEL_BEHIND])
    return np.median(quat.rotate(quat.inv(rotation[flat]), arm), axis=0)


def resting(places: Array, fps: float) -> NDArray[np.uint8]:
    """Whether points [T, C, 3] (world, metres) rest, uint8 [T, C]."""
    if len(places) == 0:
        return np.zeros(places.shape[:2], np.uint8)
    speeds = np.linalg.norm(kinematics.velocities(places, fps), axis=-1)
    around = 2 * round(SWING * fps) + 1
    swing = ndimage.maximum_filter1d(speeds, around, axis=0, mode="nearest")
    limit = np.clip(SHARE * swing, SLOWEST, FASTEST)
    slow = speeds < limit
    limit = np.minimum(limit, SLOW)
    out = np.zeros_like(slow)
    for c in range(places.shape[1]):
        for start, stop in spans(slow[:, c]):
            spell = slice(start, stop), c
            height, speed = places[*spell, 1], speeds[spell]
            still = speed < np.maximum(limit[spell], NOISE * np.median(speed))
            out[spell] = still & (height < np.percentile(height, 10) + RISE)
    out = touching.median(out, max(1, round(WINDOW * fps)))
    for c in range(places.shape[1]):
        _drop_hovering(out[:, c], places[:, c], fps)
        clean(out[:, c], fps)
    _drop_lifted(out, places[..., 1])
    return out.astype(np.uint8)


def clean(flags: NDArray[np.bool_], fps: float) -> None:
    """Close gaps in flags [T] too short for a swing, then drop spells too short for a stance; in place.

    What reaches an end of the clip may be a part of something longer, and stays.
    """
    for value, shortest in ((False, GAP), (True, BRIEF)):
        for start, stop in spans(flags == value):
            if start > 0 and stop < len(flags) and stop - start < shortest * fps:
                flags[start:stop] = not value


def feet(names: Sequence[str], contacts: NDArray[Any], fps: float) -> NDArray[np.bool_]:
    """Whether the left and the right foot stand, bool [T, 2]: any part of each does; breaks are no swings.

    contacts [T, C] are of the parts named. Hands do not count.
    """
    out = np.zeros((len(contacts), 2), bool)
    for i, side in enumerate(SIDES):
        own = [c for c, name in enumerate(names) if name.startswith(side) and not name.endswith("hand")]
        out[:, i] = np.any(np.asarray(contacts)[:, own] != 0, axis=1)
        clean(out[:, i], fps)
    return out


def spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of true flags [T]: first frame and one past the last of each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _tip(skeleton: Skeleton, side: str) -> float:
    """Distance from an ankle to what its foot touches with, metres."""
    (_, points) = touching.touching_points(skeleton, [f"{side}_foot"])
    return float(np.linalg.norm(points[0]))


def _drop_hovering(resting: NDArray[np.bool_], places: Array, fps: float) -> None:
    """A spell [T] of places [T, 3] that ends in being put down, to rest for longer, is none; in place."""
    found = spans(resting)
    middles = [np.median(places[start:stop], axis=0) for start, stop in found]
    for (first, second), (one, other) in zip(
        itertools.pairwise(found), itertools.pairwise(middles), strict=True
    ):
        moved = other - one
        apart = second[0] - first[1] > SOON * fps or np.hypot(moved[0], moved[2]) > PLACE
        if not apart and -moved[1] > HOVER and first[1] - first[0] < second[1] - second[0]:
            resting[slice(*first)] = False


def _drop_lifted(resting: NDArray[np.bool_], heights: Array) -> None:
    """On flat ground, what is held still above where it rests at other times does not rest; in place."""
    columns = [heights[on, c] for c in range(resting.shape[1]) if (on := resting[:, c]).any()]
    above = [column - np.percentile(column, 5) for column in columns]
    if not columns or np.percentile(np.concatenate(above), 90) > FLAT:
        return
    for c in range(resting.shape[1]):
        if resting[:, c].any():
            found = heights[resting[:, c], c]
            usual = float(np.median(found))
            spread = float(np.median(np.abs(found - usual)))
            resting[:, c] &= heights[:, c] < usual + max(LIFTED, SPREAD * spread)
