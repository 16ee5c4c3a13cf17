"""What happens around the network in a frame, compiled; `lmm.pfnn.steps_numpy` is the obvious twin.

Arrays: see `lmm.locomotion.steps`, whose functions are used as they are where they do. into and out are where
blocks of inputs and outputs begin, in the order of `lmm.pfnn.layout.Layout`.
"""

from __future__ import annotations

import math

import numba

from motion.quat_scalar import exp

from ..locomotion.steps import (
    FUTURE,
    SAMPLES,
    bound,
    mean_height,
    move_joints,
    move_root,
    plan,
    put_pose,
    remember,
    sample_points,
)

__all__ = ["advance", "bound", "plan", "sample_points", "show", "write_heights"]

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


@_jit
def write_heights(characters, heights, into, x):
    """Write the ground's heights [N, 12, 3] to the inputs, over the root's: the mean along the middle."""
    for i in range(len(characters)):
        mean = mean_height(heights[i])
        characters[i].height = mean
        for k in range(SAMPLES):
            for side in range(3):
                x[i, into[5] + SAMPLES * side + k] = heights[i, k, side] - mean


@_jit
def show(characters, y, out, settings, parents, offsets, aims, contact_columns, joints, velocities,
         positions, rotations, local_velocities, local_angular, contacts, world_rotations,
         places):  # fmt: skip
    """Turn outputs y [N, O] into poses [N, J + 1, ..] and contacts [N, C]; joint 0 is the root, in the world.

    Joints are those put out mixed with the last frame's [N, J, 3] moved on; both are written back. parents
    [J + 1], offsets [J + 1, 3] and aims see `lmm.locomotion.steps.put_pose`; world_rotations [J, 4] and
    places [J, 3] are scratch.
    """
    s, count = settings[0], joints.shape[1]
    for i in range(len(characters)):
        c, row = characters[i], y[i]
        at, rates = row[out[6] : out[6] + 3 * count], row[out[7] : out[7] + 3 * count]
        move_joints(c, s, at, rates, joints[i], velocities[i])
        for j in range(count):
            r = out[8] + 3 * j
            q = exp((2 * row[r], 2 * row[r + 1], 2 * row[r + 2]))
            for a in range(4):
                world_rotations[j, a] = q[a]
        put_pose(
            i, c, 1 / s.dt, parents, offsets, aims, joints[i], world_rotations, places, positions, rotations,
            local_velocities, local_angular,
        )  # fmt: skip
        for k in range(len(contact_columns)):
            contacts[i, k] = row[out[3] + contact_columns[k]] > 0.5


@_jit
def advance(characters, past, head, y, out, settings, obstacles):
    """Move the roots, phases and trajectories of characters on to the next frame, by outputs y [N, O].

    The present becomes the past's newest frame, which is then at head.
    """
    s = settings[0]
    for i in range(len(characters)):
        c, row = characters[i], y[i]
        remember(c, past[i, head])
        going = move_root(c, s, row[out[0]], row[out[0] + 1], row[out[1]], obstacles)
        phase = c.phase + (0.9 * going + 0.1) * row[out[2]] * s.dt
        c.phase = phase - 2 * math.pi * math.floor(phase / (2 * math.pi))
        for k in range(FUTURE):
            for a in range(2):
                c.future[k, a] = row[out[4] + FUTURE * a + k]
                c.future[k, 2 + a] = row[out[5] + FUTURE * a + k]
