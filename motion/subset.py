"""Clips on fewer joints, and on other skeletons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from . import contacts, kinematics, quat, root
from .clip import Clip
from .errors import UserError
from .skeleton import Skeleton

Array = NDArray[np.floating]
LINE = 1e-3  # spread of directions across and along, below which bones lie in a line: within 2 degrees of it


def subset(clip: Clip, joints: Sequence[str]) -> Clip:
    """The clip on some of its joints, by name; world transforms of those kept stay.

    A dropped joint's transform goes into its children. Joint 0 must be among them, or one joint above all
    others. Errors: UserError for an unknown joint and for joints without a common one above them.
    """
    old = clip.skeleton
    kept = sorted({old.index(name) for name in joints})
    if not kept:
        raise UserError("no joints to keep", remedy=f"the joints are {', '.join(old.names)}")
    place = {j: i for i, j in enumerate(kept)}
    parents, offsets = [], []
    for j in kept:
        offset, above = old.offsets[j].copy(), int(old.parents[j])
        while above >= 0 and above not in place:
            offset += old.offsets[above]
            above = int(old.parents[above])
        parents.append(place.get(above, -1))
        offsets.append(offset)
    loose = [old.names[j] for j, p in zip(kept, parents, strict=True) if p < 0]
    if len(loose) > 1:
        raise UserError(
            f"no joint of the subset stands above {' and '.join(loose[:3])}",
            remedy=f"keep {old.names[0]} too",
        )
    skeleton = Skeleton(
        tuple(old.names[j] for j in kept),
        np.array(parents, np.int32),
        np.array(offsets),
        {role: place[j] for role, j in old.roles.items() if j in place},
        {place[j]: offset for j, offset in old.end_sites.items() if j in place},
    )
    world_pos, world_rot = kinematics.forward(old, clip.positions, clip.rotations)
    positions, rotations = kinematics.local(skeleton, world_pos[:, kept], world_rot[:, kept])
    return clip.replace(skeleton=skeleton, positions=positions, rotations=kinematics.unroll(rotations))


def roles_only(clip: Clip, roles: Sequence[str]) -> Clip:
    """The joints that play some roles, each directly under the ground root, named by role.

    That is a flat skeleton with the same joints for every rig: databases of features can mix skeletons so.
    A clip without our ground root gets one. A role that no joint plays is a UserError.
    """
    clip = clip if has_ground_root(clip.skeleton) else root.ground(clip)
    wanted = [role for role in roles if role != "root"]
    joints = [0, *(clip.skeleton.role(role) for role in wanted)]
    count = len(joints)
    world_pos, world_rot = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    skeleton = Skeleton(
        (root.NAME, *wanted),
        np.array([-1] + [0] * (count - 1), np.int32),
        np.zeros((count, 3)),
        {root.NAME: 0} | {role: i for i, role in enumerate(wanted, 1)},
    )
    positions, rotations = kinematics.local(skeleton, world_pos[:, joints], world_rot[:, joints])
    return clip.replace(skeleton=skeleton, positions=positions, rotations=kinematics.unroll(rotations))


def has_ground_root(skeleton: Skeleton) -> bool:
    """Whether joint 0 is a ground root as `motion.root.ground` makes it."""
    return skeleton.roles.get("root") == 0 and skeleton.names[0] == root.NAME


def fit(clip: Clip, skeleton: Skeleton) -> Clip:
    """Put a clip onto a skeleton of the same joints with other bone lengths or rest directions.

    Bones keep their directions in the world and get the skeleton's lengths; the height and travel of the hips
    (and of the joints above them) are scaled by the ratio of leg lengths. As feet and pelvis have ratios of
    their own, the hips are then put higher or lower so that ankles stand as high over the ground as the feet
    are large. Joints of another name or hierarchy are a UserError.
    """
    old = clip.skeleton
    _require_same_joints(clip, skeleton)
    bones = np.median(clip.positions, axis=0)  # offsets may be stale where position channels replace them
    align = _alignments(skeleton, bones)
    hips = skeleton.roles.get("hips", old.roles.get("hips", 0))
    travelling = skeleton.chain(hips)
    above = np.maximum(skeleton.parents, 0)
    before = quat.inv(align[above])
    before[0] = quat.identity()
    rotations = quat.mul(before, quat.mul(clip.rotations, align))
    positions = np.repeat(skeleton.offsets[None], len(clip), axis=0)
    scale = leg_length(skeleton, skeleton.offsets) / leg_length(skeleton.with_roles(old.roles), bones)
    positions[:, travelling] = scale * quat.rotate(before[travelling], clip.positions[:, travelling])
    fitted = clip.replace(skeleton=skeleton, positions=positions, rotations=kinematics.unroll(rotations))
    _stand(fitted, clip, hips)
    return fitted


def _stand(fitted: Clip, clip: Clip, hips: int) -> None:
    """Move the hips up or down, in place, until ankles stand as high as before, times the ratio of feet."""
    roles, sides = clip.skeleton.roles, ("left_", "right_")
    if not all(side + "foot" in roles for side in sides):
        return
    ratio = _foot_length(fitted, sides, roles) / _foot_length(clip, sides, roles)
    standing = contacts.contacts(clip, roles=[side + "foot" for side in sides]) != 0
    if not 0 < ratio < np.inf:
        return
    if not standing.any():
        standing[:] = True  # who only runs comes as low
    feet = [roles[side + "foot"] for side in sides]
    before, after = (
        kinematics.forward(c.skeleton, c.positions, c.rotations)[0][:, feet, 1] for c in (clip, fitted)
    )
    low = before < np.percentile(before[standing], 10) + 0.05  # on the ground, where a clip climbs
    lift = np.median((ratio * before - after)[standing & low])
    up = np.broadcast_to([0.0, lift, 0.0], (len(clip), 3))
    if hips > 0:
        turned = kinematics.forward(fitted.skeleton, fitted.positions, fitted.rotations)[1]
        up = quat.rotate(quat.inv(turned[:, fitted.skeleton.parents[hips]]), up)
    fitted.positions[:, hips] += up


def _foot_length(clip: Clip, sides: Sequence[str], roles: Mapping[str, int]) -> float:
    """Mean length from ankles to toes, or else to the feet's ends, metres; NaN where there are none."""
    total = 0.0
    for side in sides:
        if side + "toe" in roles:
            bone = np.median(clip.positions[:, roles[side + "toe"]], axis=0)
        else:
            bone = clip.skeleton.end_sites.get(roles[side + "foot"], np.full(3, np.nan))
        total += float(np.linalg.norm(bone)) / len(sides)
    return total or np.nan


