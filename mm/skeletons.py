"""One skeleton for all clips of a database: whose they share, who must be fitted, or a flat one of roles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from motion import kinematics
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton

SAME_BONE = 1e-4  # metres; bones that differ less are rounded differently, not longer


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


def differs(skeleton: Skeleton, target: Skeleton) -> bool:
    """Whether bones differ in length or rest direction, the root's own place aside."""
    return bool(np.any(np.abs(skeleton.offsets[1:] - target.offsets[1:]) > SAME_BONE))


def flat(roles: Sequence[str]) -> tuple[str, ...]:
    """Joint names of the flat skeleton of roles: the root, and the roles as its children."""
    return tuple(dict.fromkeys(("root", *roles)))


def flatten(clip: Clip, roles: Sequence[str]) -> Clip:
    """A grounded clip on the flat skeleton of some roles: every role's joint is a child of the root.

    Features are the same as on the whole skeleton; clips of any skeletons that have these roles get one.
    A role that the skeleton lacks is a UserError.
    """
    names = flat(roles)
    joints = [clip.skeleton.role(role) for role in names]
    parents = np.array([-1] + [0] * (len(names) - 1), np.int32)
    star = Skeleton(names, parents, np.zeros((len(names), 3)), {role: j for j, role in enumerate(names)})
    world_positions, world_rotations = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    positions, rotations = kinematics.local(star, world_positions[:, joints], world_rotations[:, joints])
    offsets = positions.mean(axis=0)
    offsets[0] = 0
    star = Skeleton(names, parents, offsets, star.roles)
    return clip.replace(skeleton=star, positions=positions, rotations=rotations)
