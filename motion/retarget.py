"""Motion on another skeleton, by role: poses agree part by part, limbs keep the target's lengths, feet stand.

With R the world rotation of a joint and F its anatomical frame (`motion.anatomy`), a target's joint t that
plays the role of the source's joint s takes

    R_t = R_s A,   A = F_s F_t^T,

so A is constant. Where spines or necks have other numbers of joints, a joint takes the mean of the source's
over the stretch of the chain that it covers. A source's joint without a counterpart is thereby composed into
those below it; a target's joint without a source follows its parent rigidly. Height and travel are scaled by
the ratio of leg lengths; the pelvis is placed by the middle of its thighs, at the height at which the
target's own feet reach the ground.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import contacts, kinematics, planting, quat, root, subset
from .anatomy import SIDES, TORSO, Anatomy, anatomy, carrier, touching
from .clip import Clip
from .errors import UserError
from .roles import ARM, LEG
from .skeleton import Skeleton

Array = NDArray[np.floating]

# The anatomical frame of a ground root that faces +Z: up, forward and left.
_ROOT_AXES = quat.from_matrix(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
_ALIKE = np.radians(10)  # to which bones point alike on two bodies of one rig


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """How the poses of a source become those of a target with J joints. All of it is constant.

    Attributes
    ----------
    source, target : the skeletons' anatomies.
    scale : of heights and travel, the ratio of leg lengths.
    starts : int32 [J + 1], joint j is turned by the entries starts[j]:starts[j + 1]; none: it keeps `rest`.
    joints, weights, turns : int32 [E], float [E], [E, 4]: the source's joint, its weight, and A.
    carrier : the target's joint that is moved through the world along with the hips.
    pelvis, target_pelvis : [3], the middle of the thighs in the axes of the source's hips and of the carrier.
    lift : how much higher than scaled the pelvis stands, metres.
    root, source_root : the joints that play the role root, or -1.
    """

    source: Anatomy
    target: Anatomy
    scale: float
    starts: NDArray[np.int32]
    joints: NDArray[np.int32]
    weights: Array
    turns: Array
    carrier: int
    pelvis: Array
    target_pelvis: Array
    lift: float
    root: int
    source_root: int

    def __repr__(self) -> str:
        driven = int(np.count_nonzero(np.diff(self.starts)))
        return f"Plan({len(self.source.skeleton)} joints drive {driven} of {len(self.target.skeleton)})"


def plan(source: Anatomy, target: Anatomy) -> Plan:
    """Pair the joints of two skeletons; a UserError where they have no body plan in common."""
    old, new = source.skeleton, target.skeleton
    _require_alike(source, target)
    entries: dict[int, list[tuple[int, float, Array]]] = {}
    for t, s in _pairs(old, new).items():
        entries[t] = [(s, 1.0, turn(source, s, target, t))]
    _spread_torso(source, target, entries)
    _pair_the_rest(source, target, entries)
    hips, above = new.roles["hips"], carrier(new)
    if above != hips:
        chain = quat.identity()
        for j in new.chain(hips, above)[1:]:
            chain = quat.mul(chain, target.rest[j])
        s, weight, own = entries[hips][0]
        entries[above] = [(s, weight, quat.mul(own, quat.inv(chain)))]
    roots = new.roles.get("root", -1), old.roles.get("root", -1)
    if roots[0] == hips:
        roots = -1, roots[1]
    counts = [len(entries.get(j, ())) for j in range(len(new))]
    flat = [entry for j in range(len(new)) for entry in entries.get(j, ())]
    scale = subset.leg_length(new, target.bones) / subset.leg_length(old, source.bones)
    return Plan(
        source=source,
        target=target,
        scale=scale,
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        joints=np.array([s for s, _, _ in flat], np.int32),
        weights=np.array([w for _, w, _ in flat], np.float64),
        turns=np.array([a for _, _, a in flat], np.float64).reshape(-1, 4),
        carrier=above,
        pelvis=_pelvis(source, old.roles["hips"]),
        target_pelvis=_pelvis(target, above),
        lift=_ankle_height(target, source) - scale * _ankle_height(source, source),
        root=roots[0],
        source_root=roots[1],
    )


def retarget(
    clip: Clip,
    target: Skeleton | Anatomy,
    *,
    feet: bool = True,
    source: Anatomy | None = None,
    planted: NDArray | None = None,
) -> Clip:
    """A clip's motion on another skeleton.

    Parameters
    ----------
    clip : with roles set, metres, any axes of joints.
    target : the skeleton to move. One whose zero rotations do not stand needs to be given with its anatomy,
        ``anatomy(skeleton, clips)`` of clips on it.
    feet : plant feet on the ground where the source's rest, by two-bone inverse kinematics.
    source : the source's anatomy; default that of this clip. Clips used together should share one.
    planted : [T, C], when feet rest (`motion.contacts.contact_roles` of the source); default: found.

    Errors: UserError where hips or legs have no role on one of them, or a biped is to move as a quadruped.
    """
    if len(clip) == 0:
        raise UserError(f"{clip.name} has no frames", path=clip.source)
    source = anatomy(clip.skeleton, [clip]) if source is None else source
    if isinstance(target, Skeleton):
        target = anatomy_like(target, source)
    mapping = plan(source, target)
    world_pos, world_rot = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    positions, rotations = apply(mapping, world_pos, world_rot)
    if mapping.root >= 0:
        _place_root(mapping, clip, world_pos, world_rot, positions, rotations)
    if feet:
        _plant(mapping, clip, world_pos, world_rot, positions, rotations, planted)
    return clip.replace(
        skeleton=target.skeleton, positions=positions, rotations=kinematics.unroll(rotations), unit_to_m=1.0
    )


def apply(mapping: Plan, world_pos: Array, world_rot: Array) -> tuple[Array, Array]:
    """Local positions [T, J, 3] and rotations [T, J, 4] of the target, feet not planted yet.

    world_pos and world_rot are the source's. Joints above the carrier stay at rest.
    """
    target = mapping.target
    skeleton, bones, rest = target.skeleton, target.bones, target.rest
    frames = len(world_rot)
    turned = np.empty((frames, len(skeleton), 4), world_rot.dtype)
    for j in range(len(skeleton)):
        entries = slice(mapping.starts[j], mapping.starts[j + 1])
        sources = mapping.joints[entries]
        if len(sources) == 0:
            parent = skeleton.parents[j]
            turned[:, j] = rest[j] if parent < 0 else quat.mul(turned[:, parent], rest[j])
            continue
        each = quat.mul(world_rot[:, sources], mapping.turns[entries].astype(world_rot.dtype))
        nearer = np.sum(each * each[:, :1], axis=-1, keepdims=True) < 0
        weights = mapping.weights[entries][:, None]
        turned[:, j] = quat.normalize(np.sum(weights * np.where(nearer, -each, each), axis=1))
    above = skeleton.parents[1:]
    rotations = turned.copy()
    rotations[:, 1:] = quat.mul(quat.inv(turned[:, above]), turned[:, 1:])
    positions = np.repeat(bones[None].astype(world_pos.dtype), frames, axis=0)
    _place_carrier(mapping, positions, turned, pelvis_path(mapping, world_pos, world_rot))
    return positions, rotations


def pelvis_path(mapping: Plan, world_pos: Array, world_rot: Array) -> Array:
    """Where the middle of the target's thighs belongs in the world [T, 3]."""
    hips = mapping.source.skeleton.roles["hips"]
    middle = world_pos[:, hips] + quat.rotate(world_rot[:, hips], mapping.pelvis)
    return mapping.scale * middle + np.array([0.0, mapping.lift, 0.0])


