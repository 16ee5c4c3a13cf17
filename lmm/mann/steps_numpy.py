"""The obvious twin of `lmm.mann.steps`: the same functions over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from features import trajectory as ground_plane

from ..locomotion.steps_numpy import bound, move_joints, move_root, put_pose, remember, sample_points
from ..locomotion.steps_numpy import plan as plan_way
from ..locomotion.window import FUTURE, PRESENT, SAMPLES
from .layout import from_axes, to_axes

__all__ = ["advance", "bound", "plan", "sample_points", "show", "stand"]


def plan(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, shares, joints,
         velocities, rotations, into, x):  # fmt: skip
    """See `lmm.mann.steps.plan`."""
    wrong = plan_way(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, joints,
                     velocities, into, x)  # fmt: skip
    if wrong >= 0:
        return wrong
    c, yaws = characters, characters["root"][:, 2]
    spacing = past.shape[1] // FUTURE
    before = past[:, (head + 1 - spacing * np.arange(PRESENT, 0, -1)) % past.shape[1]]
    going, speeds = np.zeros((len(c), SAMPLES, 2)), np.zeros((len(c), SAMPLES))
    speeds[:, :PRESENT], speeds[:, PRESENT:] = before[:, :, 12], _wanted(c)[:, None]
    going[:, :PRESENT] = ground_plane.directions_to_local(before[:, :, 10:12], yaws)
    going[:, PRESENT] = ground_plane.directions_to_local(c["velocity"][:, None], yaws)[:, 0]
    asked = np.repeat(c["target_velocity"][:, None], FUTURE - 1, axis=1)
    turned = turn_rate[:, None] * settings[0]["dt"] * spacing * np.arange(1, FUTURE)
    asked = ground_plane.directions_to_local(asked[:, :, None], yaws[:, None] - turned)[:, :, 0]
    predicted = c["future"][:, 1:, 4:]
    going[:, PRESENT + 1 :] = predicted + shares[:, None] * (asked - predicted)
    for start, block in zip(into[5:], (np.swapaxes(going, 1, 2), speeds, rotations), strict=True):
        x[:, start : start + block[0].size] = block.reshape(len(c), -1)
    return -1


def _wanted(c):
    return np.linalg.norm(c["target_velocity"], axis=1)


def stand(characters, heights):
    """See `lmm.mann.steps.stand`."""
    characters["height"] = heights[:, :, 1].mean(axis=1)


def show(characters, y, out, settings, parents, offsets, aims, contact_columns, joints, velocities, axes,
         positions, rotations, local_velocities, local_angular, contacts, world_rotations,
         places):  # fmt: skip
    """See `lmm.mann.steps.show`; scratch is left alone."""
    s, c, count = settings[0], characters, joints.shape[1]
    now, turned, velocity = (
        y[:, start : start + size * count].reshape(-1, count, size)
        for start, size in zip(out[6:9], (3, 6, 3), strict=True)
    )
    move_joints(c, s, now, velocity, joints, velocities)
    turned = from_axes(turned)
    axes[:] = to_axes(turned)
    put_pose(c, 1 / s["dt"], parents, offsets, aims, joints, turned, positions, rotations,
             local_velocities, local_angular)  # fmt: skip
    contacts[:, : len(contact_columns)] = y[:, out[2] + contact_columns] > 0.5


def advance(characters, past, head, y, out, settings, obstacles):
    """See `lmm.mann.steps.advance`."""
    s, c, frames = settings[0], characters, past[:, head]
    remember(c, frames)
    frames[:, 10:12], frames[:, 12] = c["velocity"], _wanted(c)
    move_root(c, s, y[:, out[0] : out[0] + 2], y[:, out[1]], obstacles)
    future = y[:, out[3] : out[3] + 6 * FUTURE].reshape(len(y), 6, FUTURE)
    c["future"] = np.swapaxes(future, 1, 2)
