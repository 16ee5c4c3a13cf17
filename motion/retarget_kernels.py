"""Retargeting poses at run time, compiled; `motion.retarget_numpy` is the obvious twin.

Only joints that a source turns, and those above them, cost anything: whatever else hangs on them follows by
the hierarchy, since its local transform never changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from . import springs
from .foot_lock import SOFT_REACH, reach_for, update_contact
from .quat_scalar import cross, inv, mul, rotate

# Hips come down, so that planted feet stay in reach, and up again with this half-life, seconds; and by this
# share of a leg's length at most.
SINK_HALFLIFE, DEEPEST = 0.05, 0.15
FREE, ROOT, CARRIER = 0, 1, 2

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


class Tables(NamedTuple):
    """What a `motion.retarget.Plan` comes down to, as the kernel reads it; float64 but for indices.

    source_parents [Js], source_needed [..]: joints of the source whose world rotation is asked for, parents
    first; source_placed [Js]: whether its place is, too; hips, source_root: of the source. parents [Jt],
    needed [..]: joints of the target that turn, parents first; placed [Jt]: 1 where a joint's place in the
    world is asked for, 2 where its velocity is too; starts [Jt + 1], joints, weights [E], turns [E, 4]: what
    turns them; kinds [Jt]: whether a joint is placed in the world as the root or the carrier; pelvis,
    target_pelvis [3]; moves [2]: scale and lift. legs [C, 4], points, hinges [C, 3], heights [C, 2], lengths
    [C]: see `motion.foot_lock`.
    """

    source_parents: NDArray[np.int32]
    source_needed: NDArray[np.int64]
    source_placed: NDArray[np.int64]
    hips: int
    source_root: int
    parents: NDArray[np.int32]
    needed: NDArray[np.int64]
    placed: NDArray[np.int64]
    starts: NDArray[np.int32]
    joints: NDArray[np.int32]
    weights: NDArray[np.float64]
    turns: NDArray[np.float64]
    rest: NDArray[np.float64]
    kinds: NDArray[np.int64]
    carrier: int
    pelvis: NDArray[np.float64]
    target_pelvis: NDArray[np.float64]
    moves: NDArray[np.float64]
    legs: NDArray[np.int64]
    points: NDArray[np.float64]
    hinges: NDArray[np.float64]
    heights: NDArray[np.float64]
    lengths: NDArray[np.float64]


class Work(NamedTuple):
    """World transforms and rates of one character: of the source, of the target; where its feet belong."""

    source_pos: NDArray[np.float64]
    source_rot: NDArray[np.float64]
    source_vel: NDArray[np.float64]
    source_ang: NDArray[np.float64]
    pos: NDArray[np.float64]
    rot: NDArray[np.float64]
    vel: NDArray[np.float64]
    ang: NDArray[np.float64]
    places: NDArray[np.float64]


def work(source_joints: int, joints: int, legs: int) -> Work:
    """Room for one character."""
    shapes = [(count, width) for count in (source_joints, joints) for width in (3, 4, 3, 3)]
    return Work(*(np.zeros(shape) for shape in (*shapes, (legs, 3))))


@_jit
def step(t, w, feet, sinks, planting, contacts, settings, positions, rotations, velocities, angular,
         to_positions, to_rotations, to_velocities, to_angular):  # fmt: skip
    """Poses [N, Js] of the source become poses [N, Jt] of the target.

    t, w: `Tables` and `Work`; feet [N, C] records (`motion.foot_lock.FOOT`), sinks [N, 2] how far the hips
    have come down, and the rate: both are advanced where planting, by contacts [N, C]. The target's local
    transforms that never change must stand in the arrays written to.
    """
    for i in range(len(positions)):
        _source_world(t, w, positions[i], rotations[i], velocities[i], angular[i])
        _target_world(t, w, to_positions[i])
        _to_local(t, w, to_positions[i], to_rotations[i], to_velocities[i], to_angular[i])
        if planting:
            _plant(t, w, feet[i], sinks[i], contacts[i], settings, to_positions[i], to_rotations[i])


@_jit
def _source_world(t, w, positions, rotations, velocities, angular):
    for n in range(len(t.source_needed)):
        j = t.source_needed[n]
        p = t.source_parents[j]
        q = _quaternion(rotations, j)
        a = _vector(angular, j)
        if p >= 0:
            above = _quaternion(w.source_rot, p)
            turning = _vector(w.source_ang, p)
            q = mul(above, q)
            a = _sum(turning, rotate(above, a))
        _put4(w.source_rot, j, q)
        _put(w.source_ang, j, a)
        if t.source_placed[j]:
            x = _vector(positions, j)
            v = _vector(velocities, j)
            if p >= 0:
                above = _quaternion(w.source_rot, p)
                arm = rotate(above, x)
                x = _sum(_vector(w.source_pos, p), arm)
                spin = cross(_vector(w.source_ang, p), arm)
                v = _sum(_sum(_vector(w.source_vel, p), rotate(above, v)), spin)
            _put(w.source_pos, j, x)
            _put(w.source_vel, j, v)


@_jit
def _target_world(t, w, bones):
    scale, lift = t.moves[0], t.moves[1]
    for n in range(len(t.needed)):
        j = t.needed[n]
        p = t.parents[j]
        first, last = t.starts[j], t.starts[j + 1]
        if last == first:
            q = _quaternion(t.rest, j)
            a = (0.0, 0.0, 0.0)
            if p >= 0:
                q = mul(_quaternion(w.rot, p), q)
                a = _vector(w.ang, p)
        elif last == first + 1:
            s = t.joints[first]
            q = mul(_quaternion(w.source_rot, s), _quaternion(t.turns, first))
            a = _vector(w.source_ang, s)
        else:
            q, a = _mean(t, w, first, last)
        _put4(w.rot, j, q)
        _put(w.ang, j, a)
        if t.placed[j] == 0:
            continue
        kind = t.kinds[j]
        if kind == ROOT:
            s = t.source_root
            x, v = _scaled(_vector(w.source_pos, s), scale), _scaled(_vector(w.source_vel, s), scale)
        elif kind == CARRIER:
            s = t.hips
            arm = rotate(_quaternion(w.source_rot, s), _vector1(t.pelvis))
            x = _scaled(_sum(_vector(w.source_pos, s), arm), scale)
            v = _scaled(_sum(_vector(w.source_vel, s), cross(_vector(w.source_ang, s), arm)), scale)
            arm = rotate(q, _vector1(t.target_pelvis))
            x = _less((x[0], x[1] + lift, x[2]), arm)
            v = _less(v, cross(a, arm))
        else:
            x, v = _vector(bones, j), (0.0, 0.0, 0.0)
            if p >= 0:
                arm = rotate(_quaternion(w.rot, p), x)
                x = _sum(_vector(w.pos, p), arm)
                if t.placed[j] == 2:
                    v = _sum(_vector(w.vel, p), cross(_vector(w.ang, p), arm))
        _put(w.pos, j, x)
        _put(w.vel, j, v)


@_jit
def _mean(t, w, first, last):
    """Mean turn and angular velocity of several of the source's joints."""
    qw, qx, qy, qz = 0.0, 0.0, 0.0, 0.0
    ax, ay, az = 0.0, 0.0, 0.0
    for e in range(first, last):
        s = t.joints[e]
        q = mul(_quaternion(w.source_rot, s), _quaternion(t.turns, e))
        share = t.weights[e]
        spin = _vector(w.source_ang, s)
        ax, ay, az = ax + share * spin[0], ay + share * spin[1], az + share * spin[2]
        if qw * q[0] + qx * q[1] + qy * q[2] + qz * q[3] < 0:
            share = -share
        qw, qx, qy, qz = qw + share * q[0], qx + share * q[1], qy + share * q[2], qz + share * q[3]
    size = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    return (qw / size, qx / size, qy / size, qz / size), (ax, ay, az)


