"""The obvious twin of `motion.foot_lock`: the same over all characters, for the tests to compare."""

from __future__ import annotations

import numpy as np

from . import quat, springs
from .foot_lock import FULL_REACH, RESTING_OFFSET, RESTING_SPEED, SOFT_REACH


def lock_feet(feet, contacts, settings, parents, needed, legs, points, hinges, heights, positions,
              rotations, *_):  # fmt: skip
    """See `motion.foot_lock.lock_feet`."""
    s = settings[0]
    world_pos, world_rot = positions.copy(), rotations.copy()
    for j in needed[1:]:
        p = parents[j]
        world_pos[:, j] = world_pos[:, p] + quat.rotate(world_rot[:, p], positions[:, j])
        world_rot[:, j] = quat.mul(world_rot[:, p], rotations[:, j])
    for k, leg in enumerate(legs):
        target = world_pos[:, leg[3]] + quat.rotate(world_rot[:, leg[3]], points[k])
        place = update_contact(feet[:, k], contacts[:, k] != 0, target, heights[k], s)
        wanted = np.abs(place - target).sum(axis=-1) > 1e-4
        bent = rotations.copy()
        reach_for(place, target, leg, hinges[k], parents, world_pos, world_rot, bent)
        rotations[wanted] = bent[wanted]


def update_contact(foot, contact, target, heights, s):
    dt = s["dt"]
    fresh = np.isnan(foot["target"][:, :1])
    with np.errstate(invalid="ignore"):
        rate = np.where(fresh, 0, (target - foot["target"]) / dt)
    far = np.sum((foot["point"] - target) ** 2, axis=-1) > s["unlock_radius"] ** 2
    with np.errstate(invalid="ignore"):
        slow = np.linalg.norm((target - foot["target"]) / dt, axis=-1) < RESTING_SPEED
    near = np.linalg.norm(foot["offset"], axis=-1) < RESTING_OFFSET
    lock_now = (contact & ~foot["contact"]) | (contact & ~foot["locked"] & slow & near)
    unlock = foot["locked"] & (~contact | far)
    locked = foot["locked"][:, None]
    offset, offset_rate = springs.decay(foot["offset"], foot["offset_rate"], s["foot_halflife"], dt)
    place = np.where(locked, foot["point"], target) + offset
    speed = np.where(locked, offset_rate, rate + offset_rate)
    point = place.copy()
    point[:, 1] = np.clip(point[:, 1], *heights)
    now, off = lock_now[:, None], unlock[:, None]
    foot["point"] = np.where(now, point, foot["point"])
    foot["offset"] = np.where(now, place - point, np.where(off, place - target, offset))
    foot["offset_rate"] = np.where(now, speed, np.where(off, speed - rate, offset_rate))
    foot["target"], foot["contact"] = target, contact
    foot["locked"] = lock_now | (foot["locked"] & ~unlock)
    place[:, 1] = np.maximum(place[:, 1], np.minimum(heights[0], target[:, 1]))
    return place


def reach_for(place, touch, leg, hinge, parents, world_pos, world_rot, rotations):
    hip, knee, ankle = (world_pos[:, j].astype(np.float64) for j in leg[:3])
    goal = place + ankle - touch
    thigh, shin, reach = knee - hip, ankle - knee, goal - hip
    a, b = np.linalg.norm(thigh, axis=-1), np.linalg.norm(shin, axis=-1)
    distance, length = np.linalg.norm(reach, axis=-1), np.linalg.norm(thigh + shin, axis=-1)
    soft, most = np.maximum(SOFT_REACH * (a + b), length), np.maximum(FULL_REACH * (a + b), length + 1e-4)
    damped = soft + (most - soft) * (1 - np.exp(-np.maximum(distance - soft, 0) / (most - soft)))
    distance = np.where(distance > soft, damped, distance)
    distance = np.clip(distance, np.abs(a - b) + 1e-3, (a + b) * (1 - 1e-6))
    bend = np.arccos(np.clip(np.sum(thigh * shin, axis=-1) / (a * b), -1, 1))
    wanted = np.pi - np.arccos(np.clip((a * a + b * b - distance * distance) / (2 * a * b), -1, 1))
    axis = quat.rotate(world_rot[:, leg[0]].astype(np.float64), hinge[None].astype(np.float64))
    plane = np.cross(thigh, shin)
    planar = (np.sum(plane * axis, axis=-1) > 0.2 * a * b)[:, None]
    turned = np.arctan2(np.sum(plane * axis, axis=-1), np.sum(thigh * shin, axis=-1))
    bend = np.where(planar[:, 0], bend, turned)
    size = np.linalg.norm(plane, axis=-1, keepdims=True)
    axis = np.where(planar, plane / np.where(planar, size, 1), axis)
    knee_turn = quat.from_axis_angle(axis, wanted - bend)
    hip_turn = quat.between(thigh + quat.rotate(knee_turn, shin), reach)
    still = quat.identity(len(place))
    turns = ((hip_turn, still), (knee_turn, still), (still, quat.mul(hip_turn, knee_turn)))
    for joint, (own, parent) in zip(leg, turns, strict=False):
        above = quat.mul(parent, world_rot[:, parents[joint]])
        rotations[:, joint] = quat.normalize(quat.mul(quat.inv(above), quat.mul(own, world_rot[:, joint])))
