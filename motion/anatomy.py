"""How a skeleton's joints sit in the body: frames that mean the same on every skeleton.

A joint's own axes mean nothing: in one rig the thigh's y axis runs up the bone, in another all bones lie
along x. Its anatomical frame does: the first axis runs along the bone, the second to where the body faces
(for limbs), so that with F the frame in the joint's local axes and R its world rotation, R F is how that part
of the body is turned. Two skeletons are in one pose where R F agrees.

Bones are known from offsets. The second axes, and what stands upright, come from a pose known to stand: that
of zero rotations where it does (arms out or down, legs down, feet flat), or else from motion: elbows and
knees bend about one axis, pelvis and head are upright on average, feet lie flat where they rest.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import contacts, kinematics, quat
from .clip import Clip
from .errors import UserError
from .roles import ARM, LEG, SIDES, on_all_fours
from .skeleton import Skeleton, listed

Array = NDArray[np.floating]

UP = np.array([0.0, 1.0, 0.0])
TORSO = ("hips", "chest", "neck", "head")
# An axis found from motion is taken for the joint's own axis within this angle: makers of rigs put hinges
# there, and people's elbows and heads deviate by as much.
_SNAP = np.radians(38)
_STRAIGHT = np.radians(8)  # by which a straight elbow or knee bends at most
_ALONG = np.radians(3)  # a bone this near to an axis lies along it
_STEEP = 0.8  # cosine to the vertical above which a bone on the ground points nowhere
_CLIPS = 40  # more of one body show no more
_SAMPLE = 2000  # frames of all clips together: only means are taken of them
_FEW = 3  # frames on flat feet that tell how feet lie
_SLOPE = 0.45  # sine of the angle by which a foot's joint looks down on its toe, where no frame tells
_SHORT = 1e-3  # metres below which a bone has no direction


@dataclass(frozen=True, eq=False, repr=False)
class Anatomy:
    """A skeleton and how its J joints sit in the body.

    Attributes
    ----------
    skeleton : with roles.
    bones : [J, 3] local positions, metres: the offsets, unless the clips' positions replace them.
    rest : [J, 4] local rotations that joints keep which nothing drives.
    frames : [J, 4] the anatomical frame in the joint's axes, where known.
    known : bool [J], which joints have a frame: those with roles, and the spine and neck between.
    sole : height of what touches the ground above it, metres, or NaN where no clip shows it.
    on_all_fours : whether it walks on its hands too.
    """

    skeleton: Skeleton
    bones: Array
    rest: Array
    frames: Array
    known: NDArray[np.bool_]
    sole: float
    on_all_fours: bool

    def __repr__(self) -> str:
        return f"Anatomy({self.skeleton!r}, {int(self.known.sum())} joints known)"


def anatomy(
    skeleton: Skeleton, clips: Sequence[Clip] = (), *, stance: NDArray[np.floating] | None = None
) -> Anatomy:
    """The anatomy of a skeleton.

    Parameters
    ----------
    skeleton : with the roles hips, and up_leg, leg and foot of both sides.
    clips : motion of it. Needed only where its zero rotations do not stand; bones and soles are better known.
    stance : [J, 4] local rotations in which it stands: upright, arms out or down, feet flat.

    Errors: UserError without those roles, and where neither pose nor clip tells how it stands.
    """
    require_roles(skeleton)
    clips = clips[:: 1 + len(clips) // _CLIPS]
    bones = _bones(skeleton, clips)
    if stance is None:
        stance = _stance(skeleton, bones, clips)
    if stance is not None:
        stance = np.asarray(stance, np.float64)
        world = kinematics.forward(skeleton, bones[None], stance[None])
        return _Finder(skeleton, bones, *world, moving=False).anatomy(stance, _sole(skeleton, clips))
    if not clips:
        raise UserError(
            "cannot tell how the skeleton stands: its zero rotations are no standing pose",
            remedy="give a clip of it",
        )
    step = max(1, sum(map(len, clips)) // _SAMPLE)
    positions, rotations = (
        np.concatenate([getattr(clip, what)[::step] for clip in clips]) for what in ("positions", "rotations")
    )
    world = kinematics.forward(skeleton, positions, rotations)
    finder = _Finder(skeleton, bones, *world, moving=True, flat=_flat(skeleton, clips, step))
    return finder.anatomy(_mean(rotations), _sole(skeleton, clips))


def anatomies(clips: Sequence[Clip]) -> list[Anatomy]:
    """An anatomy for each clip; clips of one skeleton and body share one, made of them all."""
    keys = [body_of(clip.skeleton) for clip in clips]
    groups: dict[tuple, list[Clip]] = {}
    for key, clip in zip(keys, clips, strict=True):
        groups.setdefault(key, []).append(clip)
    made = {key: anatomy(group[0].skeleton, group) for key, group in groups.items()}
    return [made[key] for key in keys]


def body_of(skeleton: Skeleton) -> tuple:
    """A key that skeletons of one body share: joints, roles and bone lengths, but for where the hips rest."""
    fixed = np.ones(len(skeleton), bool)
    fixed[skeleton.chain(skeleton.roles.get("hips", 0))] = False
    bones = np.round(skeleton.offsets[fixed], 3).tobytes()
    return skeleton.names, skeleton.parents.tobytes(), tuple(skeleton.roles.items()), bones


def _stance(skeleton: Skeleton, bones: Array, clips: Sequence[Clip]) -> Array | None:
    """Local rotations [J, 4] that stand: zero ones, or a clip's first frame if that is a T-pose; or None."""
    zero = quat.identity(len(skeleton))
    if stands(skeleton, bones, zero):
        return zero
    for clip in clips:
        first = clip.rotations[0]
        if stands(skeleton, bones, first) and _straight(skeleton, bones, first):
            return first
    return None