def leg_length(skeleton: Skeleton, bones: Array) -> float:
    """Length of the legs (up_leg to foot), metres, by local positions [J, 3]; without legs, of all bones."""
    lengths, roles = np.linalg.norm(bones, axis=-1), skeleton.roles
    ends = [(f"{side}_foot", f"{side}_up_leg") for side in ("left", "right")]
    legs = [
        float(lengths[skeleton.chain(roles[foot], roles[thigh])[1:]].sum())
        for foot, thigh in ends
        if foot in roles and thigh in roles
    ]
    return float(np.mean(legs)) if legs else max(float(lengths[1:].sum()), 1e-9)


def _require_same_joints(clip: Clip, skeleton: Skeleton) -> None:
    old = clip.skeleton
    if old.same_joints(skeleton):
        return
    missing = [name for name in skeleton.names if name not in old.names]
    extra = [name for name in old.names if name not in skeleton.names]
    what = "has the same joints in another hierarchy"
    if missing or extra:
        lists = [("lacks ", missing), ("has also ", extra)]
        what = " and ".join(f"{verb}{', '.join(names[:8])}" for verb, names in lists if names)
    raise UserError(
        f"the skeleton of {clip.name} is another one: it {what}",
        path=clip.source,
        remedy="use clips of one skeleton, or only the joints that play roles (roles_only)",
    )


def _alignments(skeleton: Skeleton, bones: Array) -> Array:
    """Constant rotations A [J, 4] that turn a skeleton's rest directions to those of bones [J, 3].

    With G world rotations of the clip, G_j A_j turns the skeleton's bones to where the clip's are. A joint
    without bones takes its parent's.
    """
    align = quat.identity(len(skeleton))
    children: list[list[int]] = [[] for _ in skeleton.names]
    for j in range(1, len(skeleton)):
        children[skeleton.parents[j]].append(j)
    for j, own in enumerate(children):
        ours, theirs = skeleton.offsets[own], bones[own]
        sizes = np.minimum(np.linalg.norm(ours, axis=-1), np.linalg.norm(theirs, axis=-1))
        solid = sizes > 1e-3
        hips_above = bool(set(own) & set(skeleton.chain(skeleton.roles.get("hips", 0)))) or not solid.any()
        if hips_above:
            align[j] = align[skeleton.parents[j]] if j and not own else align[j]
            continue
        ours, theirs = (v[solid] / np.linalg.norm(v[solid], axis=-1, keepdims=True) for v in (ours, theirs))
        u, spread, v = np.linalg.svd(theirs.T @ ours)
        if spread[1] < LINE * spread[0]:  # bones in a line do not say how far to turn about it: not at all
            align[j] = quat.between(ours.sum(axis=0), theirs.sum(axis=0))
        else:
            align[j] = quat.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)
    return align
