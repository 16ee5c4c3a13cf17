"""One skeleton for all clips of a database: who has it, who is fitted or retargeted to it; or a flat one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        """A clip on the skeleton: as it is, with its bones' lengths, or by roles where source is given."""
        if source is not None and self.body is not None:
            return retarget(clip, self.body, source=source).replace(skeleton=self.skeleton)
        return subset.fit(clip, self.skeleton) if differs(clip, self.skeleton) else self.hold(clip)

    def hold(self, clip: Clip) -> Clip:
        """A clip that moves as the skeleton does, on that skeleton itself."""
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
    are not to be, are left out, which is noted, and a UserError if none remains.
    """
    skeleton = wanted.skeleton if isinstance(wanted, Clip) else wanted or pieces[0].clip.skeleton
    groups = _by_joints(pieces)
    others = [group for group in groups if not group[0].clip.skeleton.same_joints(skeleton)]
    if wanted is None and others:
        _ask(groups)
    sources: dict[int, Anatomy] = {}
    body = None
    if others and retargeting:
        own = [p.posed or p.clip for p in pieces if p.clip.skeleton.same_joints(skeleton)]
        model = [wanted] if isinstance(wanted, Clip) else []
        try:
            body = anatomy.anatomy(skeleton, [*model, *(c for c in own if not differs(c, skeleton))])
        except UserError as error:
            source = wanted.source if isinstance(wanted, Clip) else None
            raise UserError(error.what, path=source, remedy=error.remedy) from error
    for group in others:
        left: dict[str, list[Piece]] = {}
        for alike in _by_body(group):
            try:
                if body is None:
                    raise UserError(_difference(group[0].clip.skeleton, skeleton))
                clips = [p.posed or p.clip for p in sorted(alike, key=lambda p: p.posed is None)]
                source_body = anatomy.anatomy(alike[0].clip.skeleton, clips)
                plan(source_body, body)  # says whether one can move as the other does
                sources.update((id(piece), source_body) for piece in alike)
            except UserError as error:
                left.setdefault(error.what, []).extend(alike)
        for why, lost in left.items():
            note(f"left out {_describe(lost)}: {why}")
            report.leave_out(lost, "skeleton", why)
    kept = [p for p in pieces if p.clip.skeleton.same_joints(skeleton) or id(p) in sources]
    if not kept:
        clip = pieces[0].clip
        raise UserError(
            f"no clip has the skeleton's {len(skeleton)} joints: {_difference(clip.skeleton, skeleton)}",
            path=clip.source,
            remedy="give --skeleton a file with the clips' joints",
        )
    if sources:
        count = sum(id(piece) in sources for piece in kept)
        note(f"{count} of {len(kept)} clips have other joints and are retargeted by the roles of theirs")
    return kept, [sources.get(id(piece)) for piece in kept], Target(skeleton, body)


def _by_joints(pieces: Sequence[Piece]) -> list[list[Piece]]:
    groups: list[list[Piece]] = []
    for piece in pieces:
        for group in groups:
            if group[0].clip.skeleton.same_joints(piece.clip.skeleton):
                group.append(piece)
                break
        else:
            groups.append([piece])
    return groups


def _by_body(pieces: Sequence[Piece]) -> list[list[Piece]]:
    groups: dict[tuple, list[Piece]] = {}
    for piece in pieces:
        groups.setdefault(anatomy.body_of(piece.clip.skeleton), []).append(piece)
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
