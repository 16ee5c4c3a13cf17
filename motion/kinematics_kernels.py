"""Compiled twins of the loops in `motion.kinematics`; frames [T], joints [J], float32 or float64.

They release the interpreter's lock, so that threads which build databases run side by side.
"""

from __future__ import annotations

import numba

from . import quat_scalar as q


@numba.njit(inline="always", cache=True)
def _q(array, t, j):
    return array[t, j, 0], array[t, j, 1], array[t, j, 2], array[t, j, 3]


@numba.njit(inline="always", cache=True)
def _v(array, t, j):
    return array[t, j, 0], array[t, j, 1], array[t, j, 2]


@numba.njit(cache=True, nogil=True)
def forward(parents, positions, rotations, world_pos, world_rot):
    """World transforms into world_pos [T, J, 3] and world_rot [T, J, 4]; parents before children."""
    for t in range(positions.shape[0]):
        for j in range(parents.shape[0]):
            x, r, p = _v(positions, t, j), _q(rotations, t, j), parents[j]
            if p >= 0:
                pr, px = _q(world_rot, t, p), _v(world_pos, t, p)
                a = q.rotate(pr, x)
                x = (px[0] + a[0], px[1] + a[1], px[2] + a[2])
                r = q.mul(pr, r)
            for i in range(3):
                world_pos[t, j, i] = x[i]
            for i in range(4):
                world_rot[t, j, i] = r[i]


@numba.njit(cache=True, nogil=True)
def forward_velocities(
    parents, positions, rotations, velocities, angular, world_pos, world_rot, world_vel, world_ang
):
    """World transforms and their rates, see `motion.kinematics.forward_velocities`."""
    for t in range(positions.shape[0]):
        for j in range(parents.shape[0]):
            x, r, p = _v(positions, t, j), _q(rotations, t, j), parents[j]
            v, w = _v(velocities, t, j), _v(angular, t, j)
            if p >= 0:
                pr, px = _q(world_rot, t, p), _v(world_pos, t, p)
                pv, pw = _v(world_vel, t, p), _v(world_ang, t, p)
                arm, v, w = q.rotate(pr, x), q.rotate(pr, v), q.rotate(pr, w)
                c = q.cross(pw, arm)
                x = (px[0] + arm[0], px[1] + arm[1], px[2] + arm[2])
                v = (pv[0] + v[0] + c[0], pv[1] + v[1] + c[1], pv[2] + v[2] + c[2])
                w = (pw[0] + w[0], pw[1] + w[1], pw[2] + w[2])
                r = q.mul(pr, r)
            for i in range(3):
                world_pos[t, j, i] = x[i]
                world_vel[t, j, i] = v[i]
                world_ang[t, j, i] = w[i]
            for i in range(4):
                world_rot[t, j, i] = r[i]


@numba.njit(cache=True, nogil=True)
def local(parents, world_pos, world_rot, positions, rotations):
    """Local transforms into positions [T, J, 3] and rotations [T, J, 4]."""
    for t in range(positions.shape[0]):
        for j in range(parents.shape[0]):
            x, r, p = _v(world_pos, t, j), _q(world_rot, t, j), parents[j]
            if p >= 0:
                back, px = q.inv(_q(world_rot, t, p)), _v(world_pos, t, p)
                x = q.rotate(back, (x[0] - px[0], x[1] - px[1], x[2] - px[2]))
                r = q.mul(back, r)
            for i in range(3):
                positions[t, j, i] = x[i]
            for i in range(4):
                rotations[t, j, i] = r[i]


@numba.njit(cache=True, nogil=True)
def rotation_steps(rotations, steps):
    """Scaled angle axis from each frame's rotation to the next, into steps [T-1, J, 3]."""
    for t in range(steps.shape[0]):
        for j in range(steps.shape[1]):
            v = q.log_shortest(q.mul(_q(rotations, t + 1, j), q.inv(_q(rotations, t, j))))
            for i in range(3):
                steps[t, j, i] = v[i]


@numba.njit(cache=True, nogil=True)
def unroll(rotations):
    """Choose signs in place so that each joint's consecutive quaternions lie on one hemisphere."""
    for t in range(1, rotations.shape[0]):
        for j in range(rotations.shape[1]):
            dot = 0.0
            for i in range(4):
                dot += rotations[t, j, i] * rotations[t - 1, j, i]
            if dot < 0:
                for i in range(4):
                    rotations[t, j, i] = -rotations[t, j, i]


@numba.njit(cache=True, nogil=True)
def slerp_frames(rotations, before, share, out):
    """out[k, j] = slerp from frame before[k] to the next by share[k], on the short side."""
    last = rotations.shape[0] - 1
    for k in range(out.shape[0]):
        t, s = before[k], share[k]
        n = min(t + 1, last)
        for j in range(out.shape[1]):
            a = _q(rotations, t, j)
            if s > 0:
                step = q.log_shortest(q.mul(q.inv(a), _q(rotations, n, j)))
                a = q.mul(a, q.exp((s * step[0], s * step[1], s * step[2])))
            for i in range(4):
                out[k, j, i] = a[i]
