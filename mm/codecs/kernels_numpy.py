"""The obvious twin of `mm.codecs.kernels`: the same over all frames at once, for the tests to compare."""

from __future__ import annotations

import numpy as np

from motion import kinematics, quat

from . import smallest_three


def rows(places, tables, joints):
    """Positions [N, J, 3] and rotations [N, J, 4] of stored rows [N]; the root stays at the origin."""
    positions = np.zeros((len(places), joints, 3), np.float32)
    rotations = quat.identity(len(places), joints, dtype=np.float32)
    for stored in (tables.floats, tables.halves.view(np.float16)):
        if len(stored):
            values = stored[places].astype(np.float32)
            positions[:, 1:], rotations[:, 1:] = values[..., :3], values[..., 3:]
            if stored.dtype == np.float16:
                rotations[:, 1:] = quat.normalize(rotations[:, 1:])
            return positions, rotations
    positions[:, 1:], rotations[:, 1:] = tables.bones[1:], tables.rest[1:]
    flat = positions.reshape(len(places), -1)
    flat[:, tables.moving] = tables.offset + tables.scale * tables.translations[places].astype(np.float32)
    unpacked = smallest_three.decode(tables.packed[places], len(tables.turning), tables.bits)
    rotations[:, tables.turning] = unpacked
    return positions, rotations


def places(frames, tables, joints):
    """Positions and rotations of frames [N]."""
    if not len(tables.keys):
        return rows(frames, tables, joints)
    k = np.searchsorted(tables.keys, frames, side="right") - 1
    first, last = tables.keys[k], tables.keys[np.minimum(k + 1, len(tables.keys) - 1)]
    share = ((frames - first) / np.maximum(last - first, 1)).astype(np.float32)[:, None, None]
    (p, q), (to_p, to_q) = (
        rows(k, tables, joints),
        rows(np.minimum(k + 1, len(tables.keys) - 1), tables, joints),
    )
    to_q = np.where((q * to_q).sum(-1, keepdims=True) < 0, -to_q, to_q)
    return (1 - share) * p + share * to_p, quat.normalize((1 - share) * q + share * to_q)


def decode(frames, tables, spare_positions, spare_rotations,
           positions, rotations, velocities, angular, contacts):  # fmt: skip
    """See `mm.codecs.kernels.decode`."""
    joints = positions.shape[1]
    positions[:], rotations[:] = places(frames, tables, joints)
    stored = tables.rates if len(tables.rates) else tables.half_rates.view(np.float16)
    if len(stored):
        velocities[:, 1:], angular[:, 1:] = stored[frames, :, :3], stored[frames, :, 3:]
    else:
        for n, frame in enumerate(frames):
            r = np.searchsorted(tables.starts, frame, side="right") - 1
            whole = np.arange(tables.starts[r], tables.stops[r])
            # Rates reach no farther than four frames, and those at the ends are not those within.
            near = whole[max(0, frame - whole[0] - 4) : frame - whole[0] + 5]
            p, q = places(near, tables, joints)
            velocities[n] = kinematics.velocities(p, tables.fps)[frame - near[0]]
            angular[n] = kinematics.angular_velocities_numpy(q, tables.fps)[frame - near[0]]
    if len(tables.coded_root):
        root = tables.coded_root[frames] * tables.root_scale
    else:
        root = (tables.root if len(tables.root) else tables.half_root.view(np.float16))[frames]
    root = root.astype(np.float32)
    nothing = np.zeros(len(frames))
    positions[:, 0] = np.stack([root[:, 0], nothing, root[:, 1]], axis=-1)
    rotations[:, 0] = quat.from_yaw(root[:, 2])
    velocities[:, 0] = np.stack([root[:, 3], nothing, root[:, 4]], axis=-1)
    angular[:, 0] = np.stack([nothing, root[:, 5], nothing], axis=-1)
    feet = contacts.shape[1]
    every = np.unpackbits(tables.contacts, bitorder="little")
    contacts[:] = every[np.asarray(frames, np.int64)[:, None] * feet + np.arange(feet)]
