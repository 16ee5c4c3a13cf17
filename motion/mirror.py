"""The mirror image of a motion: left and right exchanged, x -> -x in the world.

A mirrored joint takes its twin's transform, seen through the mirror. With M = diag(-1, 1, 1) and G world
rotations, G'_j = M G_twin(j) D_j, where the reflection D_j maps the joint's local frame to its twin's. In
rigs whose frames lie along the world's axes D is M itself; in rigs whose bones all lie along one local axis
it flips another axis. It is found from the bones: D_j maps each bone to the twin's. In local terms

    L'_j = D_p^T L_twin(j) D_j,   x'_j = D_p^T x_twin(j),   p the parent of j,

so no forward kinematics is needed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from . import quat, quat_scalar, root
from .clip import Clip
from .errors import UserError
from .roles import opposite, side_and_rest
from .skeleton import Skeleton

_FLIPS = tuple(np.diag([-1.0 if i == a else 1.0 for i in range(3)]) for a in range(3))
_INVERSION = -np.eye(3)
_M = _FLIPS[0]
# Bones may differ between the sides by this share of their length (people are not symmetric).
_TOLERANCE = 0.2


def mirror(clip: Clip) -> Clip:
    """The clip with left and right exchanged, reflected across the plane x = 0.

    World positions are exactly those of the reflection, so an asymmetric person's bones change sides too,
    also in the skeleton returned. Joints without a twin on the other side keep their local transforms. A
    skeleton of which no joint has a twin is a UserError.
    """
    plan = _plan(clip.skeleton)
    positions, rotations = np.empty_like(clip.positions), np.empty_like(clip.rotations)
    _reflect(
        *(clip.positions, clip.rotations, plan.twins, plan.matched),
        *(plan.frame_above, plan.turn_above, plan.turn, positions, rotations),
    )
    return clip.replace(skeleton=plan.skeleton, positions=positions, rotations=rotations)


class _Plan(NamedTuple):
    """What mirroring needs to know of a skeleton: see the formulas above."""

    twins: NDArray[np.int64]
    matched: NDArray[np.bool_]
    frame_above: NDArray[np.float64]
    turn_above: NDArray[np.floating]
    turn: NDArray[np.floating]
    skeleton: Skeleton


@lru_cache(maxsize=16)  # a database's clips share their skeleton
def _plan(skeleton: Skeleton) -> _Plan:
    twins = pairs(skeleton)
    frames = _frames(skeleton, twins)
    # A reflection D acts on a rotation as the rotation -D does: the signs of a pair cancel.
    turn = quat.from_matrix(-frames)
    above = np.maximum(skeleton.parents, 0)
    frame_above, turn_above = frames[above].transpose(0, 2, 1).copy(), quat.inv(turn[above])
    frame_above[0], turn_above[0] = _M, quat.from_matrix(-_M)
    matched = _matched(skeleton, twins)
    mirrored = _mirror_skeleton(skeleton, twins, matched, frame_above, frames)
    return _Plan(twins, matched, frame_above, turn_above, turn, mirrored)


@numba.njit(cache=True, nogil=True)
def _reflect(positions, rotations, twins, matched, frame_above, turn_above, turn, out_pos, out_rot):
    """x'_j = D_p^T x_twin, L'_j = D_p^T L_twin D_j for matched joints; the others are copied."""
    for t in range(positions.shape[0]):
        for j in range(twins.shape[0]):
            if not matched[j]:
                out_pos[t, j] = positions[t, j]
                out_rot[t, j] = rotations[t, j]
                continue
            k, d = twins[j], frame_above[j]
            x, y, z = positions[t, k, 0], positions[t, k, 1], positions[t, k, 2]
            for i in range(3):
                out_pos[t, j, i] = d[i, 0] * x + d[i, 1] * y + d[i, 2] * z
            a, b, r = turn_above[j], turn[j], rotations[t, k]
            q = quat_scalar.mul((r[0], r[1], r[2], r[3]), (b[0], b[1], b[2], b[3]))
            q = quat_scalar.mul((a[0], a[1], a[2], a[3]), q)
            for i in range(4):
                out_rot[t, j, i] = q[i]


def _mirror_skeleton(
    skeleton: Skeleton,
    twins: NDArray[np.int64],
    matched: NDArray[np.bool_],
    frame_above: NDArray[np.float64],
    frames: NDArray[np.float64],
) -> Skeleton:
    """The skeleton with mirrored bones; the same object where it is symmetric."""
    offsets = np.einsum("jab,jb->ja", frame_above, skeleton.offsets[twins])
    offsets = np.where(matched[:, None], offsets, skeleton.offsets)
    if np.allclose(offsets, skeleton.offsets, rtol=0, atol=1e-5):
        return skeleton
    ends = dict(skeleton.end_sites)
    for j in ends:
        if matched[j] and int(twins[j]) in skeleton.end_sites:
            ends[j] = frames[j].T @ skeleton.end_sites[int(twins[j])]
    return replace(skeleton, offsets=offsets, end_sites=ends)


def pairs(skeleton: Skeleton) -> NDArray[np.int64]:
    """Index of each joint's twin on the other side [J]; joints of the middle are their own twins.

    Twins are told by role, then by name, then by their place under twins. A UserError if there are none.
    """
    twins = np.arange(len(skeleton))
    by_name: dict[tuple[str, ...], dict[str, list[int]]] = {}
    for j, name in enumerate(skeleton.names):
        side, rest = side_and_rest(name)
        if side is not None:
            by_name.setdefault(rest, {}).setdefault(side, []).append(j)
    for sides in by_name.values():
        for a, b in zip(sides.get("left", []), sides.get("right", []), strict=False):
            twins[a], twins[b] = b, a
    for role, j in skeleton.roles.items():
        other = skeleton.roles.get(opposite(role), j)
        if other != j and twins[j] != other:
            for loose in (twins[j], twins[other]):
                twins[loose] = loose
            twins[j], twins[other] = other, j
    _pair_by_place(skeleton, twins)
    if np.all(twins == np.arange(len(skeleton))):
        raise UserError(
            "cannot mirror: no joint has a twin on the other side",
            remedy=f"name roles in a roles file; the joints are {', '.join(skeleton.names)}",
        )
    return twins


def _pair_by_place(skeleton: Skeleton, twins: NDArray[np.int64]) -> None:
    """Pair joints whose names say nothing: the only unpaired children under each of two twins, in order."""
    children: list[list[int]] = [[] for _ in skeleton.names]
    for j in range(1, len(skeleton)):
        children[skeleton.parents[j]].append(j)
    for j in range(len(skeleton)):
        if twins[j] > j:
            a, b = ([c for c in children[k] if twins[c] == c] for k in (j, twins[j]))
            if len(a) == len(b):
                for c, d in zip(a, b, strict=True):
                    twins[c], twins[d] = d, c


def _matched(skeleton: Skeleton, twins: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether a joint's twin hangs from its parent's twin [J]."""
    if twins[0] != 0:
        raise UserError(f"cannot mirror: joint {skeleton.names[0]!r}, the root, is on one side of the body")
    parents = skeleton.parents
    matched = twins[parents] == parents[twins]
    matched[0] = True
    return matched


