"""Which frames to keep, so that those between them are interpolated within a stated error.

From each frame that is kept the next one is as far as can be without anything of a frame between being
farther than that from where it was, in the root's space: all joints, and what turns with them within a hand's
length, since hands and heads have no joints that would show how they turn. What is measured is what is
decoded: the rows as stored, interpolated as `mm.codecs.kernels` does it.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from motion import kinematics
from motion.errors import UserError
from motion.plain import plain
from motion.quat_scalar import inv, mul, rotate

from ..database import Database
from . import kernels
from .tables import Tables

REACH = 0.1  # metres from a joint to what turns with it
MOST = 255  # frames from one that is kept to the next
ROUNDING = 1e-6  # metres, of forward kinematics here and elsewhere

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


def choose(database: Database, rows: Tables, error_cm: float) -> NDArray[np.int32]:
    """The frames to keep of rows of all frames. What rounding alone puts farther off is a UserError."""
    truth = in_root_space(database)
    limit = error_cm / 100 - ROUNDING
    keep = np.zeros(len(database), np.bool_)
    ranges = plain(database.starts), plain(database.stops)
    worst = _select(rows, *ranges, *truth, database.skeleton.parents, limit * limit, keep)
    if worst > limit * limit:
        raise UserError(
            f"key frames within {error_cm:g} cm: rounding alone is {100 * worst**0.5:.3g} cm off",
            remedy="allow a larger error, or quantise to more bits",
        )
    return np.flatnonzero(keep).astype(np.int32)


def in_root_space(database: Database) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Positions [T, J, 3] and rotations [T, J, 4] of the joints, seen from the ground root."""
    positions, rotations = (np.array(a) for a in (database.poses.positions, database.poses.rotations))
    positions[:, 0], rotations[:, 0] = 0, [1, 0, 0, 0]
    return kinematics.forward(database.skeleton, positions, rotations)


@_jit
def _off(positions, rotations, parents, truth, turned_truth, world_positions, world_rotations):
    """How far, squared, what is within reach of the joints of a pose [J] is at the most from where it was.

    truth [J, 3] and turned_truth [J, 4] are the joints' in the root's space.
    """
    worst = 0.0
    world_positions[0], world_rotations[0] = 0, 0
    world_rotations[0, 0] = 1
    for j in range(1, len(parents)):
        p = parents[j]
        turned = world_rotations[p, 0], world_rotations[p, 1], world_rotations[p, 2], world_rotations[p, 3]
        local = rotations[j, 0], rotations[j, 1], rotations[j, 2], rotations[j, 3]
        x, y, z = rotate(turned, (positions[j, 0], positions[j, 1], positions[j, 2]))
        world_positions[j, 0] = world_positions[p, 0] + x
        world_positions[j, 1] = world_positions[p, 1] + y
        world_positions[j, 2] = world_positions[p, 2] + z
        (
            world_rotations[j, 0],
            world_rotations[j, 1],
            world_rotations[j, 2],
            world_rotations[j, 3],
        ) = mul(turned, local)
        square = 0.0
        for c in range(3):
            square += (world_positions[j, c] - truth[j, c]) ** 2
        was = turned_truth[j, 0], turned_truth[j, 1], turned_truth[j, 2], turned_truth[j, 3]
        now = world_rotations[j, 0], world_rotations[j, 1], world_rotations[j, 2], world_rotations[j, 3]
        _, x, y, z = mul(now, inv(was))
        reached = math.sqrt(square) + 2 * REACH * math.sqrt(x * x + y * y + z * z)
        worst = max(worst, reached * reached)
    return worst


@_jit
def _select(rows, starts, stops, truth, turned, parents, limit, keep):
    """Mark the frames to keep [T]; returns the largest squared distance of those, or one above the limit."""
    joints, worst = len(parents), 0.0
    first_p, first_q = np.zeros((joints, 3), np.float32), np.zeros((joints, 4), np.float32)
    last_p, last_q, between_p, between_q = first_p.copy(), first_q.copy(), first_p.copy(), first_q.copy()
    world_p, world_q = np.zeros((joints, 3)), np.zeros((joints, 4))
    for r in range(len(starts)):
        first = starts[r]
        kernels.row(first, rows, first_p, first_q)
        keep[first] = True
        worst = max(worst, _off(first_p, first_q, parents, truth[first], turned[first], world_p, world_q))
        while first < stops[r] - 1:
            last = first + 1
            while last + 1 < stops[r] and last + 1 - first <= MOST:
                kernels.row(last + 1, rows, last_p, last_q)
                within = (
                    _off(last_p, last_q, parents, truth[last + 1], turned[last + 1], world_p, world_q)
                    <= limit
                )
                # From the middle outwards would be no quicker: it is the last frames that tend to fail.
                frame = last
                while within and frame > first:
                    between_p[:], between_q[:] = first_p, first_q
                    share = np.float32(frame - first) / np.float32(last + 1 - first)
                    kernels.blend(share, between_p, between_q, last_p, last_q)
                    within = (
                        _off(between_p, between_q, parents, truth[frame], turned[frame], world_p, world_q)
                        <= limit
                    )
                    frame -= 1
                if not within:
                    break
                last += 1
            first = last
            kernels.row(first, rows, first_p, first_q)
            keep[first] = True
            worst = max(worst, _off(first_p, first_q, parents, truth[first], turned[first], world_p, world_q))
            if worst > limit:
                return worst
    return worst
