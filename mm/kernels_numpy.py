"""The obvious twin of `mm.kernels`: the same functions over all characters, for the tests to compare."""

from __future__ import annotations

import numpy as np

from motion import quat, springs

from .search.rows import PATH, SQUARED


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
            times, slots, trajectory, who):  # fmt: skip
    """See `mm.kernels.control`."""
    finite = np.isfinite(velocity.sum(axis=-1) + yaw + turn_rate)
    if not finite.all():
        return int(np.argmin(finite)), 0
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
    c["until_back"] -= dt
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
    searching = np.flatnonzero(c["searching"])
    who[: len(searching)] = searching
    return -1, len(searching)


def remember(characters, history, head, frames, slots, present, trajectory):
    """See `mm.kernels.remember`."""
    history[:, head] = characters["root"]
    whole = np.floor(frames).astype(np.int64)
    later, earlier = (history[:, (head - back) % history.shape[1]] for back in (whole, whole + 1))
    difference = earlier - later
    difference[..., 2] = springs.wrap(difference[..., 2])
    trajectory[:, slots] = later + (frames - whole)[:, None] * difference
    trajectory[:, present] = characters["root"][:, None]


def divide(flags, tag, required, forbidden, to_require, to_forbid):
    to_require[:] = required | np.where(flags, tag & ~forbidden, 0)
    to_forbid[:] = forbidden | np.where(flags, 0, tag & ~required)


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


def ask(
    characters, who, features, tags, required, forbidden, ended, trajectory,
    position_columns, direction_columns, offset, scale, terms, share,
    queries, needed, avoided, forced, costs, bounds,
):  # fmt: skip
    """See `mm.kernels.ask`."""
    build_queries(
        characters, who, features, trajectory, position_columns, direction_columns, offset, scale, queries
    )
    needed[:], avoided[:] = required[who], forbidden[who]
    forced[:] = ended[who] | (needed & ~tags != 0) | (avoided & tags != 0)
    costs[:] = 0
    for kind, start, stop in [(SQUARED, 0, queries.shape[1])] if terms is None else terms:
        off = queries[:, start:stop] - features[:, start:stop]
        if kind == PATH:
            samples = off.reshape(len(off), -1, 2)
            for parts in (samples, np.diff(samples, axis=1)):
                costs += np.linalg.norm(parts, axis=-1).sum(axis=-1)
        else:
            costs += np.linalg.norm(off, axis=-1) ** (2 if kind == SQUARED else 1)
    costs[forced] = np.inf
    bounds[:] = costs * share


def turn_back(characters, who, frames, forced, radius, dt, found):
    """See `mm.kernels.turn_back`."""
    c = characters[who]
    near = (frames >= 0) & (c["left"] >= 0) & (np.abs(frames - c["left"]) < radius)
    found &= ~(near & (c["until_back"] > dt / 2) & ~forced)


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


def at_ends(frames, last, ended):
    ended[:] = frames >= last[frames]


def play_on(frames, last):
    frames[:] = np.minimum(frames + 1, last[frames])