def _frames(skeleton: Skeleton, twins: NDArray[np.int64]) -> NDArray[np.float64]:
    """The reflections D [J, 3, 3]; D of a joint is the transpose of its twin's.

    One flip of an axis serves nearly every rig as a whole. Elsewhere each joint takes the flip, or on the
    sides the inversion, that maps its bones best; what its bones leave open it takes from its parent.
    """
    owner, bones, twin_bones = _bones(skeleton, twins)
    inner = owner > 0
    fits = [_misfit(d, bones[inner], twin_bones[inner]) for d in _FLIPS]
    usual = _FLIPS[int(np.argmin(fits))]
    frames = np.tile(usual, (len(skeleton), 1, 1))
    if skeleton.roles.get("root") == 0 and skeleton.names[0] == root.NAME:
        frames[0] = _M  # our own ground root faces +Z
    else:
        first = [_misfit(d, bones[~inner], twin_bones[~inner]) for d in (usual, *_FLIPS)]
        frames[0] = (usual, *_FLIPS)[int(np.argmin(np.array(first) > min(first) + 0.02))]
    if min(fits) <= _TOLERANCE:
        return frames
    for j in range(1, len(skeleton)):
        k, mine = int(twins[j]), owner == j
        if k < j:
            frames[j] = frames[k].T
            continue
        above = frames[skeleton.parents[j]] if skeleton.parents[j] > 0 else usual
        choices = [above, usual, *_FLIPS, _INVERSION] if k != j else [usual, *_FLIPS]
        misfits = np.array([_misfit(d, bones[mine], twin_bones[mine]) for d in choices])
        best = int(np.argmin(misfits > misfits.min() + 0.02))
        frames[j] = choices[best]
        if k != j and misfits[best] > _TOLERANCE:
            frames[j] = _align(choices[best], bones[mine], twin_bones[mine])
    return frames


def _bones(
    skeleton: Skeleton, twins: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Every bone that has a twin: the joint it leaves [B], its offset and the twin's offset [B, 3]."""
    parents, offsets = skeleton.parents, skeleton.offsets
    joints = [c for c in range(1, len(skeleton)) if parents[twins[c]] == twins[parents[c]]]
    ends = [j for j in skeleton.end_sites if int(twins[j]) in skeleton.end_sites]
    owner = [*parents[joints], *ends]
    bones = [*offsets[joints], *(skeleton.end_sites[j] for j in ends)]
    twin_bones = [*offsets[twins[joints]], *(skeleton.end_sites[int(twins[j])] for j in ends)]
    return np.array(owner), np.reshape(bones, (-1, 3)), np.reshape(twin_bones, (-1, 3))


def _misfit(d: NDArray[np.float64], bones: NDArray[np.float64], twins: NDArray[np.float64]) -> float:
    """How far d is from mapping bones to their twins, as a share of their lengths; 0 without bones."""
    size = np.linalg.norm(bones) + np.linalg.norm(twins)
    return float(2 * np.linalg.norm(bones @ d.T - twins) / size) if size > 0 else 0.0


def _align(
    prior: NDArray[np.float64], bones: NDArray[np.float64], twins: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The reflection that best maps bones to their twins (Kabsch); what they leave free is the prior's."""
    moment = twins.T @ bones + 0.05 * float((bones**2).sum()) * prior
    u, _, v = np.linalg.svd(moment)
    return u @ np.diag([1.0, 1.0, -np.linalg.det(u @ v)]) @ v
