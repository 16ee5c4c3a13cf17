"""The obvious twin of `mm.ground_kernels`: the same over all characters, for the tests to compare."""

from __future__ import annotations

import numpy as np

from motion import quat, springs
from motion.foot_lock import SOFT_REACH
from motion.foot_lock_numpy import reach_for

from .ground_kernels import BEND, FURTHEST, LOOK, MOST_DROP, MOST_RAISE, SLACK, STEEPEST, STILL, TILT


def locate(levels, dt, parents, needed, legs, points, positions, rotations, world_pos, world_rot, touches,
           places):  # fmt: skip
    """See `mm.ground_kernels.locate`."""
    world_pos[:, 0], world_rot[:, 0] = positions[:, 0], rotations[:, 0]
    for j in needed[1:]:
        p = parents[j]
        world_pos[:, j] = world_pos[:, p] + quat.rotate(world_rot[:, p], positions[:, j])
        world_rot[:, j] = quat.mul(world_rot[:, p], rotations[:, j])
    touches[:] = world_pos[:, legs[:, 3]] + quat.rotate(world_rot[:, legs[:, 3]], points)
    known = levels["known"][:, 1 : 1 + 2 * len(legs) : 2, None]
    under = touches[:, :, [0, 2]]
    ahead = np.where(known, (under - levels["at"][:, 1 : 1 + 2 * len(legs) : 2]) * LOOK / dt, 0)
    length = np.linalg.norm(ahead, axis=-1, keepdims=True)
    ahead = ahead * np.minimum(1, FURTHEST / np.where(length > 0, length, 1))
    feet = len(legs)
    places[:, 0] = world_pos[:, 0, [0, 2]]
    places[:, 1 : 1 + 2 * feet : 2] = under
    places[:, 2 : 2 + 2 * feet : 2] = world_pos[:, legs[:, 2]][..., [0, 2]]
    places[:, 1 + 2 * feet :: 2], places[:, 2 + 2 * feet :: 2] = under + ahead, under + ahead / 2


def track(levels, at, values, halflife, dt):
    """Values of places `at` [N, 2] as far as they are followed at once."""
    offset, rate = springs.decay(levels["offset"], levels["rate"], halflife, dt)
    most = STEEPEST * np.linalg.norm(at - levels["at"], axis=-1) + SLACK * dt
    change = values - levels["value"]
    kept = np.minimum(np.abs(change), np.maximum(2 * most - np.abs(change), 0))
    offset = offset - np.where(levels["known"], change - np.copysign(kept, change), 0)
    levels["at"], levels["value"], levels["offset"], levels["rate"] = at, values, offset, rate
    levels["known"] = True
    return values + offset


def stand(levels, grounds, places, follow, halflife, dt, contacts, heights, parents, legs, hinges, under_root,
          touches, world_pos, world_rot, positions, rotations, raises):  # fmt: skip
    """See `mm.ground_kernels.stand`."""
    feet, height = len(legs), positions[:, 0, 1].copy()
    raised = np.zeros((len(positions), feet, 2))
    root, body = height, np.zeros(len(positions))
    if follow:
        root = track(levels[:, 0], places[:, 0], grounds[:, 0], 2 * halflife, dt)
        for k in range(feet):
            t, ahead = 1 + 2 * k, 1 + 2 * (feet + k)
            way = np.linalg.norm(places[:, ahead] - places[:, t], axis=-1)
            near, far = grounds[:, ahead + 1] - grounds[:, t], grounds[:, ahead] - grounds[:, t]
            slope = np.maximum(np.minimum(near, far - near), 0)
            lift = np.maximum(np.maximum(near - slope, far - 2 * slope) - BEND * way, 0)
            lift = track(levels[:, 1 + 2 * feet + k], np.zeros((len(lift), 2)), lift, halflife, dt)
            for a in range(2):
                level = track(levels[:, t + a], places[:, t + a], grounds[:, t + a], halflife, dt)
                raised[:, k, a] = level + lift - height
        body = (root - height + raised[:, :, 0].sum(axis=1)) / (1 + feet)
    else:
        for k in range(feet):
            above = touches[:, k, 1] - grounds[:, 1 + 2 * k]
            wanted = np.maximum(above, heights[k, 0])
            wanted = np.where(contacts[:, k] != 0, np.minimum(wanted, heights[k, 1]), wanted)
            level = track(levels[:, 1 + 2 * k], places[:, 1 + 2 * k], wanted - above, halflife, dt)
            raised[:, k] = level[:, None]
    drop = np.zeros(len(positions))
    for k, leg in enumerate(legs):
        hip, knee, ankle = (world_pos[:, j].astype(np.float64) for j in leg[:3])
        whole = np.linalg.norm(hip - knee, axis=-1) + np.linalg.norm(knee - ankle, axis=-1)
        bound = MOST_RAISE * whole[:, None]
        raised[:, k] = np.clip(raised[:, k], body[:, None] - bound, body[:, None] + bound)
        goal, _ = _goal(raised[:, k], touches[:, k], ankle)
        reach = np.maximum(SOFT_REACH * whole, np.linalg.norm(hip - ankle, axis=-1))
        aside = np.sum((goal - hip)[:, [0, 2]] ** 2, axis=-1)
        deep = hip[:, 1] + body - goal[:, 1] - np.sqrt(np.maximum(reach * reach - aside, 0))
        drop = np.maximum(drop, np.clip(deep - STILL, 0, MOST_DROP * whole))
    up = body - drop
    move = np.zeros((len(positions), 3))
    move[:, 1] = up - (root - height)
    positions[:, under_root] += quat.rotate(quat.inv(rotations[:, 0]), move)[:, None]
    positions[:, 0, 1] = root
    for k, leg in enumerate(legs):
        foot = leg[2]
        goal, turn = _goal(raised[:, k], touches[:, k], world_pos[:, foot].astype(np.float64))
        lifted, bent = world_pos.copy(), rotations.copy()
        lifted[:, leg[:3], 1] += up[:, None]
        reach_for(goal, lifted[:, foot], leg, hinges[k], parents, lifted, world_rot, bent)
        was = world_rot[:, foot]
        turned = quat.mul(bent[:, foot], quat.mul(quat.inv(was), quat.mul(turn, was)))
        bent[:, foot] = quat.normalize(turned)
        moved = np.abs(raised[:, k] - up[:, None]).sum(axis=-1) > STILL
        rotations[moved] = bent[moved]


def _goal(raised, touch, ankle):
    f = touch - ankle
    flat, length = np.linalg.norm(f[:, [0, 2]], axis=-1), np.linalg.norm(f, axis=-1)
    tilts = (flat > 0.2 * length) & (raised[:, 0] != raised[:, 1])
    sine = (f[:, 1] + raised[:, 0] - raised[:, 1]) / np.where(length > 0, length, 1)
    angle = np.arcsin(np.clip(sine, -0.95, 0.95)) - np.arctan2(f[:, 1], flat)
    angle = np.where(tilts, np.clip(angle, -TILT, TILT), 0)
    axis = np.stack([-f[:, 2], 0 * flat, f[:, 0]], axis=-1) / np.where(flat > 0, flat, 1)[:, None]
    turn = quat.from_axis_angle(axis, angle)
    f = quat.rotate(turn, f)
    goal = touch - f
    goal[:, 1] += raised[:, 0]
    return goal, turn
