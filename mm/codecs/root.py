"""The ground root's motion in few bits, so that where it leads is as exact as each of its steps.

A step is rounded to lead from where the rounded ones before it have led to where the root truly is. So an
error is made up for in the next frame, and the root is never farther from its way through a clip than
rounding one step puts it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from motion import quat, springs

from ..database import Database
from ..stages import root_steps

MOST = 32767
ROOM = 1.05  # steps that make up for others are larger than any of the data


def halves(database: Database) -> NDArray[np.float16]:
    """Half floats [T, 6] of `mm.stages.root_steps`."""
    return _led(database, lambda values: values.astype(np.float16)).astype(np.float16)


def coded(database: Database) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Codes [T, 6] of `mm.stages.root_steps`, and what one is worth [6]."""
    most = np.abs(root_steps(database)).max(axis=0)
    scale = np.where(most > 0, ROOM * most / MOST, 1).astype(np.float32)

    def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = scale[: values.shape[1]] if values.shape[1] == 3 else scale
        return np.rint(values / columns).clip(-MOST, MOST) * columns

    return np.rint(_led(database, rounded) / scale).astype(np.int16), scale


def _led(database: Database, rounded: Callable[[NDArray], NDArray]) -> NDArray[np.float64]:
    """Rounded steps [T, 6]; rounded takes columns [N, 6], or the first three of them."""
    out = rounded(root_steps(database).astype(np.float64)).astype(np.float64)
    truth = path(database)
    starts = database.starts.astype(np.int64)
    lengths = database.stops - database.starts
    at = truth[starts]
    for t in range(1, int(lengths.max())):
        going = np.flatnonzero(lengths > t)
        here, frames = at[going], starts[going] + t
        wanted = _turned(truth[frames] - here, -here[:, 2])
        wanted[:, 2] = springs.wrap(wanted[:, 2])
        steps = rounded(wanted).astype(np.float64)
        at[going] = here + _turned(steps, here[:, 2])
        out[frames, :3] = steps
    second = np.minimum(starts + 1, database.stops - 1)
    out[starts, :3] = np.where((second > starts)[:, None], out[second, :3], 0)
    return out


def path(database: Database) -> NDArray[np.float64]:
    """Where the ground root is: x, z (m) and yaw (rad) [T, 3]."""
    poses = database.poses
    yaw = quat.yaw(np.asarray(poses.rotations[:, 0], np.float64))
    return np.column_stack([poses.positions[:, 0, 0], poses.positions[:, 0, 2], yaw])


def follow(
    steps: NDArray, origins: NDArray, starts: NDArray[np.int32], stops: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Where steps [T, >= 3] lead from origins [R, 3]: x, z and yaw [T, 3], the inverse of what makes them."""
    steps = np.asarray(steps, np.float64)
    out = np.empty((len(steps), 3))
    for origin, start, stop in zip(np.asarray(origins, np.float64), starts, stops, strict=True):
        own = steps[start + 1 : stop]
        out[start:stop, 2] = origin[2] + np.append(0, np.cumsum(own[:, 2]))
        moved = _turned(own[:, :3], out[start : stop - 1, 2])[:, :2]
        out[start:stop, :2] = origin[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return out


def _turned(steps: NDArray, yaw: NDArray) -> NDArray[np.float64]:
    """Steps [N, 3], their x and z turned by yaw [N]."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, z = steps[:, 0], steps[:, 1]
    return np.column_stack([c * x + s * z, c * z - s * x, steps[:, 2]])
