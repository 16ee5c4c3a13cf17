"""What happens around the network in a frame, compiled; `lmm.mann.steps_numpy` is the obvious twin.

Arrays: see `lmm.locomotion.steps`. into begins with the blocks named there, then come going, speeds and
rotations; out is root_velocity, turn_rate, contacts, path, facing, going, positions, rotations, velocities. A
past frame holds the velocity and the speed wanted behind what any has, a character's future the velocities.
"""

from __future__ import annotations

import math

import numba

from mm.kernels import turn
from motion.quat_scalar import cross, normalize, rotate

from ..kernels import rotation
from ..locomotion.steps import (
    FUTURE,
    SAMPLES,
    bound,
    mean_height,
    move_joints,
    move_root,
    put_pose,
    remember,
    sample_points,
)
from ..locomotion.steps import plan as plan_way

__all__ = ["advance", "bound", "plan", "sample_points", "show", "stand"]

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

FORWARD, UP = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
VELOCITY, SPEED = 10, 12  # columns of a past frame


@_jit
def plan(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, shares, joints,
         velocities, rotations, into, x):  # fmt: skip
    """Take commands in, blend the future with them, and write the inputs [N, I].

    shares [5] is what the velocity asked for counts in the future, by sample; rotations [N, J, 6] are the
    last frame's. All else, and what is returned: see `lmm.locomotion.steps.plan`.
    """
    wrong = plan_way(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, joints,
                     velocities, into, x)  # fmt: skip
    if wrong >= 0:
        return wrong
    size = past.shape[1]
    spacing = size // FUTURE
    for i in range(len(characters)):
        c, row, going, speeds = characters[i], x[i], into[5], into[6]
        for k in range(FUTURE):
            frame = past[i, (head - ((FUTURE - k) * spacing - 1)) % size]
            vx, vz = turn(frame[VELOCITY], frame[VELOCITY + 1], -c.root[2])
            row[going + k], row[going + SAMPLES + k], row[speeds + k] = vx, vz, frame[SPEED]
        vx, vz = turn(c.velocity[0], c.velocity[1], -c.root[2])
        row[going + FUTURE], row[going + SAMPLES + FUTURE] = vx, vz
        asked_x, asked_z = turn(c.target_velocity[0], c.target_velocity[1], -c.root[2])
        for k in range(1, FUTURE):
            vx, vz = turn(asked_x, asked_z, turn_rate[i] * settings[0].dt * spacing * k)
            share, at = shares[k - 1], going + FUTURE + k
            row[at] = c.future[k, 4] + share * (vx - c.future[k, 4])
            row[at + SAMPLES] = c.future[k, 5] + share * (vz - c.future[k, 5])
        for k in range(FUTURE, SAMPLES):
            row[speeds + k] = _wanted(c)
        for j in range(rotations.shape[1]):
            for a in range(6):
                row[into[7] + 6 * j + a] = rotations[i, j, a]
    return -1


@_jit
def _wanted(c):
    """The speed asked for, as far as taken in."""
    return math.sqrt(c.target_velocity[0] ** 2 + c.target_velocity[1] ** 2)


@_jit
def stand(characters, heights):
    """Put roots on the ground's heights [N, 12, 3] along the trajectory: the mean along the middle."""
    for i in range(len(characters)):
        characters[i].height = mean_height(heights[i])


@_jit
def show(characters, y, out, settings, parents, offsets, aims, contact_columns, joints, velocities, axes,
         positions, rotations, local_velocities, local_angular, contacts, world_rotations,
         places):  # fmt: skip
    """Turn outputs y [N, O] into poses [N, J + 1, ..] and contacts [N, C]; joint 0 is the root, in the world.

    Joints are those put out mixed with the last frame's [N, J, 3] moved on. Joints, velocities and axes
    [N, J, 6], rotations as vectors forward and up, made whole, are written back. parents [J + 1], offsets
    [J + 1, 3] and aims see `lmm.locomotion.steps.put_pose`; world_rotations [J, 4] and
    places [J, 3] are scratch.
    """
    s, count = settings[0], joints.shape[1]
    for i in range(len(characters)):
        c, row = characters[i], y[i]
        at, rates = row[out[6] : out[6] + 3 * count], row[out[8] : out[8] + 3 * count]
        move_joints(c, s, at, rates, joints[i], velocities[i])
        for j in range(count):
            r = out[7] + 6 * j
            forward, up = (row[r], row[r + 1], row[r + 2]), (row[r + 3], row[r + 4], row[r + 5])
            left = cross(up, forward)
            up = cross(forward, left)
            q = normalize(rotation(left[0], left[1], left[2], up[0], up[1], up[2]))
            forward, up = rotate(q, FORWARD), rotate(q, UP)
            for a in range(4):
                world_rotations[j, a] = q[a]
            for a in range(3):
                axes[i, j, a], axes[i, j, 3 + a] = forward[a], up[a]
        put_pose(
            i, c, 1 / s.dt, parents, offsets, aims, joints[i], world_rotations, places, positions, rotations,
            local_velocities, local_angular,
        )  # fmt: skip
        for k in range(len(contact_columns)):
            contacts[i, k] = row[out[2] + contact_columns[k]] > 0.5


@_jit
def advance(characters, past, head, y, out, settings, obstacles):
    """Move the roots and trajectories of characters on to the next frame, by outputs y [N, O].

    The present becomes the past's newest frame, which is then at head.
    """
    s = settings[0]
    for i in range(len(characters)):
        c, row, frame = characters[i], y[i], past[i, head]
        remember(c, frame)
        frame[VELOCITY], frame[VELOCITY + 1], frame[SPEED] = c.velocity[0], c.velocity[1], _wanted(c)
        move_root(c, s, row[out[0]], row[out[0] + 1], row[out[1]], obstacles)
        for k in range(FUTURE):
            for a in range(2):
                for block in range(3):
                    c.future[k, 2 * block + a] = row[out[3 + block] + FUTURE * a + k]
