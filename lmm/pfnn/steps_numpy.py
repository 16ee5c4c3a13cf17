"""The obvious twin of `lmm.pfnn.steps`: the same functions over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from motion import quat

from ..locomotion.steps_numpy import bound, move_joints, move_root, plan, put_pose, remember, sample_points
from ..locomotion.window import FUTURE, SAMPLES, SIDES

__all__ = ["advance", "bound", "plan", "sample_points", "show", "write_heights"]


def write_heights(characters, heights, into, x):
    """See `lmm.pfnn.steps.write_heights`."""
    characters["height"] = heights[:, :, 1].mean(axis=1)
    over = np.swapaxes(heights - characters["height"][:, None, None], 1, 2)
    x[:, into[5] : into[5] + SIDES * SAMPLES] = over.reshape(len(x), -1)


def show(characters, y, out, settings, parents, offsets, aims, contact_columns, joints, velocities,
         positions, rotations, local_velocities, local_angular, contacts, world_rotations,
         places):  # fmt: skip
    """See `lmm.pfnn.steps.show`; scratch is left alone."""
    s, c, count = settings[0], characters, joints.shape[1]
    now, velocity, turned = (y[:, start : start + 3 * count].reshape(-1, count, 3) for start in out[6:9])
    move_joints(c, s, now, velocity, joints, velocities)
    put_pose(c, 1 / s["dt"], parents, offsets, aims, joints, quat.exp(2 * turned), positions, rotations,
             local_velocities, local_angular)  # fmt: skip
    contacts[:] = y[:, out[3] + contact_columns] > 0.5


def advance(characters, past, head, y, out, settings, obstacles):
    """See `lmm.pfnn.steps.advance`."""
    s, c = settings[0], characters
    remember(c, past[:, head])
    going = move_root(c, s, y[:, out[0] : out[0] + 2], y[:, out[1]], obstacles)
    c["phase"] = np.mod(c["phase"] + (0.9 * going + 0.1) * y[:, out[2]] * s["dt"], 2 * np.pi)
    future = y[:, out[4] : out[4] + 4 * FUTURE].reshape(len(y), 4, FUTURE)
    c["future"] = np.swapaxes(future, 1, 2)
