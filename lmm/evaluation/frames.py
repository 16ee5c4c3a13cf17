"""How true the poses are that a network of locomotion makes of true poses, under the true trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.labels import Labels
from lmm.evaluator import Products
from lmm.locomotion.labelling import kept
from lmm.locomotion.model import LocomotionModel
from lmm.mann import frames as of_mann
from lmm.mann.evaluator import MannEvaluator
from lmm.pfnn import frames as of_phase
from lmm.pfnn.evaluator import PhaseEvaluator
from lmm.pfnn.model import PhaseModel
from lmm.pfnn.spline import Mode
from mm import metrics
from mm.database import Database
from motion import quat
from motion.errors import UserError

from .phase import Frames

Array = NDArray[np.float32]

CHUNK = 2048


@dataclass(eq=False)
class Truth:
    """A database as a network of locomotion sees it, on level ground.

    Attributes
    ----------
    model, database : the network, and a database of its skeleton (`LocomotionModel.check`).
    labels : of all frames, of the network's contacts.
    """

    model: LocomotionModel
    database: Database
    labels: Labels

    def __post_init__(self) -> None:
        if self.labels.names != self.model.contacts:
            mine, its = (", ".join(names) or "none" for names in (self.model.contacts, self.labels.names))
            what = f"the network's contacts are {mine}, those of the labels {its}"
            raise UserError(what, remedy="judge it on the database that it was trained from")

    @cached_property
    def frames(self) -> Frames:
        """Vectors of all frames but the first and the last of each range that is labelled."""
        make: Any = of_phase.frames if isinstance(self.model, PhaseModel) else of_mann.frames
        return make(self.database, self.labels)

    @cached_property
    def parts(self) -> dict[str, NDArray[np.bool_]]:
        """Which ranges [R] were trained on, and which held out, if any."""
        names = self.database.names
        held = np.array([name in self.model.held_out for name in names], bool)
        labelled = kept(self.database, self.labels)
        found = {"training": labelled & ~held, "held_out": labelled & held}
        return {part: ranges for part, ranges in found.items() if ranges.any()}

    @cached_property
    def ranges(self) -> NDArray[np.int32]:
        """The range [M] of each row of `frames`."""
        return self.database.ranges()[self.frames.frame]


class Rows:
    """A model's network at run time, for any number of rows; what it gives is the caller's.

    mode is of phase-functioned networks alone, see `lmm.pfnn.spline`; products : see the evaluators.
    """

    def __init__(self, model: LocomotionModel, mode: Mode = "cubic", products: Products = "float32") -> None:
        network: Any = model.network
        self._network: Any
        if isinstance(model, PhaseModel):
            self._network = PhaseEvaluator(network, mode=mode, products=products, count=CHUNK)
        else:
            self._network = MannEvaluator(network, products=products, count=CHUNK)

    def evaluate(self, x: Array, /, *phases: NDArray[np.floating]) -> Array:
        """Outputs [N, O] of inputs [N, I], at phases [N] where it has one."""
        out = np.empty((len(x), self._network.outputs), np.float32)
        for start in range(0, len(x), CHUNK):
            part = slice(start, start + CHUNK)
            given = (np.ascontiguousarray(array[part], np.float32) for array in (x, *phases))
            out[part] = self._network.evaluate(*given)
        return out


@dataclass(frozen=True, eq=False)
class Step:
    """Errors of M frames that the network made, each of the true frame before it.

    Attributes
    ----------
    position_cm, rotation_deg, velocity_cm_s : float32 [M, J], of the joints in root space: distances,
        angles, differences of the velocities that the network tells.
    relative : float32 [M, J], see `mm.metrics.relative_error`.
    root_cm_s, turn_deg_s : [M], of the root's velocity and of its turn rate.
    phase_deg_s : [M], of the phase's rate; None without a phase.
    contacts : bool [M, C], which are right.
    """

    position_cm: Array
    rotation_deg: Array
    velocity_cm_s: Array
    relative: Array
    root_cm_s: Array
    turn_deg_s: Array
    phase_deg_s: Array | None
    contacts: NDArray[np.bool_]


def step(truth: Truth, mode: Mode = "cubic", products: Products = "float32") -> Step:
    """One step from every frame of the database; mode, products: see `Rows`."""
    frames, layout, network = truth.frames, truth.model.layout, Rows(truth.model, mode, products)
    count, joints = len(frames.x), layout.joints
    position, rotation, velocity, relative = (np.empty((count, joints), np.float32) for _ in range(4))
    root, turn, turned = (np.empty(count, np.float32) for _ in range(3))
    right = np.empty((count, layout.contacts), np.bool_)
    phase = getattr(frames, "phase", None)
    for start in range(0, count, CHUNK):
        rows = slice(start, start + CHUNK)
        y = network.evaluate(frames.x[rows], *([] if phase is None else [phase[rows]]))
        real, made = layout.unpack_outputs(frames.y[rows]), layout.unpack_outputs(y)
        apart = np.linalg.norm(made.positions - real.positions, axis=-1)
        position[rows] = 100 * metrics.or_infinite(apart)
        rotation[rows] = np.degrees(metrics.or_infinite(quat.angle_between(real.rotations, made.rotations)))
        velocity[rows] = 100 * np.linalg.norm(made.velocities - real.velocities, axis=-1)
        relative[rows] = metrics.relative_error(real.positions, made.positions)
        root[rows] = 100 * np.linalg.norm(made.root_velocity - real.root_velocity, axis=-1)
        turn[rows] = np.degrees(np.abs(made.turn_rate - real.turn_rate))
        if phase is not None:
            turned[rows] = np.degrees(np.abs(made.phase_rate - real.phase_rate))
        right[rows] = (made.contacts > 0.5) == (real.contacts > 0.5)
    return Step(position, rotation, velocity, relative, root, turn, None if phase is None else turned, right)


def poses(truth: Truth, found: Step) -> dict[str, dict[str, Any]]:
    """Errors of a step by part of the data, as those of `lmm.evaluation.decompressor.pose_errors`, and
    root_velocity_cm_s, root_turn_deg_s, phase_deg_s (means) and contacts, the share that is right."""
    names = truth.database.skeleton.names[1:]
    out = {}
    for part, ranges in truth.parts.items():
        rows = ranges[truth.ranges]
        if not rows.any():
            continue
        errors: dict[str, Any] = {"frames": int(rows.sum())}
        for name in ("position_cm", "rotation_deg", "velocity_cm_s"):
            of_joints = metrics.errors(getattr(found, name)[rows])
            errors[name] = asdict(of_joints) | {"worst_joint": names[of_joints.worst_joint]}
        means = found.position_cm[rows].mean(axis=0, dtype=np.float64)
        errors["joints"] = dict(zip(names, means.tolist(), strict=True))
        errors["root_velocity_cm_s"] = float(found.root_cm_s[rows].mean())
        errors["root_turn_deg_s"] = float(found.turn_deg_s[rows].mean())
        if found.phase_deg_s is not None:
            errors["phase_deg_s"] = float(found.phase_deg_s[rows].mean())
        errors["contacts"] = float(found.contacts[rows].mean()) if found.contacts.shape[1] else float("nan")
        out[part] = errors
    return out


def by_file(truth: Truth, found: Step, joints: Sequence[int] | None = None) -> list[dict[str, Any]]:
    """The thesis's accuracy, a row a range, mirrored copies by themselves as there: file, mirrored, held_out,
    frames, relative and relative_sd (mean and deviation of `Step.relative` over joints and frames), and
    position_cm, the mean. joints, without the ground root, are those that count; all by default."""
    some: Any = slice(None) if joints is None else np.asarray(joints, np.int64)
    database, rows = truth.database, []
    held = truth.parts.get("held_out", np.zeros(len(database.names), bool))
    at = np.searchsorted(truth.ranges, np.arange(len(database.names) + 1))
    for r, (start, stop) in enumerate(zip(at[:-1].tolist(), at[1:].tolist(), strict=True)):
        if start == stop:
            continue
        relative = found.relative[start:stop, some].astype(np.float64)
        rows.append(
            {
                "file": database.names[r],
                "mirrored": bool(database.mirrored[r]),
                "held_out": bool(held[r]),
                "frames": stop - start,
                "relative": float(relative.mean()),
                "relative_sd": float(relative.std()),
                "position_cm": float(found.position_cm[start:stop, some].mean(dtype=np.float64)),
            }
        )
    return rows


def over_files(rows: Sequence[dict[str, Any]]) -> dict[str, float | int]:
    """Mean and deviation over files of their relative errors, as the thesis's Table 5.2 has them."""
    means = np.array([row["relative"] for row in rows])
    return {
        "files": len(means),
        "mean": metrics.mean(means),
        "sd": float(means.std(ddof=1)) if len(means) > 1 else float("nan"),
    }
