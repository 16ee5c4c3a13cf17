"""The mirror image of a motion: left and right exchanged, x -> -x in the world.

A mirrored joint takes its twin's transform, seen through the mirror. With M = diag(-1, 1, 1) and G world
rotations, G'_j = M G_twin(j) D_j, where the reflection D_j maps the joint's local frame to its twin's. In
rigs whose frames lie along the world's axes D is M itself; in rigs whose bones all lie along one local axis
it flips another axis. In local terms

    L'_j = D_p^T L_twin(j) D_j,   x'_j = D_p^T x_twin(j),   p the parent of j.

Any D gives the right positions. It is found from the bones, which it should map to the twin's, and from the
motion, as the bones leave choices (a straight one fits two flips): a mirrored joint should turn about where
the joint itself does, or else a blend from the one to the other goes through half a turn. So D_j should be
close to the mean over frames of L_twin^T D_p L_j, here called the joint's moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from . import kinematics, quat, quat_scalar, root
from .clip import Clip
from .errors import UserError
from .roles import opposite, side_and_rest
from .skeleton import Skeleton

_FLIPS = tuple(np.diag([-1.0 if i == a else 1.0 for i in range(3)]) for a in range(3))
_INVERSION = -np.eye(3)
_M = _FLIPS[0]
# Bones may differ between the sides by this share of their length (people are not symmetric).
_TOLERANCE = 0.2
# A share by which bones are missed weighs as much as this in the product of a choice and the moment, which
# goes from -1 to 3. End sites often are only stubs that a converter made up.
_BONES_WEIGH, _ENDS_WEIGH = 10.0, 1.0
_SAMPLE = 2000  # frames, over all clips: only means are taken of them


class Plan(NamedTuple):
    """How the joints of a skeleton are mirrored: see the formulas above."""

    twins: NDArray[np.int64]
    matched: NDArray[np.bool_]
    frames: NDArray[np.float64]
    frame_above: NDArray[np.float64]
    turn_above: NDArray[np.floating]
    turn: NDArray[np.floating]


def mirror(clip: Clip, plan: Plan | None = None) -> Clip:
    """The clip with left and right exchanged, reflected across the plane x = 0.

    World positions are exactly those of the reflection, so an asymmetric person's bones change sides too,
    also in the skeleton returned. Joints without a twin on the other side keep their local transforms. A
    skeleton of which no joint has a twin is a UserError. Clips that are used together need one `plan`, made
    of all of them (see `plans`); the default is made of this clip alone.
    """
    plan = plans([clip])[0] if plan is None else plan
    positions, rotations = np.empty_like(clip.positions), np.empty_like(clip.rotations)
    _reflect(
        *(clip.positions, clip.rotations, plan.twins, plan.matched),
        *(plan.frame_above, plan.turn_above, plan.turn, positions, rotations),
    )
    return clip.replace(
        skeleton=_mirror_skeleton(clip.skeleton, plan), positions=positions, rotations=rotations
    )


def plans(clips: Sequence[Clip]) -> list[Plan]:
    """A plan for each clip; clips of the same joints and roles share one, made of some frames of them all."""
    groups: dict[tuple, list[Clip]] = {}
    keys = [
        (clip.skeleton.names, clip.skeleton.parents.tobytes(), tuple(clip.skeleton.roles.items()))
        for clip in clips
    ]
    for key, clip in zip(keys, clips, strict=True):
        groups.setdefault(key, []).append(clip)
    made = {key: _plan(group) for key, group in groups.items()}
    return [made[key] for key in keys]


def _plan(clips: Sequence[Clip]) -> Plan:
    skeleton = clips[0].skeleton
    twins = pairs(skeleton)
    matched = _matched(skeleton, twins)
    frames = _frames(clips, twins)
    # A reflection D acts on a rotation as the rotation -D does: the signs of a pair cancel.
    turn = quat.from_matrix(-frames)
    above = np.maximum(skeleton.parents, 0)
    frame_above, turn_above = frames[above].transpose(0, 2, 1).copy(), quat.inv(turn[above])
    frame_above[0], turn_above[0] = _M, quat.from_matrix(-_M)
    return Plan(twins, matched, frames, frame_above, turn_above, turn)


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


def _mirror_skeleton(skeleton: Skeleton, plan: Plan) -> Skeleton:
    """The skeleton with mirrored bones; the same object where it is symmetric."""
    twins, matched = plan.twins, plan.matched
    offsets = np.einsum("jab,jb->ja", plan.frame_above, skeleton.offsets[twins])
    offsets = np.where(matched[:, None], offsets, skeleton.offsets)
    if np.allclose(offsets, skeleton.offsets, rtol=0, atol=1e-5):
        return skeleton
    ends = dict(skeleton.end_sites)
    for j in ends:
        if matched[j] and int(twins[j]) in skeleton.end_sites:
            ends[j] = plan.frames[j].T @ skeleton.end_sites[int(twins[j])]
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


def _frames(clips: Sequence[Clip], twins: NDArray[np.int64]) -> NDArray[np.float64]:
    """The reflections D [J, 3, 3]; D of a joint is the transpose of its twin's.

    A joint takes the flip of an axis, or on the sides the inversion, that fits its bones and its moment best.
    Where none maps the bones, as in rigs whose frames are no mirror images, it takes the best of all
    reflections.
    """
    skeleton = clips[0].skeleton
    owner, bones, twin_bones = _bones(skeleton, twins)
    inner = np.isin(np.arange(len(skeleton)), skeleton.parents)
    local = _sample(clips)
    frames = np.tile(_M, (len(skeleton), 1, 1))  # our own ground root faces +Z
    for j in range(len(skeleton)):
        k, mine = int(twins[j]), owner == j
        if k < j:
            frames[j] = frames[k].T
            continue
        if j > 0:
            moment = _moment(local[:, k], frames[skeleton.parents[j]], local[:, j])
        elif skeleton.roles.get("root") == 0 and skeleton.names[0] == root.NAME:
            continue
        else:
            moment = _moment(local[:, 0], _planes(clips, twins), local[:, 0])
        choices = [*_FLIPS, _INVERSION] if k != j else [*_FLIPS]
        misfits = np.array([_misfit(d, bones[mine], twin_bones[mine]) for d in choices])
        weight = _BONES_WEIGH if inner[j] else _ENDS_WEIGH
        best = int(np.argmax(np.sum(choices * moment, axis=(1, 2)) - weight * misfits))
        frames[j] = choices[best]
        if inner[j] and misfits[best] > _TOLERANCE:
            frames[j] = _align(moment, bones[mine], twin_bones[mine], middle=k == j)
    return frames


def _sample(clips: Sequence[Clip]) -> NDArray[np.float64]:
    """Local rotations [S, J, 3, 3] at some frames of each clip."""
    step = _step(clips)
    return quat.to_matrix(np.concatenate([clip.rotations[::step] for clip in clips]))


def _step(clips: Sequence[Clip]) -> int:
    return max(1, sum(map(len, clips)) // _SAMPLE)


def _moment(twin: NDArray, above: NDArray, own: NDArray) -> NDArray[np.float64]:
    """Mean over frames of L_twin^T D_p L_j; D_p [3, 3] or [S, 3, 3]."""
    return (twin.transpose(0, 2, 1) @ above @ own).mean(axis=0)


def _planes(clips: Sequence[Clip], twins: NDArray[np.int64]) -> NDArray[np.float64]:
    """Reflections [S, 3, 3] in the body's own plane at the frames of `_sample`, for joint 0 moves anywhere.

    They are across the mean direction between twins that hang from the middle.
    """
    skeleton = clips[0].skeleton
    parents, joints, step = skeleton.parents, np.arange(len(skeleton)), _step(clips)
    a = [j for j in joints[1:] if twins[j] > j and parents[j] == twins[parents[j]]]
    a = a or [j for j in joints if twins[j] > j]
    positions = np.concatenate([clip.positions[::step] for clip in clips])
    rotations = np.concatenate([clip.rotations[::step] for clip in clips])
    world, _ = kinematics.forward(skeleton, positions, rotations)
    across = world[:, a] - world[:, twins[a]]
    across *= np.where(np.sum(across * across[:, :1], axis=-1, keepdims=True) < 0, -1, 1)
    normal = across.sum(axis=1)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(size > 1e-9, normal / np.maximum(size, 1e-9), [1.0, 0.0, 0.0])
    return np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]


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
    moment: NDArray[np.float64], bones: NDArray[np.float64], twins: NDArray[np.float64], *, middle: bool
) -> NDArray[np.float64]:
    """The reflection that best maps bones to their twins and agrees with a joint's moment (Kabsch).

    A joint of the middle is its own twin, so its reflection must be its own inverse: one in a plane.
    """
    total = twins.T @ bones / max(float((bones**2).sum()), 1e-12) + 0.1 * moment
    if middle:
        normal = np.linalg.eigh(total + total.T)[1][:, 0]
        return np.eye(3) - 2 * np.outer(normal, normal)
    u, _, v = np.linalg.svd(total)
    return u @ np.diag([1.0, 1.0, -np.linalg.det(u @ v)]) @ v
