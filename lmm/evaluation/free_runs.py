"""How far a network of locomotion drifts that runs on its own output under the true trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import metrics
from motion import quat

from .frames import Rows, Truth
from .phase import free_run, windows

Array = NDArray[np.floating]

STEPS = (1, 5, 10, 20, 30, 60)
RUNS = 1000
UNITS = {
    "joints": "cm",
    "rotation": "deg",
    "phase": "deg",
    "still": "cm",
    "path": "cm",
    "heading": "deg",
}


@dataclass(eq=False)
class Drift:
    """Errors after 1 to S steps of N free runs, [S, N] each, infinite where poses are no numbers any more.

    joints : mean distance of the joints from the true ones in root space, cm.
    rotation : mean angle of the joints' rotations in root space from the true ones, degrees.
    phase : difference of the phase, degrees; None without one.
    still : distance of the joints of the pose before the run, which is what doing nothing would show, cm.
    path, heading : of the root that goes as the network tells from where it truly goes, cm and degrees. It is
        told, and not gone: what the network is given is the true trajectory.
    """

    joints: Array
    rotation: Array
    phase: Array | None
    still: Array
    path: Array
    heading: Array

    def table(self, steps: Sequence[int] = STEPS) -> list[dict[str, Any]]:
        """A row for each number of steps that were run: steps, runs, means, and of some 95th percentiles."""
        rows = []
        for s in (s for s in steps if s <= len(self.joints) and self.joints.shape[1]):
            row: dict[str, Any] = {"steps": s, "runs": self.joints.shape[1]}
            for name, unit in UNITS.items():
                errors = getattr(self, name)
                if errors is None:
                    continue
                row[f"{name}_{unit}"] = float(errors[s - 1].mean())
                if name in ("joints", "phase", "path"):
                    row[f"{name}_p95_{unit}"] = float(np.percentile(errors[s - 1], 95))
            rows.append(row)
        return rows

    def curves(self) -> dict[str, list[float]]:
        """Means [S] after each step, by name and unit."""
        of = {name: getattr(self, name) for name in UNITS}
        return {
            f"{name}_{UNITS[name]}": errors.mean(axis=1).tolist()
            for name, errors in of.items()
            if errors is not None and errors.shape[1]
        }


def starts(truth: Truth, part: str, *, steps: int = max(STEPS), runs: int = RUNS) -> NDArray[np.int64]:
    """Rows of a part's frames, evenly spread, that so many steps of one range begin at."""
    rows = windows(truth.frames.frame, steps)
    rows = rows[truth.parts[part][truth.ranges[rows]]]
    return rows[np.linspace(0, len(rows) - 1, min(runs, len(rows))).astype(np.int64)]


def drift(truth: Truth, part: str, *, runs: int = RUNS) -> Drift:
    """Run freely from true poses of a part of the data, as long as its clips are, 60 steps at most."""
    for steps in reversed(STEPS):
        rows = starts(truth, part, steps=steps, runs=runs)
        if len(rows):
            break
    frames, layout, fps = truth.frames, truth.model.layout, truth.database.fps
    phased = hasattr(frames, "phase")
    errors = np.empty((len(UNITS), steps, len(rows)))
    first = layout.unpack_inputs(frames.x[rows]).positions
    way: Array = np.zeros((len(rows), 3))
    went = way
    off = np.zeros(len(rows))
    run = free_run(Rows(truth.model), frames, rows, layout, fps=fps, steps=steps)
    for s, y in enumerate(run):
        made, real = layout.unpack_outputs(y), layout.unpack_outputs(frames.y[rows + s])
        way, went = _onward(way, made, fps), _onward(went, real, fps)
        if phased:
            off += (made.phase_rate.astype(np.float64) - real.phase_rate) / fps
        errors[:, s] = (
            _apart(made.positions, real.positions),
            np.degrees(quat.angle_between(real.rotations, made.rotations)).mean(axis=-1),
            np.degrees(np.abs(metrics.wrap(off))),
            _apart(first, real.positions),
            100 * np.linalg.norm(way[:, :2] - went[:, :2], axis=-1),
            np.degrees(np.abs(metrics.wrap(way[:, 2] - went[:, 2]))),
        )
    found = dict(zip(UNITS, metrics.or_infinite(errors), strict=True))
    return Drift(**found | {"phase": found["phase"] if phased else None})


def _apart(found: Array, truth: Array) -> Array:
    """Mean distance of joints [N, J, 3], cm [N]."""
    return 100 * np.linalg.norm(np.asarray(found, np.float64) - truth, axis=-1).mean(axis=-1)


def _onward(way: Array, parts: Any, fps: float) -> Array:
    """Roots [N, 3] (x, z, yaw), a frame on by the velocity and turn rate that outputs tell."""
    c, s = np.cos(way[:, 2]), np.sin(way[:, 2])
    x, z = parts.root_velocity.astype(np.float64).T / fps
    return np.column_stack(
        [way[:, 0] + c * x + s * z, way[:, 1] + c * z - s * x, way[:, 2] + parts.turn_rate / fps]
    )
