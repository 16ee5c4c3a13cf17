"""Feet that stand still: a whole clip's touching points held where they rest, by two-bone inverse kinematics.

A foot in contact stays at one place of the ground, to which it blends from its free path before and after
with the path's own velocity. Where a leg would have to stretch for that, the hips come down a little,
smoothly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import contacts, foot_lock_numpy, kinematics, quat
from .foot_lock import SOFT_REACH
from .skeleton import Skeleton

Array = NDArray[np.floating]

BLEND = 0.15  # seconds in which a foot comes to its place, and leaves it
SINK = 0.12  # seconds before and after a stretched leg in which the hips come down and up again
DEEPEST = 0.15  # share of a leg's length by which hips come down at most
CLIMB = 0.05  # share of a leg's length from which a resting foot stands on something, not on the ground


@dataclass(frozen=True, eq=False, repr=False)
class Limbs:
    """C limbs that touch the ground.

    Attributes
    ----------
    joints : int64 [C, 4], upper joint, middle joint, end joint, and the joint that touches the ground.
    points : [C, 3], what touches, in that joint's frame (`motion.contacts.touching_points`).
    hinges : [C, 3], the middle joint's axis in the upper joint's frame, unit; a positive turn bends.
    """

    joints: NDArray[np.int64]
    points: Array
    hinges: Array


def plant(
    skeleton: Skeleton,
    fps: float,
    positions: Array,
    rotations: Array,
    *,
    limbs: Limbs,
    carrier: int,
    resting: NDArray[np.bool_],
    heights: Array,
    floor: Array,
) -> None:
    """Plant feet, in place.

    Parameters
    ----------
    positions, rotations : [T, J, ..] local transforms.
    carrier : the joint that moves hips and upper body.
    resting : bool [T, C], which limbs are on the ground.
    heights : [T, C], height of the touching points over the ground by the source, where 0 is on it; metres.
    floor : [C], height of a touching point on the ground.
    """
    if not resting.any():
        return
    world_pos, world_rot = kinematics.forward(skeleton, positions, rotations)
    free = contacts.place_points(world_pos, world_rot, limbs.joints[:, 3].tolist(), limbs.points)
    legs = _lengths(world_pos, limbs)
    place = np.stack(
        [
            _held(free[:, c], resting[:, c], heights[:, c], floor[c], CLIMB * legs[c], fps)
            for c in range(len(floor))
        ],
        axis=1,
    )
    place[..., 1] = np.maximum(place[..., 1], floor + np.minimum(heights, 0))
    sink = _sink(world_pos, free, place, resting, limbs, legs, fps)
    down = np.stack([0 * sink, -sink, 0 * sink], axis=-1)
    above = skeleton.parents[carrier]
    positions[:, carrier] += down if above < 0 else quat.rotate(quat.inv(world_rot[:, above]), down)
    world_pos, free = world_pos + down[:, None], free + down[:, None]
    for c, limb in enumerate(limbs.joints):
        moved = np.abs(place[:, c] - free[:, c]).sum(axis=-1) > 1e-6
        bent = rotations[moved]
        foot_lock_numpy.reach_for(
            place[moved, c],
            free[moved, c],
            limb,
            limbs.hinges[c],
            skeleton.parents,
            world_pos[moved],
            world_rot[moved],
            bent,
        )
        rotations[moved] = bent


def _held(
    free: Array, resting: NDArray[np.bool_], heights: Array, floor: float, climb: float, fps: float
) -> Array:
    """Where a point [T, 3] goes that stays in place while it rests, and blends from and to its free path."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], resting, [False]]).astype(np.int8)))
    spans = edges.reshape(-1, 2)
    out = free.copy()
    rate = np.gradient(free, 1 / fps, axis=0) if len(free) > 1 else np.zeros_like(free)
    blend = max(1, round(BLEND * fps))
    for i, (start, stop) in enumerate(spans):
        place = np.median(free[start:stop], axis=0)
        height = float(np.median(heights[start:stop]))
        place[1] = floor + (height if abs(height) > climb else 0.0)
        out[start:stop] = place
        before = 0 if i == 0 else int(spans[i - 1][1])
        after = len(free) if i + 1 == len(spans) else int(spans[i + 1][0])
        # Halfway to the next rest at the latest, so that two blends do not meet.
        lead = min(blend, (start - before) // (1 if i == 0 else 2))
        tail = min(blend, (after - stop) // (1 if i + 1 == len(spans) else 2))
        for length, edge, way in ((lead, start, -1), (tail, stop - 1, 1)):
            frames = edge + way * np.arange(1, length + 1)
            share = np.arange(1, length + 1) / (length + 1)
            out[frames] += _fade(place - free[edge], -rate[edge] * way * (length + 1) / fps, share)
    return out


def _fade(offset: Array, slope: Array, share: Array) -> Array:
    """Cubic from an offset with a slope (per unit of share) at 0 to rest at zero at 1; [S, 3]."""
    s = share[:, None]
    return (2 * s**3 - 3 * s**2 + 1) * offset + (s**3 - 2 * s**2 + s) * slope


def _lengths(world_pos: Array, limbs: Limbs) -> Array:
    """Full length of each limb [C], metres."""
    bones = np.diff(world_pos[:, limbs.joints[:, :3]], axis=2)
    return np.linalg.norm(bones, axis=-1).sum(axis=-1).max(axis=0)


def _sink(
    world_pos: Array,
    free: Array,
    place: Array,
    resting: NDArray[np.bool_],
    limbs: Limbs,
    legs: Array,
    fps: float,
) -> Array:
    """How far the hips come down [T], so that no resting limb is out of reach."""
    upper, end = world_pos[:, limbs.joints[:, 0]], world_pos[:, limbs.joints[:, 2]]
    goal = place + end - free - upper
    limit = np.maximum(SOFT_REACH * legs, np.linalg.norm(end - upper, axis=-1))
    level = np.sum(goal[..., [0, 2]] ** 2, axis=-1)
    needed = -goal[..., 1] - np.sqrt(np.maximum(limit**2 - level, 0))
    needed = np.clip(np.where(resting, needed, 0), 0, DEEPEST * legs).max(axis=-1)
    if not needed.any():
        return needed
    half = max(1, round(SINK * fps))
    widest = np.lib.stride_tricks.sliding_window_view(np.pad(needed, 2 * half), 2 * half + 1).max(axis=-1)
    window = np.hanning(2 * half + 3)[1:-1]
    return np.convolve(widest, window / window.sum(), "valid")