def _place_carrier(mapping: Plan, positions: Array, turned: Array, pelvis: Array) -> None:
    """Set the carrier's local position so that the pelvis is there; turned are the world rotations."""
    skeleton, joint = mapping.target.skeleton, mapping.carrier
    place = pelvis - quat.rotate(turned[:, joint], mapping.target_pelvis)
    above = skeleton.chain(joint)[:-1]
    if above:
        chain = Skeleton(
            tuple(skeleton.names[j] for j in above),
            np.arange(-1, len(above) - 1, dtype=np.int32),
            mapping.target.bones[above].astype(np.float64),
        )
        local = positions[:, above], _locals(turned[:, above])
        over = kinematics.forward(chain, *local)[0][:, -1]
        place = quat.rotate(quat.inv(turned[:, above[-1]]), place - over)
    positions[:, joint] = place


def _locals(turned: Array) -> Array:
    """Local rotations [T, C, 4] of a chain from its world rotations."""
    out = turned.copy()
    out[:, 1:] = quat.mul(quat.inv(turned[:, :-1]), turned[:, 1:])
    return out


def _place_root(
    mapping: Plan, clip: Clip, world_pos: Array, world_rot: Array, positions: Array, rotations: Array
) -> None:
    """Let the target's root travel on the ground, in place; what is under it stays in the world."""
    skeleton, joint = mapping.target.skeleton, mapping.root
    if mapping.source_root >= 0:
        place = mapping.scale * world_pos[:, mapping.source_root]
        facing = quat.mul(
            world_rot[:, mapping.source_root],
            turn(mapping.source, mapping.source_root, mapping.target, joint),
        )
    else:
        place = mapping.scale * root.root_positions(clip.skeleton, clip.fps, world_pos)
        yaw = root.root_headings(clip.skeleton, clip.fps, world_pos, world_rot)
        axes = quat.mul(_ROOT_AXES, quat.inv(mapping.target.frames[joint]))
        facing = quat.mul(quat.from_yaw(yaw), axes)
    new_pos, new_rot = kinematics.forward(skeleton, positions, rotations)
    new_pos[:, joint], new_rot[:, joint] = place, facing
    under = skeleton.chain(skeleton.roles["hips"], joint)
    # What stands between the root and the hips goes along with the root.
    for above, j in itertools.pairwise(under):
        if j == mapping.carrier:
            break
        new_rot[:, j] = quat.mul(new_rot[:, above], mapping.target.rest[j])
        new_pos[:, j] = new_pos[:, above] + quat.rotate(new_rot[:, above], mapping.target.bones[j])
    positions[:], rotations[:] = kinematics.local(skeleton, new_pos, new_rot)


