"""How far what is decoded is from what was encoded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import kinematics, quat, springs
from motion.pose import Poses
from motion.skeleton import Skeleton

from ..database import Database
from . import root
from .compressed import CHUNK, Compressed


def measure(database: Database, compressed: Compressed) -> dict[str, Any]:
    """Errors of a compressed database against the one that it was made from.

    position_cm, rotation_deg, velocity_cm_s : mean, p99 and max over frames and joints. Positions and
        velocities are those in the ground root's space, rotations those local to the parents.
    root_cm, root_deg : the farthest that the ground root, its steps followed from the beginning of a clip, is
        from its way, and from where it faced.
    features_deviations : mean, p99 and max over frames and columns that vary, in standard deviations.
    contacts_wrong : share of the contacts that differ.
    """
    found: dict[str, list[NDArray]] = {"position_cm": [], "rotation_deg": [], "velocity_cm_s": []}
    steps, wrong = np.empty((len(database), 3)), 0
    for start in range(0, len(database), CHUNK):
        piece = slice(start, min(start + CHUNK, len(database)))
        poses, contacts = compressed.decode(np.arange(piece.start, piece.stop, dtype=np.int32))
        truth = database.poses[piece]
        turns = quat.yaw(poses.rotations[:, 0].astype(np.float64))
        steps[piece] = np.column_stack([poses.positions[:, 0, [0, 2]], turns])
        wrong += int(np.count_nonzero(contacts != database.contacts[piece]))
        ours, theirs = (_moving(database.skeleton, p) for p in (poses, truth))
        found["position_cm"].append(100 * np.linalg.norm(ours[0] - theirs[0], axis=-1))
        found["velocity_cm_s"].append(100 * np.linalg.norm(ours[1] - theirs[1], axis=-1))
        rotations = (quat.normalize(p.rotations[:, 1:].astype(np.float64)) for p in (poses, truth))
        found["rotation_deg"].append(np.degrees(quat.angle_between(*rotations)))
    errors: dict[str, Any] = {name: _spread(np.concatenate(values)) for name, values in found.items()}
    way = root.follow(steps, compressed.origins, database.starts, database.stops)
    off = way - root.path(database)
    errors["root_cm"] = float(100 * np.hypot(off[:, 0], off[:, 1]).max())
    errors["root_deg"] = float(np.degrees(np.abs(springs.wrap(off[:, 2])).max()))
    deviations = database.features.std(axis=0, dtype=np.float64)
    vary = deviations > 1e-6
    apart = np.abs(compressed.features[:, vary] - database.features[:, vary]) / deviations[vary]
    errors["features_deviations"] = _spread(apart)
    errors["contacts_wrong"] = wrong / max(1, database.contacts.size)
    return errors


def _moving(skeleton: Skeleton, poses: Poses) -> tuple[NDArray, NDArray]:
    """Positions and velocities [T, J - 1, 3] of the joints, seen from the root, which stands still."""
    parts = [array.astype(np.float64) for array in poses.arrays().values()]
    parts[0][:, 0], parts[1][:, 0], parts[2][:, 0], parts[3][:, 0] = 0, [1, 0, 0, 0], 0, 0
    positions, _, velocities, _ = kinematics.forward_velocities(skeleton, *parts)
    return positions[:, 1:], velocities[:, 1:]


def _spread(values: NDArray) -> dict[str, float]:
    if not values.size:
        return {"mean": 0.0, "p99": 0.0, "max": 0.0}
    return {
        "mean": float(values.mean()),
        "p99": float(np.percentile(values, 99)),
        "max": float(values.max()),
    }
