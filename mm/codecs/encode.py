"""A database's poses as tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion import quat

from ..database import Database
from ..stages import plain, root_steps
from . import keyframes, root, smallest_three
from .codec import Codec
from .tables import Tables, empty

STILL = 1e-5  # metres, or of a quaternion's component: what varies by less is rounding of files


def encode(database: Database, codec: Codec) -> Tables:
    """Tables of a database; key frames that rounding puts farther off than they may be are a UserError."""
    tables = empty(len(database.skeleton), database.fps, codec.bits)._replace(
        contacts=np.packbits(np.asarray(database.contacts).reshape(-1), bitorder="little"),
        starts=plain(database.starts),
        stops=plain(database.stops),
    )
    tables = _rows(database, codec, tables)
    if not codec.recomputed:
        tables = _rates(database, codec, tables)
    if codec.keyframes is not None:
        keys = keyframes.choose(database, tables.having({}), codec.keyframes)
        kept = {
            name: getattr(tables, name)[keys]
            for name in ("floats", "halves", "packed", "translations")
            if len(getattr(tables, name))
        }
        tables = tables.having({"keys": keys} | kept)
    return _root(database, codec, tables).having({})


def _rows(database: Database, codec: Codec, tables: Tables) -> Tables:
    positions, rotations = database.poses.positions[:, 1:], database.poses.rotations[:, 1:]
    if codec.numbers != "quantised":
        rows = np.concatenate([positions, rotations], axis=-1)
        if codec.numbers == "float32":
            return tables._replace(floats=rows)
        return tables._replace(halves=rows.astype(np.float16).view(np.uint16))
    turning = _varying(rotations)
    rest = quat.identity(1 + rotations.shape[1], dtype=np.float32)
    rest[1:] = rotations[0]
    flat = positions.reshape(len(positions), -1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    moving = np.flatnonzero(high - low > STILL)
    scale = ((high.astype(np.float64) - low)[moving] / 65535).astype(np.float32)
    codes = np.rint((flat[:, moving].astype(np.float64) - low[moving]) / scale).clip(0, 65535)
    bones = np.zeros((1 + positions.shape[1], 3), np.float32)
    bones[1:] = ((low + high) / 2).reshape(-1, 3)
    return tables._replace(
        packed=smallest_three.encode(rotations[:, turning], codec.bits),
        turning=(1 + turning).astype(np.int32),
        translations=codes.astype(np.uint16),
        moving=(3 + moving).astype(np.int32),
        offset=low[moving],
        scale=scale,
        bones=bones,
        rest=rest,
    )


def _varying(rotations: NDArray[np.float32]) -> NDArray[np.int64]:
    """Which joints [M] of rotations [T, J, 4] turn at all, by either sign of their quaternions."""
    apart = np.zeros(rotations.shape[1])
    for start in range(0, len(rotations), smallest_three.CHUNK):
        some, first = rotations[start : start + smallest_three.CHUNK], rotations[0]
        sign = np.where((some * first).sum(-1, keepdims=True) < 0, -1, 1)
        np.maximum(apart, np.abs(sign * some - first).max(axis=(0, 2)), out=apart)
    return np.flatnonzero(apart > STILL)


def _rates(database: Database, codec: Codec, tables: Tables) -> Tables:
    poses = database.poses
    rates = np.concatenate([poses.velocities[:, 1:], poses.angular_velocities[:, 1:]], axis=-1)
    if codec.numbers == "float32":
        return tables._replace(rates=rates)
    return tables._replace(half_rates=rates.astype(np.float16).view(np.uint16))


def _root(database: Database, codec: Codec, tables: Tables) -> Tables:
    if codec.numbers == "float32":
        return tables._replace(root=root_steps(database))
    if codec.numbers == "float16":
        return tables._replace(half_root=root.halves(database).view(np.uint16))
    codes, scale = root.coded(database)
    return tables._replace(coded_root=codes, root_scale=scale)