def _plant(
    mapping: Plan,
    clip: Clip,
    world_pos: Array,
    world_rot: Array,
    positions: Array,
    rotations: Array,
    planted: NDArray | None,
) -> None:
    """Plant the target's feet where the source's rest, in place."""
    roles = contacts.contact_roles(clip.skeleton, world_pos)
    if planted is None:
        planted = contacts.contacts(clip, roles=roles)
    elif planted.shape != (len(clip), len(roles)):
        raise UserError(
            f"contacts of shape {planted.shape}", remedy=f"give {(len(clip), len(roles))}: {', '.join(roles)}"
        )
    found = limbs(mapping.target, roles)
    joints, points = contacts.touching_points(clip.skeleton, roles)
    touch = contacts.place_points(world_pos, world_rot, joints, points)[..., 1]
    theirs, ours = soles(mapping, roles)
    planting.plant(
        mapping.target.skeleton,
        clip.fps,
        positions,
        rotations,
        limbs=found,
        carrier=mapping.carrier,
        resting=planted != 0,
        heights=mapping.scale * (touch - theirs),
        floor=ours,
    )


def limbs(body: Anatomy, roles: Sequence[str]) -> planting.Limbs:
    """The limbs that touch the ground as these roles of a source do; a UserError where one is missing."""
    skeleton = body.skeleton
    joints, points, hinges = [], [], []
    for role in roles:
        side, _, part = role.partition("_")
        names = ("arm", "forearm", "hand") if part == "hand" else ("up_leg", "leg", "foot")
        upper, middle, end = (skeleton.role(f"{side}_{name}") for name in names)
        for above, joint in ((upper, middle), (middle, end)):
            if not body.bones[skeleton.chain(joint, above)[1:]].any():
                raise UserError(f"the bone to joint {skeleton.names[joint]!r} has no length")
        if part == "hand":
            touches, touch_points = contacts.touching_points(skeleton, [role])
            joint, point = touches[0], touch_points[0]
        else:
            joint, point = touching(skeleton, side)
        along, ahead = (quat.rotate(body.frames[upper], axis) for axis in np.eye(3)[:2])
        joints.append((upper, middle, end, joint))
        points.append(point)
        hinges.append(np.cross(along, ahead) if part == "hand" else np.cross(ahead, along))
    return planting.Limbs(
        np.array(joints, np.int64).reshape(-1, 4), np.reshape(points, (-1, 3)), np.reshape(hinges, (-1, 3))
    )


def soles(mapping: Plan, roles: Sequence[str]) -> tuple[Array, Array]:
    """Heights [C] over the ground of what touches it as the roles do: of the source and of the target."""
    theirs = np.full(len(roles), mapping.source.sole if np.isfinite(mapping.source.sole) else 0.0)
    ours = np.full(len(roles), _ankle_height(mapping.target, mapping.source) - _drop(mapping.target))
    for c, role in enumerate(roles):
        if role.endswith("hand"):
            ours[c] = mapping.scale * theirs[c]
    return theirs, ours


