"""Feet on uneven ground, compiled; `mm.ground_kernels_numpy` is the obvious twin.

N characters, J joints, C feet. A foot is over two places: under what touches the ground and under the ankle.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from motion import springs
from motion.foot_lock import SOFT_REACH, reach_for
from motion.quat_scalar import inv, mul, normalize, rotate

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

# The ground under a place that moves is followed at once where it rises no faster than this, with a delay
# where it rises twice as fast (a step), and partly so in between.
STEEPEST, SLACK = 0.8, 0.3  # metres a metre, and m/s
# A step up that a foot will come to in this time (seconds), no further than this (metres), lifts it already.
LOOK, FURTHEST = 0.1, 0.4
BEND = 0.15  # metres a metre that a slope may grow steeper ahead without being a step
TILT = 0.6  # radians that the ground turns a foot by at most
# Shares of a leg's length: how much more or less than the body a foot is raised, how far the body sinks.
MOST_RAISE, MOST_DROP = 0.5, 0.3
STILL = 1e-5  # metres; less moves no leg

# The ground under one place of one character.
LEVEL = np.dtype(
    [
        ("at", np.float32, 2),
        ("value", np.float32),
        ("offset", np.float32),
        ("rate", np.float32),
        ("known", np.bool_),
    ],
    align=True,
)


@_jit
def locate(levels, dt, parents, needed, legs, points, positions, rotations, world_pos, world_rot, touches,
           places):  # fmt: skip
    """Find the feet: world transforms [N, J, ..] of needed joints, touches [N, C, 3], and where to ask.

    places [N, 1 + 4 C, 2] (x, z): the root; what touches and the ankle of every foot; what lies ahead of
    every foot, and half as far. legs [C, 4] and points [C, 3]: see `mm.feet.Legs`. levels [N, 1 + 3 C]
    records (`LEVEL`): of the root; of what touches and the ankle; of the step ahead.
    """
    feet = len(legs)
    for i in range(len(positions)):
        for n in range(len(needed)):
            j = needed[n]
            x = (positions[i, j, 0], positions[i, j, 1], positions[i, j, 2])
            q = (rotations[i, j, 0], rotations[i, j, 1], rotations[i, j, 2], rotations[i, j, 3])
            p = parents[j]
            if p >= 0:
                above = (world_rot[i, p, 0], world_rot[i, p, 1], world_rot[i, p, 2], world_rot[i, p, 3])
                x = rotate(above, x)
                x = (x[0] + world_pos[i, p, 0], x[1] + world_pos[i, p, 1], x[2] + world_pos[i, p, 2])
                q = mul(above, q)
            for a in range(3):
                world_pos[i, j, a] = x[a]
            for a in range(4):
                world_rot[i, j, a] = q[a]
        places[i, 0, 0], places[i, 0, 1] = world_pos[i, 0, 0], world_pos[i, 0, 2]
        for k in range(feet):
            j, ankle = legs[k, 3], legs[k, 2]
            tip = rotate(
                (world_rot[i, j, 0], world_rot[i, j, 1], world_rot[i, j, 2], world_rot[i, j, 3]),
                (points[k, 0], points[k, 1], points[k, 2]),
            )
            for a in range(3):
                touches[i, k, a] = world_pos[i, j, a] + tip[a]
            level = levels[i, 1 + 2 * k]
            ahead, length = (0.0, 0.0), 0.0
            if level.known:
                ahead = (
                    (touches[i, k, 0] - level.at[0]) * LOOK / dt,
                    (touches[i, k, 2] - level.at[1]) * LOOK / dt,
                )
                length = math.sqrt(ahead[0] ** 2 + ahead[1] ** 2)
            share = min(1.0, FURTHEST / length) if length > 0 else 0.0
            for a in range(2):
                places[i, 1 + 2 * k, a] = touches[i, k, 2 * a]
                places[i, 2 + 2 * k, a] = world_pos[i, ankle, 2 * a]
                places[i, 1 + 2 * feet + 2 * k, a] = touches[i, k, 2 * a] + share * ahead[a]
                places[i, 2 + 2 * feet + 2 * k, a] = touches[i, k, 2 * a] + share * ahead[a] / 2


@_jit
def track(level, x, z, value, halflife, dt):
    """The value at a place that has come to x, z, as far as it is followed at once."""
    offset, rate = springs.decay(level.offset, level.rate, halflife, dt)
    if level.known:
        travel = math.sqrt((x - level.at[0]) ** 2 + (z - level.at[1]) ** 2)
        most = STEEPEST * travel + SLACK * dt
        change = value - level.value
        kept = min(abs(change), max(2 * most - abs(change), 0.0))
        offset -= change - math.copysign(kept, change)
    level.at[0], level.at[1] = x, z
    level.value, level.offset, level.rate, level.known = value, offset, rate, True
    return value + offset


@_jit
def stand(levels, grounds, places, follow, halflife, dt, contacts, heights, parents, legs, hinges, under_root,
          touches, world_pos, world_rot, positions, rotations, raises):  # fmt: skip
    """Put feet on the ground; changes positions and rotations [N, J, ..] in place.

    grounds [N, 1 + 4 C] are its heights at places. With follow, poses are made for level ground at their
    root's height, and root, body and feet rise with the ground, over steps the root in twice the time that
    feet take. Else they are made for this ground, and what touches only comes to lie between heights [C, 2]
    above it, or higher where contacts [N, C] are 0. hinges [C, 3]: see `mm.feet.Legs`; under_root [..] are
    the root's children; raises [C, 2] is scratch.
    """
    feet = len(legs)
    for i in range(len(positions)):
        height = positions[i, 0, 1]
        root, body = height, 0.0
        if follow:
            root = track(levels[i, 0], places[i, 0, 0], places[i, 0, 1], grounds[i, 0], 2 * halflife, dt)
            body = (root - height) / (1 + feet)
        for k in range(feet):
            t, ahead = 1 + 2 * k, 1 + 2 * (feet + k)
            x, z = places[i, t, 0], places[i, t, 1]
            if follow:
                way = math.sqrt((places[i, ahead, 0] - x) ** 2 + (places[i, ahead, 1] - z) ** 2)
                near, far = grounds[i, ahead + 1] - grounds[i, t], grounds[i, ahead] - grounds[i, t]
                slope = max(min(near, far - near), 0.0)
                lift = max(max(near - slope, far - 2 * slope) - BEND * way, 0.0)
                lift = track(levels[i, 1 + 2 * feet + k], 0.0, 0.0, lift, halflife, dt)
                raises[k, 0] = track(levels[i, t], x, z, grounds[i, t], halflife, dt) + lift - height
                x, z = places[i, t + 1, 0], places[i, t + 1, 1]
                raises[k, 1] = track(levels[i, t + 1], x, z, grounds[i, t + 1], halflife, dt) + lift - height
                body += raises[k, 0] / (1 + feet)
            else:
                above = touches[i, k, 1] - grounds[i, t]
                wanted = max(above, heights[k, 0])
                if contacts[i, k] != 0:
                    wanted = min(wanted, heights[k, 1])
                raises[k, 0] = track(levels[i, t], x, z, wanted - above, halflife, dt)
                raises[k, 1] = raises[k, 0]
        drop = 0.0
        for k in range(feet):
            drop = max(drop, _drop(raises[k], body, legs[k], touches[i, k], world_pos[i]))
        up = body - drop
        _raise_body(i, up - (root - height), under_root, rotations, positions)
        positions[i, 0, 1] = root
        for k in range(feet):
            if abs(raises[k, 0] - up) + abs(raises[k, 1] - up) > STILL:
                _bend(i, up, raises[k], legs[k], hinges[k], parents, touches[i, k], world_pos[i],
                      world_rot[i], rotations)  # fmt: skip


@_jit
def _goal(raised, touch, ankle):
    """Where an ankle belongs, and the turn [w, x, y, z] of its foot: what touches comes straight up."""
    f = (touch[0] - ankle[0], touch[1] - ankle[1], touch[2] - ankle[2])
    flat = math.sqrt(f[0] * f[0] + f[2] * f[2])
    length = math.sqrt(flat * flat + f[1] * f[1])
    turn = (1.0, 0.0, 0.0, 0.0)
    if flat > 0.2 * length and raised[0] != raised[1]:
        sine = min(max((f[1] + raised[0] - raised[1]) / length, -0.95), 0.95)
        angle = min(max(math.asin(sine) - math.atan2(f[1], flat), -TILT), TILT)
        s = math.sin(angle / 2) / flat
        turn = (math.cos(angle / 2), -f[2] * s, 0.0, f[0] * s)
        f = rotate(turn, f)
    return (touch[0] - f[0], touch[1] + raised[0] - f[1], touch[2] - f[2]), turn


@_jit
def _distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@_jit
def _drop(raised, body, leg, touch, world_pos):
    """How far the body, raised already, has to sink for a leg to reach; keeps raised within bounds."""
    hip, knee, ankle = world_pos[leg[0]], world_pos[leg[1]], world_pos[leg[2]]
    whole = _distance(hip, knee) + _distance(knee, ankle)
    for a in range(2):
        raised[a] = min(max(raised[a], body - MOST_RAISE * whole), body + MOST_RAISE * whole)
    goal, _ = _goal(raised, touch, ankle)
    reach = max(SOFT_REACH * whole, _distance(hip, ankle))
    aside = (goal[0] - hip[0]) ** 2 + (goal[2] - hip[2]) ** 2
    deep = hip[1] + body - goal[1] - math.sqrt(max(reach * reach - aside, 0.0))
    return min(max(deep - STILL, 0.0), MOST_DROP * whole)


@_jit
def _raise_body(i, up, under_root, rotations, positions):
    """Move what hangs from the root by up, in the world."""
    back = inv((rotations[i, 0, 0], rotations[i, 0, 1], rotations[i, 0, 2], rotations[i, 0, 3]))
    move = rotate(back, (0.0, up, 0.0))
    for n in range(len(under_root)):
        for a in range(3):
            positions[i, under_root[n], a] += move[a]


@_jit
def _bend(i, up, raised, leg, hinge, parents, touch, world_pos, world_rot, rotations):
    """Bend a leg, whose hip is raised by up, so that its foot comes to its goal, and turn the foot."""
    goal, turn = _goal(raised, touch, world_pos[leg[2]])
    for a in range(3):
        world_pos[leg[a], 1] += up
    ankle = world_pos[leg[2]]
    reach_for(goal, (ankle[0], ankle[1], ankle[2]), leg, hinge, parents, world_pos, world_rot, rotations[i])
    foot = leg[2]
    was = (world_rot[foot, 0], world_rot[foot, 1], world_rot[foot, 2], world_rot[foot, 3])
    now = (rotations[i, foot, 0], rotations[i, foot, 1], rotations[i, foot, 2], rotations[i, foot, 3])
    q = normalize(mul(now, mul(inv(was), mul(turn, was))))
    for a in range(4):
        rotations[i, foot, a] = q[a]