def stands(skeleton: Skeleton, bones: Array, rotations: Array) -> bool:
    """Whether local rotations stand: legs down, feet level, the body above or before, arms out or down."""
    roles = skeleton.roles
    world, turned = kinematics.forward(skeleton, bones, rotations)
    across = _flatten(world[roles["left_up_leg"]] - world[roles["right_up_leg"]])
    if np.linalg.norm(across) < _SHORT:
        return False
    forward = _unit(np.cross(across, UP))
    top = next((roles[role] for role in ("head", "neck", "chest") if role in roles), None)
    if top is not None:
        body = world[top] - world[roles["hips"]]
        if max(body[1], body @ forward) < 0.7 * np.linalg.norm(body):
            return False
    for side in SIDES:
        thigh, foot = roles[f"{side}_up_leg"], roles[f"{side}_foot"]
        leg = world[foot] - world[thigh]
        if -leg[1] < 0.7 * _reach(skeleton, bones, foot, thigh):
            return False
        tip = _tip(skeleton, bones, side)
        if tip is not None:
            tip = quat.rotate(turned[foot], tip)
            if tip @ forward < 0.2 * np.linalg.norm(tip) or tip[1] > 0.1:
                return False
        if f"{side}_arm" in roles and f"{side}_hand" in roles:
            arm = world[roles[f"{side}_hand"]] - world[roles[f"{side}_arm"]]
            length = _reach(skeleton, bones, roles[f"{side}_hand"], roles[f"{side}_arm"])
            outward = arm @ _unit(across) * (1 if side == "left" else -1)
            if max(outward, -arm[1]) < 0.6 * length:
                return False
    return True


def _straight(skeleton: Skeleton, bones: Array, rotations: Array) -> bool:
    """Whether elbows and knees are straight, as nobody's are who moves."""
    world, _ = kinematics.forward(skeleton, bones, rotations)
    limbs = [("up_leg", "leg", "foot"), ("arm", "forearm", "hand")]
    for names in ([f"{side}_{part}" for part in limb] for side in SIDES for limb in limbs):
        if all(name in skeleton.roles for name in names):
            upper, middle, end = (world[skeleton.roles[name]] for name in names)
            if _unit(middle - upper) @ _unit(end - middle) < np.cos(_STRAIGHT):
                return False
    return True


