"""How true the poses are that the Decompressor makes of true features and latents."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmm.model import Model
from mm import metrics, quality
from mm.database import Database
from motion import quat
from motion.pose import Poses
from motion.skeleton import Skeleton

Array = NDArray[np.floating]

CHUNK = 4096


def pose_errors(
    true_positions: Array,
    true_rotations: Array,
    positions: Array,
    rotations: Array,
    skeleton: Skeleton,
    *,
    fps: float,
    starts: ArrayLike = (),
) -> dict[str, Any]:
    """Errors of local poses [T, J, ...] against true ones, joint 0, the ground root, aligned (REFERENCE 6).

    position_cm after forward kinematics, rotation_deg of the joints' own rotations, velocity_cm_s of finite
    differences of the positions: each mean, std and p99 over frames and joints, the mean of the worst joint
    and its name. joints: each one's mean position error. A position that is no number is infinitely far off.
    starts: frames that begin a clip.
    """
    joints = skeleton.names[1:]
    truth, found = (
        _aligned(skeleton, true_positions, true_rotations),
        _aligned(skeleton, positions, rotations),
    )
    apart = metrics.or_infinite(100 * np.linalg.norm(found - truth, axis=-1))
    measured = {
        "position_cm": metrics.errors(apart),
        "rotation_deg": metrics.rotation_error(true_rotations[:, 1:], rotations[:, 1:]),
    }
    if len(truth) > len(np.unique(starts)):
        measured["velocity_cm_s"] = metrics.velocity_error(truth, found, fps, starts=starts)
    named: dict[str, Any] = {
        name: asdict(errors) | {"worst_joint": joints[errors.worst_joint]}
        for name, errors in measured.items()
    }
    return named | {"joints": dict(zip(joints, apart.mean(axis=0).tolist(), strict=True))}


def _aligned(skeleton: Skeleton, positions: Array, rotations: Array) -> NDArray[np.float32]:
    """Positions [T, J-1, 3] in the root's space, in pieces, since in double precision all at once are big."""
    out = np.empty((len(positions), len(skeleton) - 1, 3), np.float32)
    for start in range(0, len(out), CHUNK):
        part = slice(start, start + CHUNK)
        out[part] = quality.in_root_space(skeleton, positions[part], rotations[part])
    return out


def decompress(model: Model, states: Array) -> tuple[Poses, NDArray[np.uint8]]:
    """Poses [N] and contacts [N, C] of states [N, F + L]: features and latents."""
    joints, feet = len(model.description.skeleton), len(model.description.contact_roles)
    poses, contacts = Poses.empty(len(states), joints), np.empty((len(states), feet), np.uint8)
    for start in range(0, len(states), CHUNK):
        part = slice(start, start + CHUNK)
        vectors = model.decompressor.evaluate(states[part])
        found, contacts[part] = model.layout.unpack(vectors, model.description.fps)
        for mine, its in zip(poses.arrays().values(), found.arrays().values(), strict=True):
            mine[part] = its
    return poses, contacts


def errors(
    model: Model, database: Database, latents: Array | None = None, *, ranges: ArrayLike | None = None
) -> dict[str, Any]:
    """Errors of compressor and decompressor over some ranges (a mask [R]; all by default): `pose_errors`,
    root_velocity_cm_s, root_turn_deg_s (means) and contacts, the share that is right.

    latents [T, L] of the database's frames where they are known already.
    """
    chosen = np.ones(len(database.starts), bool) if ranges is None else np.asarray(ranges, bool)
    frames = np.flatnonzero(chosen[database.ranges()])
    latents = model.latents(database) if latents is None else latents
    poses, contacts = decompress(model, np.concatenate([database.features, latents], axis=1)[frames])
    truth = database.poses[frames]
    lengths = (database.stops - database.starts)[chosen]
    found = pose_errors(
        truth.positions,
        truth.rotations,
        poses.positions,
        poses.rotations,
        database.skeleton,
        fps=database.fps,
        starts=np.cumsum(lengths) - lengths,
    )
    back = quat.inv(np.asarray(truth.rotations[:, 0], np.float64))
    velocity = quat.rotate(back, np.asarray(truth.velocities[:, 0], np.float64))[:, [0, 2]]
    missed = np.linalg.norm(poses.velocities[:, 0][:, [0, 2]] - velocity, axis=-1)
    turned = np.abs(poses.angular_velocities[:, 0, 1] - truth.angular_velocities[:, 0, 1])
    return {"frames": len(frames), **found} | {
        "root_velocity_cm_s": float(100 * missed.mean()),
        "root_turn_deg_s": float(np.degrees(turned.mean())),
        "contacts": metrics.mean(contacts == database.contacts[frames]),
    }
