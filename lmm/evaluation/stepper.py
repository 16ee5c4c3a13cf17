"""How far the Stepper drifts when it runs freely from true states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmm.model import Model
from mm import metrics, quality
from mm.database import Database
from motion import quat
from motion.pose import Poses

from .decompressor import decompress

Array = NDArray[np.floating]

STEPS = (5, 10, 20, 30, 60)
STARTS = 2000


class Rates(Protocol):
    """A stepper: rates of change [N, F + L] of states; a `Network`, or one that is being trained."""

    def evaluate(self, x: NDArray[np.float32], /) -> NDArray[np.float32]: ...


def free_run(stepper: Rates, states: Array, fps: float, steps: int) -> Iterator[NDArray[np.float32]]:
    """States [N, F + L] after 1, 2, ... steps: state + rate / fps, fed back; copies."""
    states = np.array(states, np.float32)
    for _ in range(steps):
        states = states + stepper.evaluate(states) / np.float32(fps)
        yield states


def choose_starts(
    database: Database, count: int, least: int, *, ranges: ArrayLike | None = None, seed: int = 0
) -> NDArray[np.int64]:
    """So many frames at random, of some ranges (a mask [R]; all by default), that at least least frames of
    the same range follow; fewer, each once, where there are no more."""
    chosen = np.ones(len(database.starts), bool) if ranges is None else np.asarray(ranges, bool)
    frames = np.arange(len(database))
    following = (database.stops - 1)[database.ranges()] - frames
    possible = np.flatnonzero(chosen[database.ranges()] & (following >= least))
    if count >= len(possible):
        return possible
    return np.sort(np.random.default_rng(seed).choice(possible, count, replace=False))


@dataclass(eq=False)
class Drift:
    """Errors after 1 to S steps of N free runs: [S, N] each, NaN beyond a run's clip, infinite where a state
    is no number any more.

    joints : mean distance of the joints from those of the true pose, roots aligned, cm.
    decoded : the same for the pose that the decompressor makes of the true state, which no stepper can
        be expected to beat.
    still : the same for the pose at the start, which is what a stepper that does nothing would show.
    path : distance of the ground root from where it truly went, cm.
    heading : difference of its facing, degrees.
    """

    joints: Array
    decoded: Array
    still: Array
    path: Array
    heading: Array

    def table(self, steps: Sequence[int] = STEPS) -> list[dict[str, Any]]:
        """A row for each number of steps that any run made: runs, then means and 95th percentiles."""
        rows = []
        for step in steps:
            runs = step <= len(self.joints) and ~np.isnan(self.joints[step - 1])
            if not np.any(runs):
                continue
            row: dict[str, Any] = {"steps": step, "runs": int(np.sum(runs))}
            for name, unit in (("joints", "cm"), ("path", "cm"), ("heading", "deg")):
                values = getattr(self, name)[step - 1][runs]
                row |= {
                    f"{name}_{unit}": float(values.mean()),
                    f"{name}_p95_{unit}": float(np.percentile(values, 95)),
                }
            for name in ("decoded", "still"):
                row[f"{name}_cm"] = float(getattr(self, name)[step - 1][runs].mean())
            rows.append(row)
        return rows

    def curves(self) -> dict[str, list[float]]:
        """Means [S] after each step, of the runs that get there, by name and unit; NaN where none does."""
        units = {"joints": "cm", "decoded": "cm", "still": "cm", "path": "cm", "heading": "deg"}
        return {
            f"{name}_{unit}": [metrics.mean(values[~np.isnan(values)]) for values in getattr(self, name)]
            for name, unit in units.items()
        }


def drift(
    model: Model,
    database: Database,
    latents: Array | None = None,
    *,
    steps: int = max(STEPS),
    least: int = min(STEPS),
    starts: int = STARTS,
    ranges: ArrayLike | None = None,
    seed: int = 0,
) -> Drift:
    """Run the stepper freely from true states, and compare with what truly followed in the same clip.

    Starts are frames at random of some ranges (a mask [R]; all by default) that at least least frames follow.
    """
    latents = model.latents(database) if latents is None else latents
    begin = choose_starts(database, starts, least, ranges=ranges, seed=seed)
    last = (database.stops - 1)[database.ranges()][begin]
    truth = np.concatenate([database.features[begin], latents[begin]], axis=1)
    errors = np.full((5, steps, len(begin)), np.nan)
    first = _local(model, database.poses[begin])
    root = _roots(database.poses[begin])
    way: Array = np.zeros((len(begin), 3))
    for s, states in enumerate(free_run(model.stepper, truth, database.fps, steps)):
        inside = begin + s + 1 <= last
        if not inside.any():
            break
        poses, _ = decompress(model, states)
        way = _onward(way, poses)
        frames = np.minimum(begin + s + 1, last)
        real = database.poses[frames]
        there = _local(model, real)
        known, _ = decompress(model, np.concatenate([database.features[frames], latents[frames]], axis=1))
        went = _relative(root, _roots(real))
        row = (
            _apart(_local(model, poses), there),
            _apart(_local(model, known), there),
            _apart(first, there),
            100 * np.linalg.norm(way[:, :2] - went[:, :2], axis=-1),
            np.degrees(np.abs(metrics.wrap(way[:, 2] - went[:, 2]))),
        )
        errors[:, s] = np.where(inside, metrics.or_infinite(row), np.nan)
    return Drift(*errors)


def _local(model: Model, poses: Poses) -> Array:
    return quality.in_root_space(model.description.skeleton, poses.positions, poses.rotations)


def _apart(found: Array, truth: Array) -> Array:
    """Mean distance of joints [N, J-1, 3], cm [N]."""
    return 100 * np.linalg.norm(found - truth, axis=-1).mean(axis=-1)


def _roots(poses: Poses) -> Array:
    """The ground roots [N, 3]: x, z, yaw in the world."""
    yaw = quat.yaw(np.asarray(poses.rotations[:, 0], np.float64))
    return np.column_stack([poses.positions[:, 0, 0], poses.positions[:, 0, 2], yaw]).astype(np.float64)


def _turned(ground: Array, yaw: Array) -> Array:
    """Ground vectors [N, 2] about the vertical by yaw [N]."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * ground[:, 0] + s * ground[:, 1], c * ground[:, 1] - s * ground[:, 0]])


def _relative(origin: Array, roots: Array) -> Array:
    """Roots [N, 3] as seen from others."""
    moved = _turned(roots[:, :2] - origin[:, :2], -origin[:, 2])
    return np.column_stack([moved, roots[:, 2] - origin[:, 2]])


def _onward(way: Array, poses: Poses) -> Array:
    """The way [N, 3] after the frame whose motion joint 0 of poses holds (see `mm.kernels`)."""
    step = _roots(poses)
    return np.column_stack([way[:, :2] + _turned(step[:, :2], way[:, 2]), way[:, 2] + step[:, 2]])