def anatomy_like(skeleton: Skeleton, source: Anatomy) -> Anatomy:
    """A skeleton's anatomy. One with the source's joints, and bones that point as the source's do, has the
    source's frames, whatever else it has; roles that it does not know are the source's then."""
    old = source.skeleton
    place = {name: j for j, name in enumerate(skeleton.names)}
    if not all(name in place for name in old.names):
        return anatomy(skeleton)
    own = np.array([place[name] for name in old.names])
    above = np.where(skeleton.parents[own] < 0, -1, skeleton.parents[own])
    expected = np.where(old.parents < 0, above, own[np.maximum(old.parents, 0)])
    fixed = ~np.isin(np.arange(len(old)), old.chain(old.roles["hips"]))
    ours, theirs = skeleton.offsets[own][fixed], source.bones[fixed]
    sizes = np.linalg.norm(ours, axis=-1) * np.linalg.norm(theirs, axis=-1)
    apart = np.sum(ours * theirs, axis=-1) < np.cos(_ALIKE) * sizes - 1e-9
    more = {role for role, j in skeleton.roles.items() if j not in own} - {root.NAME}
    if np.any(above != expected) or apart.any() or more:
        return anatomy(skeleton)
    roles = dict(skeleton.roles) or {role: int(own[j]) for role, j in old.roles.items()}
    rest, frames = quat.identity(len(skeleton)), quat.identity(len(skeleton))
    known = np.zeros(len(skeleton), bool)
    rest[own], frames[own], known[own] = source.rest, source.frames, source.known
    ground = roles.get(root.NAME, -1)
    if ground >= 0 and not known[ground]:
        frames[ground], known[ground] = _ROOT_AXES, True
    return Anatomy(
        skeleton=skeleton.with_roles(roles),
        bones=skeleton.offsets,
        rest=rest,
        frames=frames,
        known=known,
        sole=np.nan,
        on_all_fours=source.on_all_fours,
    )


def _pairs(old: Skeleton, new: Skeleton) -> dict[int, int]:
    """Target's joint to source's joint, by roles that both have."""
    parts = [role for role in _marks(old, new) if role != "neck"]
    parts += [f"{side}_{part}" for side in SIDES for part in (*LEG, *ARM)]
    return {new.roles[role]: old.roles[role] for role in parts if role in new.roles and role in old.roles}


def _marks(old: Skeleton, new: Skeleton) -> list[str]:
    """Roles of the torso that both have, from the hips up. Of roles that share a joint on either, as neck and
    head do where the neck is the last, the more telling one."""
    marks: list[str] = []
    for role in sorted(TORSO, key=("hips", "head", "chest", "neck").index):
        known = all(role in body.roles for body in (old, new))
        if known and not any(body.roles[role] == body.roles[m] for m in marks for body in (old, new)):
            marks.append(role)
    return sorted(marks, key=TORSO.index)


def turn(source: Anatomy, s: int, target: Anatomy, t: int) -> Array:
    """The constant A [4] with which a target's joint t turns as a source's joint s does."""
    return quat.mul(source.frames[s], quat.inv(target.frames[t]))


def _spread_torso(source: Anatomy, target: Anatomy, entries: dict) -> None:
    """Spine and neck: joints between those that both have take the mean turn of the stretch they cover."""
    old, new = source.skeleton, target.skeleton
    for low, high in itertools.pairwise(_marks(old, new)):
        theirs = _stretch(source, low, high)
        ours = _stretch(target, low, high)
        # Hips and chest bear limbs, so they turn as the source's do; a neck only bends.
        for t, begin, end in ours if low == "neck" else ours[1:]:
            middle = (begin + end) / 2
            shares = [(s, min(end, b) - max(begin, a)) for s, a, b in theirs]
            chosen = [(s, share) for s, share in shares if share > 1e-6]
            if not chosen or end - begin < 1e-6:
                nearest = [s for s, a, _ in theirs if a <= middle + 1e-9] or [theirs[0][0]]
                chosen = [(nearest[-1], 1.0)]
            total = sum(share for _, share in chosen)
            entries[t] = [(s, share / total, turn(source, s, target, t)) for s, share in chosen]


def _stretch(body: Anatomy, low: str, high: str) -> list[tuple[int, float, float]]:
    """The joints from one of the torso up to (not with) another: each with the share of the way it covers."""
    skeleton, roles = body.skeleton, body.skeleton.roles
    start = carrier(skeleton) if low == "hips" else roles[low]
    chain = skeleton.chain(roles[high], start)
    lengths = np.linalg.norm(body.bones[chain[1:]], axis=-1)
    ends = np.cumsum(lengths) / max(float(lengths.sum()), 1e-9)
    starts = np.concatenate([[0.0], ends[:-1]])
    joints = [roles[low], *chain[1:-1]]
    return list(zip(joints, starts.tolist(), ends.tolist(), strict=True))


