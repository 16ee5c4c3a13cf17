"""From poses to feature vectors: every column of a schema for every frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import quat
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

from . import custom
from .context import Context, Samples
from .schema import Feature, Schema

Array = NDArray[np.floating]

CHUNK = 4096  # frames at a time: what they need stays in the cache, and memory bounded


def extract(
    schema: Schema, skeleton: Skeleton, fps: float, poses: Poses, starts: ArrayLike, stops: ArrayLike
) -> NDArray[np.float32]:
    """Raw features (not normalised), float32 [T, F], columns as `schema.columns`.

    Ranges starts [R], stops [R] (exclusive) cover the T frames one after the other. No feature crosses
    ranges: trajectory samples beyond a range's end are what `Feature.beyond` says. A sample time between two
    frames is interpolated between them, so a schema means the same at any frame rate. Joint velocities are
    the world's in the root's frame, as REFERENCE 2.2's public implementation has them.

    A role that the skeleton lacks, an unregistered custom function or one that answers with another shape or
    with numbers that are not finite is a UserError.
    """
    check_roles(schema, skeleton)
    raw = np.empty((len(poses), schema.size), np.float32)
    samples = Samples(poses, fps, starts, stops)
    for begin in range(0, len(poses), CHUNK):
        part = slice(begin, min(begin + CHUNK, len(poses)))
        context = Context(skeleton, poses, samples, part)
        for feature in schema.features:
            block = raw[part, schema.slices[feature.name]]
            block[...] = _block(feature, context)
            if not np.isfinite(block).all():
                frame = begin + int(np.flatnonzero(~np.isfinite(block).all(axis=1))[0])
                what = f"schema {schema.name!r}, feature {feature.name!r} is not finite at frame {frame}"
                raise UserError(what, remedy="is a clip's unit or frame rate wrong?")
    return raw


def check_roles(schema: Schema, skeleton: Skeleton) -> None:
    """A role that the schema names and the skeleton lacks is a UserError with feature, role and joints."""
    for feature in schema.features:
        if feature.role is not None:
            try:
                skeleton.role(feature.role)
            except UserError as error:
                what = f"schema {schema.name!r}, feature {feature.name!r}: {error.what}"
                raise UserError(what, remedy=error.remedy) from error


_AXES = dict(zip("xyz", np.eye(3, dtype=np.float32), strict=True))


def _block(feature: Feature, context: Context) -> Array:
    """A feature's columns for a context's frames, [n, k]."""
    match feature.kind:
        case "position":
            return context.position(str(feature.role))
        case "velocity":
            return context.velocity(str(feature.role))
        case "angular_velocity":
            return context.angular_velocity(str(feature.role))
        case "height":
            return context.position(str(feature.role))[:, 1:2]
        case "heading":
            return _heading(context.rotation(str(feature.role)), feature.axis)
        case "trajectory_position":
            return context.trajectory_positions(feature.times, feature.beyond).reshape(len(context), -1)
        case "trajectory_direction":
            return context.trajectory_directions(feature.times, feature.beyond).reshape(len(context), -1)
        case _:
            return _custom(feature, context)


def _heading(rotation: Array, axis: str) -> Array:
    """x, z of an axis of the joint, on the ground plane and of unit length; 0 where it points up or down."""
    own = _AXES[axis[1]] * (-1 if axis[0] == "-" else 1)
    forward = quat.rotate(rotation, np.broadcast_to(own.astype(rotation.dtype), (*rotation.shape[:-1], 3)))[
        :, ::2
    ]
    length = np.linalg.norm(forward, axis=-1, keepdims=True)
    return forward / np.where(length > 1e-6, length, np.inf)


def _custom(feature: Feature, context: Context) -> Array:
    columns: Any = np.asarray(custom.find(str(feature.function)).function(context))
    expected = (len(context), len(feature.columns))
    if columns.shape != expected:
        raise UserError(
            f"custom feature {feature.name!r} returned shape {columns.shape}, expected {expected}",
            remedy=f"return one row a frame with the columns {', '.join(feature.columns)}",
        )
    if not np.all(np.isfinite(columns)):
        frame = context.frames.start + int(np.argmin(np.all(np.isfinite(columns), axis=1)))
        raise UserError(f"custom feature {feature.name!r} is not finite at frame {frame}")
    return columns