@_jit
def _to_local(t, w, positions, rotations, velocities, angular):
    for n in range(len(t.needed)):
        j = t.needed[n]
        p = t.parents[j]
        q, a = _quaternion(w.rot, j), _vector(w.ang, j)
        if p >= 0:
            back = inv(_quaternion(w.rot, p))
            q = mul(back, q)
            a = rotate(back, _less(a, _vector(w.ang, p)))
        _put4(rotations, j, q)
        _put(angular, j, a)
        if t.kinds[j] == FREE:
            continue
        x, v = _vector(w.pos, j), _vector(w.vel, j)
        if p >= 0:
            back = inv(_quaternion(w.rot, p))
            arm = _less(x, _vector(w.pos, p))
            x = rotate(back, arm)
            v = rotate(back, _less(_less(v, _vector(w.vel, p)), cross(_vector(w.ang, p), arm)))
        _put(positions, j, x)
        _put(velocities, j, v)


@_jit
def _plant(t, w, feet, sink, contacts, settings, positions, rotations):
    """Hold the feet in contact; the hips come down where a leg would have to stretch for that."""
    s = settings[0]
    wanted = 0.0
    for k in range(len(t.legs)):
        touch = _touch(t, w, k)
        place, _ = update_contact(feet[k], contacts[k] != 0, touch, t.heights[k, 0], t.heights[k, 1], s)
        _put(w.places, k, place)
        if feet[k].locked:
            wanted = max(wanted, _needed_sink(t, w, k, touch, place))
    sink[0], sink[1] = springs.damp(sink[0], sink[1], wanted, SINK_HALFLIFE, s.dt)
    down = max(sink[0], 0.0)
    above = t.parents[t.carrier]
    shift = (0.0, -down, 0.0)
    if above >= 0:
        shift = rotate(inv(_quaternion(w.rot, above)), shift)
    for a in range(3):
        positions[t.carrier, a] += shift[a]
    for n in range(len(t.needed)):
        if t.placed[t.needed[n]]:
            w.pos[t.needed[n], 1] -= down
    for k in range(len(t.legs)):
        touch, place = _touch(t, w, k), _vector(w.places, k)
        if abs(place[0] - touch[0]) + abs(place[1] - touch[1]) + abs(place[2] - touch[2]) > 1e-5:
            reach_for(place, touch, t.legs[k], t.hinges[k], t.parents, w.pos, w.rot, rotations)