class _Finder:
    """Finds the frames of one skeleton from the world transforms of one pose that stands, or of motion."""

    def __init__(
        self,
        skeleton: Skeleton,
        bones: Array,
        world_pos: Array,
        world_rot: Array,
        *,
        moving: bool,
        flat: NDArray[np.bool_] | None = None,
    ) -> None:
        self.skeleton, self.bones, self.moving = skeleton, bones, moving
        self.aligned = moving and _aligned(skeleton, bones)
        self.world_pos, self.world_rot = world_pos, world_rot
        self.flat = np.ones((len(world_pos), 2), bool) if flat is None else flat
        self.frames = quat.identity(len(skeleton))
        self.known = np.zeros(len(skeleton), bool)
        roles = skeleton.roles
        self.slope = _SLOPE
        self.left = self._across("up_leg")
        arms = all(f"{side}_arm" in roles for side in SIDES)
        self.left_of_arms = self._across("arm") if arms else self.left
        self.forward = _units(np.cross(self.left, UP))

    def anatomy(self, rest: Array, sole: float) -> Anatomy:
        self._torso()
        # First the side that shows best how feet lie.
        for s in np.argsort(-self.flat.sum(axis=0), kind="stable"):
            self._leg(SIDES[s], self.flat[:, s])
        for side in SIDES:
            self._arm(side, rest)
        self._root()
        rest = rest.copy()
        if self.moving:
            self._straighten(rest)
        fours = on_all_fours(self.skeleton, self.world_pos)
        return Anatomy(self.skeleton, self.bones, rest, self.frames, self.known, sole, fours)

    def _across(self, part: str) -> Array:
        left, right = (self.skeleton.roles[f"{side}_{part}"] for side in SIDES)
        return _units(self.world_pos[:, left] - self.world_pos[:, right])

    def _seen(self, joint: int, directions: Array, frames: NDArray[np.bool_] | None = None) -> Array:
        """Mean of world directions [S, 3] in a joint's axes, unit."""
        local = quat.rotate(quat.inv(self.world_rot[:, joint]), np.broadcast_to(directions, self.left.shape))
        return _unit((local if frames is None else local[frames]).sum(axis=0))

    def _set(self, joint: int, first: Array, second: Array) -> None:
        """A joint's frame: its first axis, and the second one as nearly as it is perpendicular."""
        second = second - first * (first @ second)
        if np.linalg.norm(second) < 1e-6:
            second = np.cross(first, np.roll(first, 1) + 0.1)
        second = _unit(second)
        self.frames[joint] = quat.from_matrix(np.stack([first, second, np.cross(first, second)], axis=-1))
        self.known[joint] = True

    def _snapped(self, direction: Array, first: Array | None = None) -> Array:
        """The joint's own axis nearest to a direction found from motion, if it is near and makes sense."""
        if not self.aligned or (first is not None and np.abs(first).max() < np.cos(_ALONG)):
            return direction
        if first is not None:
            direction = _unit(direction - first * (first @ direction))
        axis = np.zeros(3)
        best = int(np.argmax(np.abs(direction)))
        axis[best] = np.sign(direction[best])
        return axis if axis @ direction > np.cos(_SNAP) else direction

    def _torso(self) -> None:
        roles, skeleton = self.skeleton.roles, self.skeleton
        hips = roles["hips"]
        left = self._snapped(self._seen(hips, self.left))
        up = self._snapped(self._seen(hips, UP), left)
        self._set(hips, _unit(up - left * (left @ up)), left)
        top = next((roles[role] for role in TORSO[:0:-1] if role in roles), None)
        if top is None:
            return
        column = below(skeleton, top, carrier(skeleton))
        for j, above in zip(column, [*column[1:], None], strict=True):
            upper = roles.get("chest", top) in skeleton.chain(j)
            left = self._seen(j, self.left_of_arms if upper else self.left + self.left_of_arms)
            bone = None if above is None else self.bones[above]
            if bone is None or np.linalg.norm(bone) < _SHORT:
                first = self._snapped(self._seen(j, UP))
            else:
                first = _unit(bone)
            self._set(j, first, self._snapped(left, first))

    def _leg(self, side: str, flat: NDArray[np.bool_]) -> None:
        roles = self.skeleton.roles
        joints = [roles[f"{side}_{part}"] for part in LEG[:3]]
        ahead = self._bend(joints, sign=-1.0)
        for joint, below in itertools.pairwise(joints):
            bone = self._bone(joint, below)
            self._set(joint, bone, self._facing(joint, bone, ahead))
        foot = joints[2]
        tip = _tip(self.skeleton, self.bones, side)
        shown = flat.sum() >= _FEW or not self.moving
        if shown or tip is None:
            flat = flat if shown else np.ones(len(flat), bool)
            up, ahead_here = self._seen(foot, UP, flat), self._seen(foot, self.forward, flat)
            if tip is not None and abs(_unit(tip) @ up) < _STEEP:
                ahead_here = _unit(tip)
                self.slope = float(-_unit(tip) @ up)
        else:
            # Who runs on the toes never shows a flat foot: then it slopes as feet do.
            flat = np.ones(len(flat), bool)
            left = self._snapped(self._seen(foot, self.left), _unit(tip))
            left = _unit(left - _unit(tip) * (left @ _unit(tip)))
            slope = quat.from_axis_angle(left, -np.arcsin(self.slope))
            ahead_here = quat.rotate(slope, _unit(tip))
            up = np.cross(ahead_here, left)
        self._set(foot, up, ahead_here)
        toe = roles.get(f"{side}_toe")
        if toe is not None:
            matrix = quat.to_matrix(quat.mul(self.world_rot[:, foot], self.frames[foot]))
            self._set(toe, self._seen(toe, UP, flat), self._seen(toe, matrix[..., 1], flat))

    def _arm(self, side: str, rest: Array) -> None:
        roles = self.skeleton.roles
        joints = [roles.get(f"{side}_{part}") for part in ARM]
        shoulder, arm, forearm, hand = joints
        if shoulder is not None and arm is not None:
            bone = self._bone(shoulder, arm)
            self._set(shoulder, bone, self._snapped(self._seen(shoulder, self.forward), bone))
        if arm is None or forearm is None:
            return
        if hand is None:  # where the forearm ends is not known, but that it goes on as the arm does at rest
            bone = self._bone(arm, forearm)
            self._set(arm, bone, self._facing(arm, bone, self.forward))
            frame = self.frames[arm]
            for j in self.skeleton.chain(forearm, arm)[1:]:
                frame = quat.mul(quat.inv(rest[j]), frame)
            axes = quat.to_matrix(frame)
            self._set(forearm, axes[:, 0], axes[:, 1])
            return
        ahead = self._bend([arm, forearm, hand], sign=1.0)
        for joint, below in ((arm, forearm), (forearm, hand)):
            bone = self._bone(joint, below)
            self._set(joint, bone, self._facing(joint, bone, ahead))
        matrix = quat.to_matrix(quat.mul(self.world_rot[:, forearm], self.frames[forearm]))
        along = self._snapped(self._seen(hand, matrix[..., 0]))
        self._set(hand, along, self._snapped(self._seen(hand, matrix[..., 1]), along))

    def _root(self) -> None:
        root = self.skeleton.roles.get("root")
        if root is not None:
            up, ahead = (self._snapped(self._seen(root, axis)) for axis in (UP, self.forward))
            self._set(root, up, ahead)

    def _bone(self, joint: int, below: int) -> Array:
        """Direction from a joint to another one below it, over joints without roles between (twists)."""
        if self.skeleton.parents[below] == joint:
            bone = self.bones[below]
            if np.linalg.norm(bone) > _SHORT:
                return _unit(bone)
        else:
            bones = self.world_pos[:, below] - self.world_pos[:, joint]
            if np.linalg.norm(bones, axis=-1).min() > _SHORT:
                return self._seen(joint, bones)
        raise UserError(
            f"the bone from {self.skeleton.names[joint]!r} to {self.skeleton.names[below]!r} has no length"
        )

    def _facing(self, joint: int, bone: Array, ahead: Array) -> Array:
        """A limb's second axis: where it faces, in a joint's axes."""
        found = self._seen(joint, ahead)
        if abs(found @ bone) > 0.95:
            found = self._seen(joint, UP)
        return self._snapped(found, bone)

    def _bend(self, joints: Sequence[int], *, sign: float) -> Array:
        """World directions [S, 3] to which the middle joint of a limb bends, longer where it bends more;
        sign -1: where it bends from. In a pose that stands limbs are straight: forward."""
        if not self.moving:
            return self.forward
        upper, middle, end = (self.world_pos[:, j] for j in joints)
        thigh, shin = _units(middle - upper), _units(end - middle)
        return sign * (shin - thigh * np.sum(shin * thigh, axis=-1, keepdims=True))

    def _straighten(self, rest: Array) -> None:
        """Where a mean over motion is no rest: toes in line with the foot, hands with the forearm."""
        roles, parents = self.skeleton.roles, self.skeleton.parents
        for side in SIDES:
            for upper, lower in (("foot", "toe"), ("forearm", "hand")):
                above, below = roles.get(f"{side}_{upper}"), roles.get(f"{side}_{lower}")
                if above is not None and below is not None and parents[below] == above:
                    rest[below] = quat.mul(self.frames[above], quat.inv(self.frames[below]))


