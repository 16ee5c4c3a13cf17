"""The obvious twin of `lmm.locomotion.steps`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from features import trajectory as ground_plane
from mm.kernels_numpy import push_out
from motion import quat, springs

from .steps import BEND, NOWHERE, POINT
from .window import ASIDE, FUTURE, GAITS, PRESENT, SAMPLES, SIDES


def plan(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, joints, velocities,
         into, x):  # fmt: skip
    """See `lmm.locomotion.steps.plan`."""
    finite = np.isfinite(velocity.sum(axis=1) + yaw + turn_rate)
    if not finite.all():
        return int(np.argmin(finite))
    s, c = settings[0], characters
    c["target_velocity"] += s["velocity_share"] * (velocity - c["target_velocity"])
    change = s["facing_share"] * springs.wrap(yaw - c["target_yaw"])
    c["target_yaw"] = springs.wrap(c["target_yaw"] + change)
    c["crouch"] += s["crouch_share"] * (s["crouches"] * crouch - c["crouch"])
    c["gait"] += s["gait_share"] * (_gait(c, s) - c["gait"])

    root, yaws = c["root"][:, :2], c["root"][:, 2]
    spacing = past.shape[1] // FUTURE
    before = past[:, (head + 1 - spacing * np.arange(PRESENT, 0, -1)) % past.shape[1]]
    way, facing = np.zeros((2, len(c), SAMPLES, 2))
    gaits = np.repeat(c["gait"][:, None], SAMPLES, axis=1)
    gaits[:, :PRESENT] = before[:, :, 4:10]
    way[:, :PRESENT] = ground_plane.points_to_local(before[:, :, :2], root, yaws)
    facing[:, :PRESENT] = ground_plane.directions_to_local(before[:, :, 2:4], yaws)
    way[:, PRESENT:], facing[:, PRESENT:] = _future(c, turn_rate, s["dt"], spacing, sums, turns)
    blocks = (*(np.swapaxes(a, 1, 2) for a in (way, facing, gaits)), joints, velocities)
    for start, block in zip(into, blocks, strict=False):
        x[:, start : start + block[0].size] = block.reshape(len(c), -1)
    return -1


def _gait(c, s):
    """The gaits [N, 6] that belong to what is asked."""
    speed = np.linalg.norm(c["target_velocity"], axis=1)
    stand = 1 - np.minimum(speed / s["stand_speed"], 1) if s["stand_speed"] > 0 else np.zeros(len(c))
    jog = s["jogs"] * np.clip((speed - s["jog_from"]) / (s["jog_to"] - s["jog_from"]), 0, 1)
    upright = (1 - stand) * (1 - c["crouch"])
    found = {"stand": stand, "walk": upright * (1 - jog), "jog": upright * jog}
    found["crouch"] = (1 - stand) * c["crouch"]
    return np.stack([found.get(name, np.zeros(len(c))) for name in GAITS], axis=1)


def _future(c, rate, dt, spacing, sums, turns):
    """Local positions and directions [N, 6, 2] of the present and the future."""
    yaws, k = c["root"][:, 2], np.arange(1, FUTURE)
    turned = rate[:, None] * (dt * spacing) * (k - 0.5)
    asked = ground_plane.directions_to_world(c["target_velocity"][:, None], -yaws)
    asked = ground_plane.directions_to_world(asked[:, None].repeat(FUTURE - 1, 1).reshape(-1, 1, 2),
                                             turned.reshape(-1)).reshape(len(c), FUTURE - 1, 2)  # fmt: skip
    predicted = c["future"][:, :, :2].copy()
    predicted[:, 0] = 0
    steps = (1 - sums / spacing)[:, None] * np.diff(predicted, axis=1) + (sums * dt)[:, None] * asked
    way = np.zeros((len(c), FUTURE, 2))
    way[:, 1:] = np.cumsum(steps, axis=1)
    angles = np.arctan2(c["future"][:, 1:, 2], c["future"][:, 1:, 3])
    target = springs.wrap(c["target_yaw"] - yaws)[:, None] + rate[:, None] * (dt * spacing) * k
    angles = angles + turns * springs.wrap(target - angles)
    angles = np.concatenate([np.zeros((len(c), 1)), angles], axis=1)
    return way, ground_plane.facing(angles)


def sample_points(characters, into, x, points):
    """See `lmm.locomotion.steps.sample_points`."""
    root, yaws = characters["root"][:, :2], characters["root"][:, 2]
    way, facing = (_samples(x, start, 2) for start in into[:2])
    left = np.stack([facing[..., 1], -facing[..., 0]], axis=-1)
    for side in range(SIDES):
        points[:, :, side] = ground_plane.points_to_world(way + ASIDE * (side - 1) * left, root, yaws)


def _samples(x, start, components):
    return np.swapaxes(x[:, start : start + components * SAMPLES].reshape(len(x), components, SAMPLES), 1, 2)


def bound(y, bounds):
    """See `lmm.locomotion.steps.bound`."""
    np.clip(y, *bounds, out=y)


def move_joints(c, s, positions, velocities, joints, kept):
    """See `lmm.locomotion.steps.move_joints`; of all characters, positions and velocities [N, J, 3]."""
    before, after = (_frames(c[root], c[height]) for root, height in (("shown", "shown_height"),
                                                                      ("root", "height")))  # fmt: skip
    world = quat.rotate(before[1][:, None], joints) + before[0][:, None]
    moved = quat.rotate(quat.inv(after[1])[:, None], world - after[0][:, None]) + velocities * s["dt"]
    joints[:] = positions + s["joint_smoothing"] * (moved - positions)
    kept[:] = velocities


def put_pose(c, fps, parents, offsets, aims, joints, turned, positions, rotations, velocities, angular):
    """See `lmm.locomotion.steps.put_pose`; of all characters."""
    if len(aims):
        turned = _keep_lengths(parents, offsets, aims, joints, turned)
    new_positions, new_rotations = positions.copy(), rotations.copy()
    new_positions[:, 0], new_rotations[:, 0] = _frames(c["root"], c["height"])
    for j in range(1, len(parents)):
        p = parents[j] - 1
        new_positions[:, j], new_rotations[:, j] = joints[:, j - 1], turned[:, j - 1]
        if p >= 0:
            back = quat.inv(turned[:, p])
            new_rotations[:, j] = quat.mul(back, turned[:, j - 1])
            new_positions[:, j] = offsets[j]
            if not len(aims):
                new_positions[:, j] = quat.rotate(back, joints[:, j - 1] - joints[:, p])
    velocities[:] = (new_positions - positions) * fps
    angular[:] = quat.log(quat.shortest(quat.mul(new_rotations, quat.inv(rotations)))) * fps
    positions[:], rotations[:] = new_positions, new_rotations
    c["shown"], c["shown_height"] = c["root"], c["height"]


def _keep_lengths(parents, offsets, aims, joints, turned):
    """Rotations [N, J, 4] turned for their aims; see `lmm.locomotion.steps`."""
    turned, places = turned.copy(), joints.copy()
    for j, (end, far) in list(enumerate(aims))[1:]:
        p, q = parents[j] - 1, turned[:, j - 1]
        if p >= 0:
            places[:, j - 1] = places[:, p] + quat.rotate(turned[:, p], offsets[j])
        if end < 0:
            continue
        way = joints[:, end - 1] - places[:, j - 1]
        if far >= 0:
            way = _bent(
                way, joints[:, far - 1] - places[:, j - 1], *np.linalg.norm(offsets[[end, far]], axis=-1)
            )
        known = (way**2).sum(axis=-1) > POINT
        swing = quat.between(quat.rotate(q[known], offsets[end]), way[known])
        turned[known, j - 1] = quat.mul(swing, q[known])
    return turned


def _bent(way, reach, first, second):
    """Ways [N, 3] of the first of two bones of these lengths; see `lmm.locomotion.steps`."""
    distance = np.sqrt(np.maximum((reach**2).sum(axis=-1, keepdims=True), POINT))
    ahead = reach / distance
    aside = way - (way * ahead).sum(axis=-1, keepdims=True) * ahead
    width = np.linalg.norm(aside, axis=-1, keepdims=True)
    part = (first**2 + distance**2 - second**2) / (2 * distance)
    height = np.minimum(np.sqrt(np.maximum(first**2 - part**2, 0)), width + BEND)
    along = np.copysign(np.sqrt(first**2 - height**2), part)
    bent = along * ahead + height * aside / np.maximum(width, POINT)
    return np.where(width < POINT, way, bent)


def _frames(roots, heights):
    """Positions [N, 3] and rotations [N, 4] of roots x, z, yaw [N, 3] at heights [N]."""
    return np.stack([roots[:, 0], heights, roots[:, 1]], axis=-1), quat.from_yaw(roots[:, 2])


def remember(c, frames):
    """See `lmm.locomotion.steps.remember`; of all characters, frames [N, 10 or more]."""
    frames[:, :2], frames[:, 2:4] = c["root"][:, :2], ground_plane.facing(c["root"][:, 2])
    frames[:, 4:10] = c["gait"]


def move_root(c, s, velocities, turn_rates, obstacles):
    """See `lmm.locomotion.steps.move_root`; of all characters, velocities [N, 2]."""
    yaws = c["root"][:, 2]
    going = np.maximum(1 - c["gait"][:, 0], 0) ** 0.25
    step = ground_plane.directions_to_world(velocities[:, None], yaws)[:, 0]
    step = _drawn(step, c["target_velocity"], s["adjustment_ratio"])
    new = c["root"][:, :2] + going[:, None] * step * s["dt"]
    new = push_out(new, obstacles, s["body_radius"])
    c["velocity"] = (new - c["root"][:, :2]) / s["dt"]
    c["root"][:, :2] = new
    c["root"][:, 2] = springs.wrap(yaws + going * turn_rates * s["dt"])
    return going


def _drawn(velocities, asked, ratio):
    """See `lmm.locomotion.steps._drawn`; of all characters, velocities and asked [N, 2]."""
    along, square = ((velocities * asked).sum(axis=1), (asked * asked).sum(axis=1))
    aside = velocities - (along / np.maximum(square, NOWHERE))[:, None] * asked
    length, most = np.linalg.norm(aside, axis=1), ratio * np.linalg.norm(velocities, axis=1)
    share = np.where(
        (along > 0) & (square >= NOWHERE), np.minimum(length, most) / np.maximum(length, 1e-9), 0
    )
    return velocities - share[:, None] * aside
