"""Feet that stay where they stand: locks on contacts and two-bone inverse kinematics, compiled.

`motion.foot_lock_numpy` is the obvious twin of every function here.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from . import springs
from .quat_scalar import between, cross, dot, inv, mul, normalize, rotate

# Shares of a leg's length from which reaching further is damped, and that it never exceeds.
SOFT_REACH, FULL_REACH = 0.95, 0.998
# A foot in contact slower than this (m/s), and nearer than this (m) to the data's, may lock in mid-contact.
RESTING_SPEED, RESTING_OFFSET = 0.3, 0.02

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

# One foot of one character.
FOOT = np.dtype(
    [
        ("target", np.float32, 3),
        ("point", np.float32, 3),
        ("offset", np.float32, 3),
        ("offset_rate", np.float32, 3),
        ("contact", np.bool_),
        ("locked", np.bool_),
    ],
    align=True,
)


@_jit
def lock_feet(feet, contacts, settings, parents, needed, legs, points, hinges, heights, positions,
              rotations, world_pos, world_rot):  # fmt: skip
    """Hold feet in contact where they are, by two-bone inverse kinematics; changes rotations in place.

    feet [N, C] records (`FOOT`), contacts [N, C]; needed [..] joints whose world transform is
    asked for, parents first; legs [C, 4]: up_leg, leg, foot and the joint that touches the ground; points
    [C, 3]: where in that joint's frame it touches; hinges
    [C, 3]: the knee's axis in the up_leg's frame; heights [C, 2]: lowest and highest of a locked joint;
    world_pos [J, 3], world_rot [J, 4] to work in.
    """
    s = settings[0]
    for i in range(len(feet)):
        for n in range(len(needed)):
            j = needed[n]
            x = (positions[i, j, 0], positions[i, j, 1], positions[i, j, 2])
            q = (rotations[i, j, 0], rotations[i, j, 1], rotations[i, j, 2], rotations[i, j, 3])
            p = parents[j]
            if p >= 0:
                parent = (world_rot[p, 0], world_rot[p, 1], world_rot[p, 2], world_rot[p, 3])
                x = rotate(parent, x)
                x = (x[0] + world_pos[p, 0], x[1] + world_pos[p, 1], x[2] + world_pos[p, 2])
                q = mul(parent, q)
            for a in range(3):
                world_pos[j, a] = x[a]
            for a in range(4):
                world_rot[j, a] = q[a]
        for k in range(len(legs)):
            j = legs[k, 3]
            tip = rotate(
                (world_rot[j, 0], world_rot[j, 1], world_rot[j, 2], world_rot[j, 3]),
                (points[k, 0], points[k, 1], points[k, 2]),
            )
            touch = (world_pos[j, 0] + tip[0], world_pos[j, 1] + tip[1], world_pos[j, 2] + tip[2])
            place, wanted = update_contact(
                feet[i, k], contacts[i, k] != 0, touch, heights[k, 0], heights[k, 1], s
            )
            if wanted:
                reach_for(place, touch, legs[k], hinges[k], parents, world_pos, world_rot, rotations[i])


@_jit
def update_contact(foot, contact, target, low, high, s):
    """Advance one foot's lock. Returns where the touching joint belongs, and whether that differs.

    A foot locks where it is when contact begins, at a height between low and high; and again in mid-contact
    when it has come to rest after a lock was given up.
    """
    dt = s.dt
    fresh = math.isnan(foot.target[0])
    far, fast, off = 0.0, 0.0, 0.0
    for a in range(3):
        far += (foot.point[a] - target[a]) ** 2
        fast += ((target[a] - foot.target[a]) / dt) ** 2
        off += foot.offset[a] ** 2
    rested = contact and not foot.locked and fast < RESTING_SPEED**2 and off < RESTING_OFFSET**2
    lock_now = (contact and not foot.contact) or rested
    unlock = foot.locked and ((not contact) or far > s.unlock_radius * s.unlock_radius)
    x, y, z = 0.0, 0.0, 0.0
    for a in range(3):
        rate = 0.0 if fresh else (target[a] - foot.target[a]) / dt
        base = foot.point[a] if foot.locked else target[a]
        foot.offset[a], foot.offset_rate[a] = springs.decay(
            foot.offset[a], foot.offset_rate[a], s.foot_halflife, dt
        )
        place = base + foot.offset[a]
        speed = foot.offset_rate[a] if foot.locked else rate + foot.offset_rate[a]
        if lock_now:
            foot.point[a] = min(max(place, low), high) if a == 1 else place
            foot.offset[a], foot.offset_rate[a] = place - foot.point[a], speed
        elif unlock:
            foot.offset[a], foot.offset_rate[a] = place - target[a], speed - rate
        foot.target[a] = target[a]
        if a == 0:
            x = place
        elif a == 1:
            y = place
        else:
            z = place
    foot.locked = lock_now or (foot.locked and not unlock)
    foot.contact = contact
    # A lock presses no foot lower than the ground, or than the data has it.
    y = max(y, min(low, target[1]))
    moved = abs(x - target[0]) + abs(y - target[1]) + abs(z - target[2])
    return (x, y, z), moved > 1e-4


@_jit
def reach_for(place, touch, leg, hinge, parents, world_pos, world_rot, rotations):
    """Bend a leg so that what touches comes from touch to place; the foot keeps its rotation in the world."""
    hip = (world_pos[leg[0], 0], world_pos[leg[0], 1], world_pos[leg[0], 2])
    knee = (world_pos[leg[1], 0], world_pos[leg[1], 1], world_pos[leg[1], 2])
    ankle = (world_pos[leg[2], 0], world_pos[leg[2], 1], world_pos[leg[2], 2])
    goal = (place[0] + ankle[0] - touch[0], place[1] + ankle[1] - touch[1], place[2] + ankle[2] - touch[2])
    thigh = (knee[0] - hip[0], knee[1] - hip[1], knee[2] - hip[2])
    shin = (ankle[0] - knee[0], ankle[1] - knee[1], ankle[2] - knee[2])
    reach = (goal[0] - hip[0], goal[1] - hip[1], goal[2] - hip[2])
    a, b = math.sqrt(dot(thigh, thigh)), math.sqrt(dot(shin, shin))
    # Towards full length the leg gives in softly: a knee never snaps straight. Where the data itself has it
    # straighter than that, it may stay so.
    now = (thigh[0] + shin[0], thigh[1] + shin[1], thigh[2] + shin[2])
    distance = math.sqrt(dot(reach, reach))
    length = math.sqrt(dot(now, now))
    soft, most = max(SOFT_REACH * (a + b), length), max(FULL_REACH * (a + b), length + 1e-4)
    if distance > soft:
        distance = soft + (most - soft) * (1 - math.exp(-(distance - soft) / (most - soft)))
    distance = min(max(distance, abs(a - b) + 1e-3), (a + b) * (1 - 1e-6))
    cosine = dot(thigh, shin) / (a * b)
    bend = math.acos(min(max(cosine, -1.0), 1.0))
    wanted = math.pi - math.acos(min(max((a * a + b * b - distance * distance) / (2 * a * b), -1.0), 1.0))
    up_rot = (world_rot[leg[0], 0], world_rot[leg[0], 1], world_rot[leg[0], 2], world_rot[leg[0], 3])
    axis = rotate(up_rot, (hinge[0], hinge[1], hinge[2]))
    # The knee's own plane where it is bent enough to have one, else the hinge known from the data.
    plane = cross(thigh, shin)
    if dot(plane, axis) > 0.2 * a * b:
        size = math.sqrt(dot(plane, plane))
        axis = (plane[0] / size, plane[1] / size, plane[2] / size)
    else:
        bend = math.atan2(dot(plane, axis), dot(thigh, shin))  # below 0 where the knee is overstretched
    half = (wanted - bend) / 2
    sine = math.sin(half)
    knee_turn = (math.cos(half), sine * axis[0], sine * axis[1], sine * axis[2])
    bent = rotate(knee_turn, shin)
    hip_turn = between((thigh[0] + bent[0], thigh[1] + bent[1], thigh[2] + bent[2]), reach)
    _set_world(leg[0], hip_turn, parents, (1.0, 0.0, 0.0, 0.0), world_rot, rotations)
    _set_world(leg[1], knee_turn, parents, (1.0, 0.0, 0.0, 0.0), world_rot, rotations)
    _set_world(leg[2], (1.0, 0.0, 0.0, 0.0), parents, mul(hip_turn, knee_turn), world_rot, rotations)


@_jit
def _set_world(joint, turn_joint, parents, turn_parent, world_rot, rotations):
    """Local rotation of a joint whose world rotation and whose parent's are turned."""
    p = parents[joint]
    parent = mul(turn_parent, (world_rot[p, 0], world_rot[p, 1], world_rot[p, 2], world_rot[p, 3]))
    own = mul(
        turn_joint, (world_rot[joint, 0], world_rot[joint, 1], world_rot[joint, 2], world_rot[joint, 3])
    )
    q = normalize(mul(inv(parent), own))
    for a in range(4):
        rotations[joint, a] = q[a]