def _aligned(skeleton: Skeleton, bones: Array) -> bool:
    """Whether a rig's maker laid bones along the joints' axes: most of those between the limbs' roles."""
    roles = skeleton.roles
    ends = (f"{side}_{part}" for side in SIDES for part in ("leg", "foot", "forearm", "hand"))
    limbs = bones[[roles[role] for role in ends if role in roles]]
    along = np.abs(limbs).max(axis=-1) > np.cos(_ALONG) * np.linalg.norm(limbs, axis=-1)
    return bool(along.mean() > 0.7)


def touching(skeleton: Skeleton, side: str) -> tuple[int, Array]:
    """The joint that touches the ground on a side, and where in its axes [3]."""
    role = f"{side}_toe" if f"{side}_toe" in skeleton.roles else f"{side}_foot"
    joints, points = contacts.touching_points(skeleton, [role])
    return joints[0], points[0]


def _tip(skeleton: Skeleton, bones: Array, side: str) -> Array | None:
    """From the foot joint to what touches the ground, in the foot's axes, or None for the joint itself."""
    foot, (joint, point) = skeleton.roles[f"{side}_foot"], touching(skeleton, side)
    tip = point if joint == foot else bones[below(skeleton, joint, foot)].sum(axis=0)
    return tip if np.linalg.norm(tip) > _SHORT else None