def _pair_the_rest(source: Anatomy, target: Anatomy, entries: dict) -> None:
    """Joints without roles under a pair: those of one name, and those between two pairs, if as many.

    They turn from their rest as the source's joint does from its own.
    """
    old, new = source.skeleton, target.skeleton
    partner = {t: e[0][0] for t, e in entries.items() if len(e) == 1}
    alike = dict(partner)
    for t in range(len(new)):
        if t in entries or new.parents[t] < 0 or int(new.parents[t]) not in alike:
            continue
        above = alike[int(new.parents[t])]
        s = old.names.index(new.names[t]) if new.names[t] in old.names else -1
        if s < 0 or old.parents[s] != above:
            s = _in_between(old, new, partner, t, above)
        if s < 0 or s in alike.values():
            continue
        alike[t] = s
        own = quat.mul(entries[int(new.parents[t])][0][2], target.rest[t])
        entries[t] = [(s, 1.0, quat.mul(quat.inv(source.rest[s]), own))]


def _in_between(old: Skeleton, new: Skeleton, partner: dict[int, int], t: int, above: int) -> int:
    """The source's joint at the same place between two pairs as the target's joint t, or -1."""
    for lower, s in partner.items():
        path = new.chain(lower)
        if t not in path:
            continue
        between = path[path.index(t) - 1 :]
        theirs = old.chain(s)
        if above in theirs and len(theirs) - theirs.index(above) == len(between):
            inner = between[1:-1]
            if not set(inner[1:]) & set(partner):
                return theirs[theirs.index(above) + 1]
    return -1


def _pelvis(body: Anatomy, joint: int) -> Array:
    """The middle of the thighs in a joint's axes [3], at rest."""
    skeleton = body.skeleton
    rest = np.where(np.arange(len(skeleton))[:, None] == joint, quat.identity(), body.rest)
    world_pos, world_rot = kinematics.forward(skeleton, body.bones, rest)
    thighs = [world_pos[skeleton.roles[f"{side}_up_leg"]] for side in SIDES]
    return quat.rotate(quat.inv(world_rot[joint]), np.mean(thighs, axis=0) - world_pos[joint])


def _ankle_height(body: Anatomy, source: Anatomy) -> float:
    """Height of the ankles over the ground on flat feet; soles no clip shows are the source's, to scale."""
    drop = _drop(body)
    lengths = [_foot(body, side)[1] for side in SIDES]
    theirs, their_lengths = zip(*(_foot(source, side) for side in SIDES), strict=True)
    sole = body.sole
    if not np.isfinite(sole):
        if np.isfinite(source.sole):
            ratio = (
                np.mean(lengths) / np.mean(their_lengths) if min(*lengths, *their_lengths) > 1e-3 else None
            )
            if ratio is None:
                ratio = subset.leg_length(body.skeleton, body.bones) / subset.leg_length(
                    source.skeleton, source.bones
                )
                return max(float(ratio * (source.sole + np.mean(theirs))), drop)
            sole = ratio * source.sole
        else:
            sole = 0.0
    return float(sole + drop)


def _drop(body: Anatomy) -> float:
    """How far below the ankles flat feet touch the ground, metres."""
    return float(np.mean([_foot(body, side)[0] for side in SIDES]))


def _foot(body: Anatomy, side: str) -> tuple[float, float]:
    """How far below the ankle a flat foot touches the ground, and how far before it, metres."""
    skeleton, foot = body.skeleton, body.skeleton.roles[f"{side}_foot"]
    joint, point = touching(skeleton, side)
    rest = np.where(np.arange(len(skeleton))[:, None] == foot, quat.identity(), body.rest)
    world_pos, world_rot = kinematics.forward(skeleton, body.bones, rest)
    tip = world_pos[joint] + quat.rotate(world_rot[joint], point) - world_pos[foot]
    up, ahead, _ = np.moveaxis(quat.to_matrix(quat.mul(world_rot[foot], body.frames[foot])), -1, 0)
    return float(-tip @ up), float(tip @ ahead)


def _require_alike(source: Anatomy, target: Anatomy) -> None:
    four = [body.on_all_fours for body in (source, target)]
    if four[0] != four[1]:
        kinds = ["quadruped" if it else "biped" for it in four]
        raise UserError(
            f"cannot move a {kinds[1]} as a {kinds[0]} moves",
            remedy="retarget between bodies of one plan, say which axis of their files is up if it is not y, "
            "or take the arms' roles from one in a roles file",
        )
