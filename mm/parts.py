"""What a database is put together from, whether built from clips or imported."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from features import extract, normalise
from features.schema import Schema
from motion import contacts
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton, listed


def compute_features(
    schema: Schema,
    skeleton: Skeleton,
    fps: float,
    poses: Poses,
    starts: NDArray[np.int32],
    stops: NDArray[np.int32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Normalised features [T, F], offset [F] and scale [F] of poses in ranges."""
    raw = extract.extract(schema, skeleton, fps, poses, starts, stops)
    offset, scale = normalise.fit(schema, raw)
    return normalise.normalise(raw, offset, scale), offset, scale


def contact_roles(skeleton: Skeleton, positions: NDArray | None = None) -> tuple[str, ...]:
    """The joints that touch the ground (see `motion.contacts.contact_roles`), none where no role tells."""
    try:
        return contacts.contact_roles(skeleton, positions)
    except UserError:
        return ()


def check_roles(schema: Schema, skeleton: Skeleton, path: str | os.PathLike[str] | None) -> None:
    """A role that a feature names and no joint plays is a UserError with file, feature, role and joints."""
    for feature in schema.features:
        if feature.role in (None, "root") or feature.role in skeleton.roles:
            continue
        raise UserError(
            f"feature {feature.name!r} of schema {schema.name!r} needs the role {feature.role!r}, "
            f"which no joint plays (joints: {listed(skeleton.names)})",
            path=path,
            remedy=f'name the joint in a file for --roles: [roles] {feature.role} = "..."',
        )
