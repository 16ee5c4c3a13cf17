"""The obvious twin of `mm.kernels`: the same functions over all characters, for the tests to compare."""

from __future__ import annotations

import numpy as np

from motion import quat

from . import springs
from .kernels import FULL_REACH, RESTING_OFFSET, RESTING_SPEED, SOFT_REACH


def turn(v, yaw):
    """Rotate ground vectors [..., 2] about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * v[..., 0] + s * v[..., 1], c * v[..., 1] - s * v[..., 0]], axis=-1)


def push_out(p, obstacles, distance):
    """The nearest points outside every obstacle, one obstacle after the other; p [N, 2]."""
    for x, z, hx, hz, radius in obstacles:
        centre, half, reach = np.array([x, z]), np.array([hx, hz]), radius + distance
        d = p - centre
        side = np.where(d >= 0, 1.0, -1.0)
        e = np.abs(d) - half
        inside = np.all(e <= 0, axis=-1)
        nearest = np.argmax(e, axis=-1)
        leave = np.where(np.arange(2) == nearest[:, None], centre + side * (half + reach), p)
        e = np.maximum(e, 0)
        gap = np.linalg.norm(e, axis=-1, keepdims=True)
        pushed = p + np.where(gap < reach, side * e / np.where(gap > 0, gap, 1) * (reach - gap), 0)
        p = np.where(inside[:, None], leave, pushed)
    return p


def _chase(x, v, a, yaw, yaw_rate, desired, desired_yaw, s, dt):
    x, v, a = springs.simulate(x, v, a, desired, s["velocity_halflife"], dt)
    offset, yaw_rate = springs.decay(springs.wrap(yaw - desired_yaw), yaw_rate, s["rotation_halflife"], dt)
    return x, v, a, desired_yaw + offset, yaw_rate


def control(characters, velocity, yaw, turn_rate, required_tags, forbidden_tags, ended, settings, obstacles,
            times, slots, trajectory):  # fmt: skip
    """See `mm.kernels.control`."""
    finite = np.isfinite(velocity.sum(axis=-1) + yaw + turn_rate)
    if not finite.all():
        return int(np.argmin(finite))
    s, c = settings[0], characters
    dt, limit = s["dt"], s["forced_search_change"]
    retagged = (c["required_tags"] != required_tags) | (c["forbidden_tags"] != forbidden_tags)
    c["required_tags"], c["forbidden_tags"] = required_tags, forbidden_tags
    velocity_change = np.linalg.norm(velocity - c["desired_velocity"], axis=-1)
    yaw_change = np.abs(springs.wrap(yaw - c["desired_yaw"]))
    settled = ((c["velocity_change"] >= limit) & (velocity_change < limit)) | (
        (c["yaw_change"] >= limit) & (yaw_change < limit)
    )
    c["forced"] = retagged | (settled & (c["until_forced"] < dt / 2))
    c["until_forced"] = np.where(c["forced"], s["search_interval"], c["until_forced"] - dt)
    c["searching"] = c["forced"] | ended | (c["until_search"] < dt / 2)
    c["until_search"] = np.where(c["searching"], s["search_interval"], c["until_search"]) - dt
    c["velocity_change"], c["yaw_change"] = velocity_change, yaw_change
    c["desired_velocity"], c["desired_yaw"] = velocity, yaw

    x, v, a = c["position"].copy(), c["velocity"].copy(), c["acceleration"].copy()
    angle, rate, before = c["yaw"].copy(), c["yaw_rate"].copy(), 0.0
    for time, slot in zip(times, slots, strict=True):
        turned = turn_rate * time
        x, v, a, angle, rate = _chase(
            x, v, a, angle, rate, turn(velocity, turned), yaw + turned, s, time - before
        )
        x = push_out(x, obstacles, s["body_radius"])
        before = time
        trajectory[:, slot, :2], trajectory[:, slot, 2] = x, angle
    return -1


def build_queries(
    characters, who, features, trajectory, position_columns, direction_columns, offset, scale, queries
):
    """See `mm.kernels.build_queries`."""
    queries[:] = features
    root = characters["root"][who]
    for k, (position, direction) in enumerate(zip(position_columns, direction_columns, strict=True)):
        sample = trajectory[who, k]
        if position >= 0:
            columns = [position, position + 1]
            local = turn(sample[:, :2] - root[:, :2], -root[:, 2])
            queries[:, columns] = (local - offset[columns]) / scale[columns]
        if direction >= 0:
            columns = [direction, direction + 1]
            angle = sample[:, 2] - root[:, 2]
            facing = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
            queries[:, columns] = (facing - offset[columns]) / scale[columns]


def transition(who, characters, positions, rotations, velocities, angular, offsets,
               to_positions, to_rotations, to_velocities, to_angular):  # fmt: skip
    """See `mm.kernels.transition`."""
    turned = quat.mul(rotations[who, 1:], quat.inv(to_rotations[:, 1:]))
    offsets[who, 1:, 0] = positions[who, 1:] - to_positions[:, 1:]
    offsets[who, 1:, 1] = quat.log(quat.shortest(turned))
    offsets[who, 1:, 2] = velocities[who, 1:] - to_velocities[:, 1:]
    offsets[who, 1:, 3] = angular[who, 1:] - to_angular[:, 1:]
    c = characters[who]
    rate = np.empty((len(c), 3))
    rate[:, :2] = turn(to_velocities[:, 0][:, [0, 2]], c["root"][:, 2])
    rate[:, 2] = to_angular[:, 0, 1]
    c["data_root"], c["root_offset"], c["root_offset_rate"] = c["root"], 0, c["root_rate"] - rate
    characters[who] = c


def inertialize(characters, settings, offsets, from_positions, from_rotations, from_velocities, from_angular,
                positions, rotations, velocities, angular):  # fmt: skip
    """See `mm.kernels.inertialize`."""
    s, c = settings[0], characters
    dt, halflife = s["dt"], s["inertialization_halflife"]
    c["data_root"][:, :2] += turn(from_positions[:, 0][:, [0, 2]], c["data_root"][:, 2])
    turned = 2 * np.arctan2(from_rotations[:, 0, 2], from_rotations[:, 0, 0])
    c["data_root"][:, 2] = springs.wrap(c["data_root"][:, 2] + turned)
    offset, rate = springs.decay(c["root_offset"], c["root_offset_rate"], halflife, dt)
    c["root_offset"], c["root_offset_rate"] = offset, rate
    c["root"] = c["data_root"] + offset
    c["root_rate"][:, :2] = turn(from_velocities[:, 0][:, [0, 2]], c["data_root"][:, 2]) + rate[:, :2]
    c["root_rate"][:, 2] = from_angular[:, 0, 1] + rate[:, 2]

    x, v = springs.decay(offsets[:, 1:, :2], offsets[:, 1:, 2:], halflife, dt)
    offsets[:, 1:, :2], offsets[:, 1:, 2:] = x, v
    turned = quat.exp(x[:, :, 1])
    positions[:, 1:] = from_positions[:, 1:] + x[:, :, 0]
    velocities[:, 1:] = from_velocities[:, 1:] + v[:, :, 0]
    rotations[:, 1:] = quat.mul(turned, from_rotations[:, 1:])
    angular[:, 1:] = quat.rotate(turned, from_angular[:, 1:]) + v[:, :, 1]


def synchronize(characters, settings, obstacles, positions, rotations, velocities, angular):
    """See `mm.kernels.synchronize`."""
    s, c = settings[0], characters
    dt = s["dt"]
    x, v, a, yaw, rate = _chase(
        c["position"], c["velocity"], c["acceleration"], c["yaw"], c["yaw_rate"],
        c["desired_velocity"], c["desired_yaw"], s, dt,
    )  # fmt: skip
    c["position"] = push_out(x, obstacles, s["body_radius"])
    c["velocity"], c["acceleration"], c["yaw"], c["yaw_rate"] = v, a, springs.wrap(yaw), rate
    if s["data"]:
        c["position"], c["yaw"] = c["root"][:, :2], c["root"][:, 2]
    moved = np.zeros((len(c), 3))
    if s["adjust"]:
        share = 1 - np.exp(-springs.LN2 * dt / (s["position_adjustment_halflife"] + springs.TINY))
        moved[:, :2] = share * (c["position"] - c["root"][:, :2])
        length = np.linalg.norm(moved[:, :2], axis=-1)
        most = s["adjustment_ratio"] * np.linalg.norm(c["root_rate"][:, :2], axis=-1) * dt
        moved[:, :2] *= np.where(length > most, most / np.where(length > 0, length, 1), 1)[:, None]
        share = 1 - np.exp(-springs.LN2 * dt / (s["rotation_adjustment_halflife"] + springs.TINY))
        most = s["adjustment_ratio"] * np.abs(c["root_rate"][:, 2]) * dt
        moved[:, 2] = np.clip(share * springs.wrap(c["yaw"] - c["root"][:, 2]), -most, most)
    if s["clamp"]:
        apart = c["root"][:, :2] + moved[:, :2] - c["position"]
        length = np.linalg.norm(apart, axis=-1)
        back = np.where(
            length > s["maximal_distance"], s["maximal_distance"] / np.where(length > 0, length, 1), 1
        )
        moved[:, :2] += (back - 1)[:, None] * apart
        angle = springs.wrap(c["root"][:, 2] + moved[:, 2] - c["yaw"])
        moved[:, 2] += np.clip(angle, -s["maximal_angle"], s["maximal_angle"]) - angle
    for name in ("data_root", "root"):
        c[name] += moved
        c[name][:, 2] = springs.wrap(c[name][:, 2])

    root, rate = c["root"], c["root_rate"]
    nothing = np.zeros(len(c))
    positions[:, 0] = np.stack([root[:, 0], nothing, root[:, 1]], axis=-1)
    rotations[:, 0] = quat.from_yaw(root[:, 2])
    velocities[:, 0] = np.stack([rate[:, 0], nothing, rate[:, 1]], axis=-1)
    angular[:, 0] = np.stack([nothing, rate[:, 2], nothing], axis=-1)


def lock_feet(feet, contacts, settings, parents, needed, legs, points, hinges, heights, positions,
              rotations):  # fmt: skip
    """See `mm.kernels.lock_feet`."""
    s = settings[0]
    world_pos, world_rot = positions.copy(), rotations.copy()
    for j in needed[1:]:
        p = parents[j]
        world_pos[:, j] = world_pos[:, p] + quat.rotate(world_rot[:, p], positions[:, j])
        world_rot[:, j] = quat.mul(world_rot[:, p], rotations[:, j])
    for k, leg in enumerate(legs):
        target = world_pos[:, leg[3]] + quat.rotate(world_rot[:, leg[3]], points[k])
        place = _update_contact(feet[:, k], contacts[:, k] != 0, target, heights[k], s)
        wanted = np.abs(place - target).sum(axis=-1) > 1e-4
        bent = rotations.copy()
        _reach(place, target, leg, hinges[k], parents, world_pos, world_rot, bent)
        rotations[wanted] = bent[wanted]


def _update_contact(foot, contact, target, heights, s):
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


def _reach(place, touch, leg, hinge, parents, world_pos, world_rot, rotations):
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
    size = np.linalg.norm(plane, axis=-1, keepdims=True)
    axis = np.where(planar, plane / np.where(planar, size, 1), axis)
    knee_turn = quat.from_axis_angle(axis, wanted - bend)
    hip_turn = quat.between(thigh + quat.rotate(knee_turn, shin), reach)
    still = quat.identity(len(place))
    turns = ((hip_turn, still), (knee_turn, still), (still, quat.mul(hip_turn, knee_turn)))
    for joint, (own, parent) in zip(leg, turns, strict=False):
        above = quat.mul(parent, world_rot[:, parents[joint]])
        rotations[:, joint] = quat.normalize(quat.mul(quat.inv(above), quat.mul(own, world_rot[:, joint])))


def gather(frames, root_steps, positions, rotations, velocities, angular, contacts,
           to_positions, to_rotations, to_velocities, to_angular, to_contacts):  # fmt: skip
    """See `mm.kernels.gather`."""
    to_positions[:], to_rotations[:] = positions[frames], rotations[frames]
    to_velocities[:], to_angular[:], to_contacts[:] = velocities[frames], angular[frames], contacts[frames]
    steps = root_steps[frames]
    nothing = np.zeros(len(steps))
    to_positions[:, 0] = np.stack([steps[:, 0], nothing, steps[:, 1]], axis=-1)
    to_rotations[:, 0] = quat.from_yaw(steps[:, 2])
    to_velocities[:, 0] = np.stack([steps[:, 3], nothing, steps[:, 4]], axis=-1)
    to_angular[:, 0] = np.stack([nothing, steps[:, 5], nothing], axis=-1)
