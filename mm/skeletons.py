"""One skeleton for all clips of a database: whose they share, who must be fitted, or a flat one of roles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from motion import kinematics, quat
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

SAME_BONE = 1e-3  # metres; bones that differ less are measured or rounded otherwise, not other people's


def agree(
    clips: Sequence[Clip], wanted: Skeleton | None, note: Callable[[str], None]
) -> tuple[list[Clip], Skeleton]:
    """The clips that have one skeleton's joints (names and hierarchy), and that skeleton.

    It is the wanted one, or the first clip's. Without a wanted one, clips with other joints are a UserError
    that lists the groups; with one they are left out, which is noted, and a UserError if none remains.
    """
    groups: list[list[Clip]] = []
    for clip in clips:
        for group in groups:
            if group[0].skeleton.same_joints(clip.skeleton):
                group.append(clip)
                break
        else:
            groups.append([clip])
    if wanted is None:
        if len(groups) > 1:
            listing = "; ".join(_describe(group) for group in sorted(groups, key=len, reverse=True))
            raise UserError(
                f"the clips have {len(groups)} different skeletons: {listing}",
                remedy="name clips of one of them, or choose it with --skeleton FILE (any clip that has it), "
                "or ignore skeletons with --roles-only",
            )
        return list(clips), clips[0].skeleton
    kept = [clip for clip in clips if clip.skeleton.same_joints(wanted)]
    for group in groups:
        if not group[0].skeleton.same_joints(wanted):
            note(f"left out {_describe(group)}: {_difference(group[0].skeleton, wanted)}")
    if not kept:
        raise UserError(
            f"no clip has the skeleton's {len(wanted)} joints: {_difference(clips[0].skeleton, wanted)}",
            path=clips[0].source,
            remedy="give --skeleton a file with the clips' joints",
        )
    return kept, wanted


def _describe(group: Sequence[Clip]) -> str:
    count = f"{len(group)} clips" if len(group) > 1 else "1 clip"
    first = group[0]
    return f"{count} with {len(first.skeleton)} joints, such as {first.source or first.name}"


def _difference(found: Skeleton, wanted: Skeleton) -> str:
    lacking = [name for name in wanted.names if name not in found.names]
    extra = [name for name in found.names if name not in wanted.names]
    parts = []
    for what, names in (("lacks", lacking), ("has also", extra)):
        if names:
            parts.append(f"{what} {', '.join(names[:4])}{f' and {len(names) - 4} more' * (len(names) > 4)}")
    return " and ".join(parts) or "its joints stand in another order or hierarchy"


def differs(clip: Clip, target: Skeleton) -> bool:
    """Whether bones differ in length or rest direction, those aside that carry the body through the world."""
    bones = clip.positions[0] - target.offsets  # a file's offsets may be stale where channels replace them
    carrying = target.chain(target.roles.get("hips", 0))
    bones[carrying] = 0
    return bool(np.any(np.abs(bones) > SAME_BONE))


def at_rest(skeleton: Skeleton, poses: Poses) -> Skeleton:
    """The skeleton of a database, whose joints from the root to the hips rest at their mean place."""
    offsets = skeleton.offsets.copy()
    for joint in skeleton.chain(skeleton.roles.get("hips", 0)):
        offsets[joint] = poses.positions[:, joint].mean(axis=0, dtype=np.float64) if joint else 0
    return replace(skeleton, offsets=offsets)


def flat(roles: Sequence[str]) -> Skeleton:
    """The flat skeleton of roles: the root, and every role's joint as its child."""
    names = tuple(dict.fromkeys(("root", *roles)))
    parents = np.array([-1] + [0] * (len(names) - 1), np.int32)
    return Skeleton(names, parents, np.zeros((len(names), 3)), {role: j for j, role in enumerate(names)})


def flatten(skeleton: Skeleton, poses: Poses, target: Skeleton) -> Poses:
    """Poses under a ground root on the flat skeleton of some of their roles; their features stay the same.

    In the root's frame, R its rotation: x' = R^-1 (x - x_0), v' = R^-1 (v - v_0 - w_0 x (x - x_0)),
    w' = R^-1 (w - w_0). A role that the skeleton lacks is a UserError.
    """
    joints = [skeleton.role(role) for role in target.names]
    world = kinematics.forward_velocities(skeleton, *(a.astype(np.float64) for a in poses.arrays().values()))
    x, q, v, w = (array[:, joints] for array in world)
    back, arm = quat.inv(q[:, :1]), x - x[:, :1]
    local = Poses(
        quat.rotate(back, arm),
        quat.mul(back, q),
        quat.rotate(back, v - v[:, :1] - np.cross(w[:, :1], arm)),
        quat.rotate(back, w - w[:, :1]),
    )
    for array, root in zip(local.arrays().values(), (x, q, v, w), strict=True):
        array[:, 0] = root[:, 0]
    local.rotations = quat.unroll(local.rotations)
    return Poses(*(array.astype(np.float32) for array in local.arrays().values()))
