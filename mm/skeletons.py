"""One skeleton for all clips of a database: who has it, who is fitted or retargeted to it; or a flat one."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from motion import anatomy, kinematics, quat, subset
from motion.anatomy import Anatomy
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.retarget import plan, retarget
from motion.skeleton import Skeleton

from .intake import Piece, Report

BUILT_IN = ("dancecard",)
SAME_BONE = 1e-3  # metres; bones that differ less are measured or rounded otherwise, not other people's


def built_in(name: str) -> Clip:
    """Some motion on a skeleton that this program brings along; another name is a UserError."""
    if name not in BUILT_IN:
        raise UserError(f"no built-in skeleton {name!r}", remedy=f"choose from {', '.join(BUILT_IN)}")
    from motion import dancecard

    return dancecard.generate(10.0)[0].clip


@dataclass(frozen=True, eq=False)
class Target:
    """The skeleton of a database, and how clips come onto it.

    Attributes
    ----------
    skeleton : it.
    body : how its joints sit in the body; None where no clip is retargeted.
    """

    skeleton: Skeleton
    body: Anatomy | None = None

    def take(self, clip: Clip, source: Anatomy | None) -> Clip:
        """A clip on the skeleton: by roles where its body is given, else as it is or fitted."""
        if source is not None and self.body is not None:
            clip = retarget(clip, self.body, source=source)
        elif differs(clip, self.skeleton):
            return subset.fit(clip, self.skeleton)
        return clip.replace(skeleton=self.skeleton)


def agree(
    pieces: Sequence[Piece],
    wanted: Clip | Skeleton | None,
    *,
    retargeting: bool,
    report: Report,
    note: Callable[[str], None],
) -> tuple[list[Piece], list[Anatomy | None], Target]:
    """The pieces that come onto one skeleton; their bodies, where they do so by roles; and the skeleton.

    It is the wanted one, or the first piece's. Without a wanted one, pieces with other joints (names and
    hierarchy) are a UserError that lists the groups. With one they are retargeted; those that cannot be, or
    are not to be, are left out, which is noted, and a UserError if none remains. Other bone lengths are
    fitted.
    """
    skeleton = wanted.skeleton if isinstance(wanted, Clip) else wanted or pieces[0].clip.skeleton
    groups = _grouped(pieces, lambda skeleton: (skeleton.names, skeleton.parents.tobytes()))
    others = [group for group in groups if not group[0].clip.skeleton.same_joints(skeleton)]
    if wanted is None and others:
        _ask(groups)
    body = _target_body(pieces, wanted, skeleton) if others and retargeting else None
    sources: dict[Piece, Anatomy] = {}
    for group in others:
        if body is not None:
            found, refused = _bodies(group, body)
            sources |= found
        else:
            refused = {_difference(group[0].clip.skeleton, skeleton): group}
        for why, lost in refused.items():
            note(f"left out {_describe(lost)}: {why}")
            report.leave_out(lost, "skeleton", why)
    kept = [p for p in pieces if p.clip.skeleton.same_joints(skeleton) or p in sources]
    if not kept:
        clip = pieces[0].clip
        raise UserError(
            f"no clip has the skeleton's {len(skeleton)} joints: {_difference(clip.skeleton, skeleton)}"
            if body is None
            else f"no clip of {len(pieces)} can be retargeted; the first: {report.losses[-1].what}",
            path=clip.source,
            remedy="give --skeleton a file with the clips' joints",
        )
    fitted = sum(piece not in sources and differs(piece.clip, skeleton) for piece in kept)
    for count, what in (
        (len(sources), "have other joints and are retargeted by their roles"),
        (fitted, "have other bone lengths and are fitted to one skeleton"),
    ):
        if count:
            note(f"{count} of {len(kept)} clips {what}")
    return kept, [sources.get(piece) for piece in kept], Target(skeleton, body)


def _target_body(pieces: Sequence[Piece], wanted: Clip | Skeleton | None, skeleton: Skeleton) -> Anatomy:
    """How the skeleton's joints sit in the body, by all clips on it; a UserError if none tells."""
    own = [p.posed or p.clip for p in pieces if p.clip.skeleton.same_joints(skeleton)]
    model = [wanted] if isinstance(wanted, Clip) else []
    try:
        return anatomy.anatomy(skeleton, [*model, *(clip for clip in own if not differs(clip, skeleton))])
    except UserError as error:
        path = wanted.source if isinstance(wanted, Clip) else None
        raise UserError(error.what, path=path, remedy=error.remedy) from error


def _bodies(pieces: Sequence[Piece], target: Anatomy) -> tuple[dict[Piece, Anatomy], dict[str, list[Piece]]]:
    """How the joints of pieces sit in their bodies; by reason, those that cannot move as the target does."""
    found: dict[Piece, Anatomy] = {}
    refused: dict[str, list[Piece]] = {}
    for alike in _grouped(pieces, anatomy.body_of):
        clips = [p.posed or p.clip for p in sorted(alike, key=lambda p: p.posed is None)]
        try:
            body = anatomy.anatomy(alike[0].clip.skeleton, clips)
            plan(body, target)
        except UserError as error:
            refused.setdefault(error.what, []).extend(alike)
        else:
            found |= dict.fromkeys(alike, body)
    return found, refused


def _grouped(pieces: Sequence[Piece], key: Callable[[Skeleton], Hashable]) -> list[list[Piece]]:
    groups: dict[Hashable, list[Piece]] = {}
    for piece in pieces:
        groups.setdefault(key(piece.clip.skeleton), []).append(piece)
    return list(groups.values())


def _ask(groups: list[list[Piece]]) -> NoReturn:
    groups = sorted(groups, key=len, reverse=True)
    listing = "; ".join(map(_describe, groups))
    file = groups[0][0].clip.source
    raise UserError(
        f"the clips have {len(groups)} different skeletons: {listing}",
        remedy=f"choose the one to move them all on: --skeleton {file or 'FILE'} is the most frequent, "
        f"--skeleton {' or '.join(BUILT_IN)} built in; or ignore skeletons with --roles-only",
    )


def _describe(group: Sequence[Piece]) -> str:
    count = f"{len(group)} clips" if len(group) > 1 else "1 clip"
    first = group[0].clip
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