def _bones(skeleton: Skeleton, clips: Sequence[Clip]) -> Array:
    """Offsets; where a clip's position channels replace them, the clips' medians."""
    bones = skeleton.offsets.copy()
    if clips:
        hips = skeleton.roles["hips"]
        seen = np.median(np.concatenate([np.median(c.positions, axis=0)[None] for c in clips]), axis=0)
        travelling = skeleton.chain(hips)
        fixed = np.setdiff1d(np.arange(len(bones)), travelling)
        bones[fixed] = seen[fixed]
    return bones


def _flat(skeleton: Skeleton, clips: Sequence[Clip], step: int) -> NDArray[np.bool_]:
    """Whether the feet of sampled frames lie flat, bool [S, 2]: ankle and toe both rest."""
    out = []
    for clip in clips:
        columns = []
        for side in SIDES:
            parts = [f"{side}_foot", f"{side}_toe"] if f"{side}_toe" in skeleton.roles else [f"{side}_foot"]
            still = contacts.contacts(clip.replace(skeleton=skeleton), roles=parts) != 0
            columns.append(still.all(axis=1))
        out.append(np.stack(columns, axis=-1)[::step])
    return np.concatenate(out)


def _sole(skeleton: Skeleton, clips: Sequence[Clip]) -> float:
    """Height at which feet rest over all clips, metres: the low median of what touches; NaN without clips."""
    heights = []
    for clip in clips:
        roles = [f"{side}_{'toe' if f'{side}_toe' in skeleton.roles else 'foot'}" for side in SIDES]
        joints, points = contacts.touching_points(skeleton, roles)
        world = kinematics.forward(skeleton, clip.positions, clip.rotations)
        touch = contacts.place_points(*world, joints, points)[..., 1]
        resting = contacts.contacts(clip.replace(skeleton=skeleton), roles=roles) != 0
        if resting.any():
            heights.append(touch[resting])
        else:
            heights.append(np.percentile(touch, [5]))
    if not heights:
        return np.nan
    found = np.concatenate(heights)
    low = found < np.percentile(found, 10) + 0.05  # on the ground, where a clip climbs
    return float(np.median(found[low]))


def require_roles(skeleton: Skeleton) -> None:
    """A UserError unless hips and legs have roles."""
    needed = ["hips", *(f"{side}_{part}" for side in SIDES for part in LEG[:3])]
    missing = [role for role in needed if role not in skeleton.roles]
    if missing:
        raise UserError(
            f"no joint plays the role{'s' * (len(missing) > 1)} {', '.join(missing)}",
            remedy=f"name them in a roles file; the joints are {listed(skeleton.names)}",
        )


def carrier(skeleton: Skeleton) -> int:
    """The joint that carries hips and upper body: the hips, or what is above both of them."""
    hips = skeleton.roles["hips"]
    top = next((skeleton.roles[role] for role in TORSO[:0:-1] if role in skeleton.roles), hips)
    above = set(skeleton.chain(top))
    return next(j for j in skeleton.chain(hips)[::-1] if j in above)


def below(skeleton: Skeleton, joint: int, ancestor: int) -> list[int]:
    """Joints on the way from an ancestor (left out) down to a joint; a UserError where it is none."""
    try:
        return skeleton.chain(joint, ancestor)[1:]
    except ValueError:
        raise UserError(
            f"joint {skeleton.names[joint]!r} is not below {skeleton.names[ancestor]!r}",
            remedy="correct the roles in a roles file",
        ) from None


def _reach(skeleton: Skeleton, bones: Array, joint: int, ancestor: int) -> float:
    return float(np.linalg.norm(bones[below(skeleton, joint, ancestor)], axis=-1).sum())


def _mean(rotations: Array) -> Array:
    """Mean rotations [J, 4] over frames [S, J, 4]: Markley et al. 2007, the main eigenvector of sum q qT."""
    moment = np.einsum("sja,sjb->jab", rotations, rotations)
    return quat.shortest(np.linalg.eigh(moment)[1][..., -1])


def _flatten(v: Array) -> Array:
    return v * np.array([1.0, 0.0, 1.0])


def _unit(v: Array) -> Array:
    return v / max(float(np.linalg.norm(v)), 1e-12)


def _units(v: Array) -> Array:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