@_jit
def _touch(t, w, k):
    """Where a leg's touching point is in the world."""
    j = t.legs[k, 3]
    return _sum(_vector(w.pos, j), rotate(_quaternion(w.rot, j), _vector(t.points, k)))


@_jit
def _needed_sink(t, w, k, touch, place):
    """How far the hips must come down for a leg to reach its place without stretching."""
    hip, ankle = _vector(w.pos, t.legs[k, 0]), _vector(w.pos, t.legs[k, 2])
    x, y, z = _less(_sum(place, _less(ankle, touch)), hip)
    now = _less(ankle, hip)
    limit = max((SOFT_REACH * t.lengths[k]) ** 2, now[0] * now[0] + now[1] * now[1] + now[2] * now[2])
    needed = -y - math.sqrt(max(limit - x * x - z * z, 0.0))
    return min(max(needed, 0.0), DEEPEST * t.lengths[k])


# Rows of arrays as tuples, and back.


@_jit
def _vector(array, j):
    return array[j, 0], array[j, 1], array[j, 2]


@_jit
def _vector1(array):
    return array[0], array[1], array[2]


@_jit
def _quaternion(array, j):
    return array[j, 0], array[j, 1], array[j, 2], array[j, 3]


@_jit
def _put(array, j, v):
    array[j, 0], array[j, 1], array[j, 2] = v[0], v[1], v[2]


@_jit
def _put4(array, j, q):
    array[j, 0], array[j, 1], array[j, 2], array[j, 3] = q[0], q[1], q[2], q[3]


@_jit
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@_jit
def _less(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@_jit
def _scaled(a, s):
    return a[0] * s, a[1] * s, a[2] * s
