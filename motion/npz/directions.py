"""Rotations of joints from their places alone.

Places say where bones point, not how they are turned about themselves. A joint with bones in several
directions is turned as fits them best (Wahba's problem, solved as in Kabsch, "A solution for the best
rotation to relate two sets of vectors", 1976). A joint with one bone turns as its parent does and then by the
smallest rotation that makes the bone point where it does, so with the least twist. A joint without bones
turns as its parent does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import kinematics, quat
from ..skeleton import Skeleton

Array = NDArray[np.float64]

_FLAT = 0.1  # sine of the angle that bones must span to tell how a joint is turned


def rest_offsets(parents: NDArray[np.int32], world: Array) -> Array:
    """Offsets [J, 3] of a rest pose for places [T, J, 3]: the middle frame's, bones of median length."""
    bones = world[:, 1:] - world[:, parents[1:]]
    middle, lengths = bones[len(bones) // 2], np.linalg.norm(bones, axis=-1)
    scale = np.median(lengths, axis=0) / np.maximum(lengths[len(bones) // 2], 1e-12)
    return np.concatenate([world[len(world) // 2, :1], middle * scale[:, None]])


def recover(skeleton: Skeleton, world: Array) -> tuple[Array, Array]:
    """Local positions [T, J, 3] and rotations [T, J, 4] that put the joints at world [T, J, 3], exactly.

    The rotations turn the skeleton's offsets to the bones' directions; what bones miss in length stays in the
    positions.
    """
    children: list[list[int]] = [[] for _ in skeleton.names]
    for j, parent in enumerate(skeleton.parents[1:].tolist(), 1):
        children[parent].append(j)
    turned = quat.identity(len(world), len(skeleton))
    for j, own in enumerate(children):
        parent = int(skeleton.parents[j])
        before = turned[:, parent] if parent >= 0 else turned[:, 0]
        rest = skeleton.offsets[own]
        solid = np.linalg.norm(rest, axis=-1) > 1e-9
        rest, own = rest[solid], [c for c, good in zip(own, solid, strict=True) if good]
        if not own:
            turned[:, j] = before
            continue
        bones = world[:, own] - world[:, j : j + 1]
        if _spans(rest):
            turned[:, j] = _best(rest, bones)
            continue
        # Bones along one line: the longest speaks for all.
        longest = int(np.argmax(np.linalg.norm(rest, axis=-1)))
        carried, bone = (
            quat.rotate(before, np.broadcast_to(rest[longest], bones[:, 0].shape)),
            bones[:, longest],
        )
        length = np.linalg.norm(bone, axis=-1, keepdims=True)
        bone = np.where(length > 1e-9, bone, carried)
        turned[:, j] = quat.mul(quat.between(carried, bone), before)
    positions, rotations = kinematics.local(skeleton, np.ascontiguousarray(world), turned)
    return positions, kinematics.unroll(rotations)


def _spans(rest: Array) -> bool:
    """Whether directions span a plane."""
    if len(rest) < 2:
        return False
    unit = rest / np.linalg.norm(rest, axis=-1, keepdims=True)
    return bool(np.linalg.svd(unit, compute_uv=False)[1] > _FLAT)


def _best(rest: Array, bones: Array) -> Array:
    """Rotations [T, 4] that turn directions rest [C, 3] to those of bones [T, C, 3] as nearly as can be."""
    unit = rest / np.linalg.norm(rest, axis=-1, keepdims=True)
    length = np.linalg.norm(bones, axis=-1, keepdims=True)
    moment = np.swapaxes(bones / np.maximum(length, 1e-12), -1, -2) @ unit
    u, _, v = np.linalg.svd(moment)
    u[..., 2] *= np.linalg.det(u @ v)[..., None]
    return np.asarray(quat.from_matrix(u @ v), np.float64)
