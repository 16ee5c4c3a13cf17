"""A body to look at, made of any skeleton: rigid parts bound to joints, shaped by roles and bone lengths.

The left is red, the right blue, as in all of this program's pictures; nose, eyes and feet point to where it
faces. Joints that play no role (twists, fingers, faces) have no part of their own, but a tail has.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import kinematics, quat
from motion.anatomy import Anatomy, touching
from motion.skeleton import Skeleton
from motion.stick_figures import LEFT, RIGHT, bone_colours

from . import shapes
from .scene import Floats, Mesh, colour

Array = NDArray[np.float64]

SIDES = {"left": colour(LEFT), "right": colour(RIGHT)}
TORSO = colour("#aab2bb")
SKIN, EYES = colour("#d9c3b0"), colour("#2b2d33")
_PALE = 0.22  # share of white that the ends of limbs have more
_SHORT = 1e-3  # metres below which a bone is none


class Build(NamedTuple):
    """Shapes of one kind of body, for legs of a given length; metres.

    Attributes
    ----------
    legs : the length, from the thigh's joint to the foot's.
    limbs : a limb's part to (share of its length, radius), each.
    torso : (share of the way from the thighs to the arms, half width, half depth, shift to the belly).
    head : half axes upwards, to the side, ahead; place upwards and ahead.
    """

    legs: float
    limbs: Mapping[str, tuple[tuple[float, float], ...]]
    torso: tuple[tuple[float, float, float, float], ...]
    head: tuple[float, float, float, float, float]


PERSON = Build(
    legs=0.86,
    limbs={
        "up_leg": ((0.0, 0.082), (0.3, 0.078), (0.7, 0.061), (1.0, 0.052)),
        "leg": ((0.0, 0.052), (0.28, 0.057), (0.65, 0.043), (1.0, 0.034)),
        "shoulder": ((0.0, 0.052), (1.0, 0.04)),
        "arm": ((0.0, 0.054), (0.35, 0.045), (1.0, 0.037)),
        "forearm": ((0.0, 0.037), (0.25, 0.04), (1.0, 0.026)),
        "neck": ((0.0, 0.056), (1.0, 0.05)),
    },
    torso=(
        (-0.1, 0.09, 0.085, 0.0),
        (0.03, 0.155, 0.108, -0.005),
        (0.15, 0.157, 0.106, 0.0),
        (0.42, 0.126, 0.09, 0.01),
        (0.72, 0.152, 0.108, 0.012),
        (0.92, 0.156, 0.098, 0.002),
        (1.04, 0.12, 0.07, -0.004),
        (1.14, 0.058, 0.054, -0.004),
    ),
    head=(0.122, 0.076, 0.096, 0.085, 0.015),
)
DOG = Build(
    legs=0.34,
    limbs={
        "up_leg": ((0.0, 0.058), (0.4, 0.05), (1.0, 0.03)),
        "leg": ((0.0, 0.03), (0.3, 0.028), (1.0, 0.016)),
        "foot": ((0.0, 0.013), (0.82, 0.014)),
        "shoulder": ((0.0, 0.045), (1.0, 0.033)),
        "arm": ((0.0, 0.042), (0.4, 0.038), (1.0, 0.024)),
        "forearm": ((0.0, 0.024), (0.3, 0.022), (1.0, 0.016)),
        "hand": ((0.0, 0.013), (0.75, 0.014)),
        "neck": ((0.0, 0.072), (1.0, 0.052)),
    },
    torso=(
        (-0.16, 0.045, 0.05, -0.035),
        (0.0, 0.07, 0.082, -0.02),
        (0.3, 0.066, 0.075, -0.015),
        (0.65, 0.078, 0.1, 0.0),
        (0.95, 0.08, 0.108, -0.005),
        (1.2, 0.055, 0.07, -0.02),
    ),
    head=(0.052, 0.05, 0.075, 0.0, 0.03),
)


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """Rigid parts of a skeleton of J joints.

    Attributes
    ----------
    joints : int64 [K], the joint that each part is bound to, each joint at most once.
    parts : K meshes in their joints' axes.
    """

    joints: NDArray[np.int64]
    parts: tuple[Mesh, ...]

    def __repr__(self) -> str:
        return f"Body({len(self.parts)} parts, {sum(len(p.triangles) for p in self.parts)} triangles)"

    def transforms(self, positions: NDArray, rotations: NDArray) -> Floats:
        """The parts' transforms [..., K, 3, 4], of world positions [..., J, 3] and rotations [..., J, 4]."""
        out = np.empty((*positions.shape[:-2], len(self.joints), 3, 4), np.float32)
        out[..., :3] = quat.to_matrix(rotations[..., self.joints, :])
        out[..., 3] = positions[..., self.joints, :]
        return out


def body(anatomy: Anatomy, *, torso: ArrayLike = TORSO) -> Body:
    """The body of a skeleton; torso is the colour of what is neither left nor right."""
    return _Builder(anatomy, np.asarray(torso, np.float32)).body()


def bones(skeleton: Skeleton, *, middle: ArrayLike = TORSO) -> Body:
    """A body of bare bones, for skeletons of which little is known: a capsule from each joint to the next."""
    lengths = np.linalg.norm(skeleton.offsets[1:], axis=-1)
    size = float(lengths.sum()) / max(np.sqrt(len(skeleton)), 1)
    shades = [np.asarray(middle) if c not in (LEFT, RIGHT) else colour(c) for c in bone_colours(skeleton)]
    made: dict[int, list[Mesh]] = {}
    ends = [(int(skeleton.parents[j]), skeleton.offsets[j], shades[j]) for j in range(1, len(skeleton))]
    ends += [(joint, np.asarray(end), shades[joint]) for joint, end in skeleton.end_sites.items()]
    for joint, end, shade in ends:
        length = float(np.linalg.norm(end))
        if length > _SHORT and skeleton.roles.get("root") != joint:
            thick = min(0.14 * length, 0.025 * size)
            made.setdefault(joint, []).append(shapes.capsule(np.zeros(3), end, (thick, 0.7 * thick), shade))
    if not made:
        made[0] = [shapes.ellipsoid(np.zeros(3), np.eye(3) * 0.05, np.asarray(middle))]
    return _gathered(made)


def _gathered(made: Mapping[int, list[Mesh]]) -> Body:
    joints = sorted(made)
    return Body(np.array(joints, np.int64), tuple(shapes.merged(made[j]) for j in joints))


class _Builder:
    """Makes the parts, each in its joint's axes; lengths are the skeleton's, thicknesses go with its legs."""

    def __init__(self, anatomy: Anatomy, torso: Floats) -> None:
        self.skeleton, self.bones, self.anatomy = anatomy.skeleton, anatomy.bones, anatomy
        self.roles, self.torso_colour = anatomy.skeleton.roles, torso
        self.shape = DOG if anatomy.on_all_fours else PERSON
        self.place, self.turn = kinematics.forward(self.skeleton, self.bones, anatomy.rest)
        self.frames = quat.to_matrix(anatomy.frames)  # columns: the anatomical axes
        pairs = [(self.roles[f"{s}_{a}"], self.roles[f"{s}_{b}"]) for s in SIDES for a, b in _LEG]
        legs = sum(float(np.linalg.norm(self.bone(*pair))) for pair in pairs) / len(SIDES)
        self.scale = legs / self.shape.legs
        self.made: dict[int, list[Mesh]] = {}

    def body(self) -> Body:
        self.column()
        self.head()
        for side, shade in SIDES.items():
            self.limbs(side, shade)
            self.foot(side, shade)
            self.hand(side, shade)
        self.tails()
        return _gathered(self.made)

    def add(self, joint: int, mesh: Mesh) -> None:
        self.made.setdefault(joint, []).append(mesh)

    def bone(self, joint: int, other: int) -> Array:
        """From a joint to another one at rest, in the joint's axes [3]."""
        return self.inside(joint, self.place[other])

    def inside(self, joint: int, point: Array) -> Array:
        """A point of the rest pose in a joint's axes [3]."""
        found: Array = quat.rotate(quat.inv(self.turn[joint]), point - self.place[joint])
        return found

    def axis(self, joint: int, number: int) -> Array:
        """One of a joint's anatomical axes [3], in its own."""
        return self.frames[joint][:, number]

    def left(self, joint: int) -> Array:
        """The body's left [3] in the axes of a joint of the column."""
        return self.axis(joint, 1)

    # The column: pelvis, spine, chest, neck.

    def column(self) -> None:
        skeleton, hips = self.skeleton, self.roles["hips"]
        top = next((self.roles[r] for r in ("head", "neck", "chest") if r in self.roles), hips)
        chain = skeleton.chain(top)
        chest = self.roles.get("chest", self.roles.get("spine", hips))
        arms = [self.roles[f"{side}_arm"] for side in SIDES if f"{side}_arm" in self.roles]
        shoulders = np.mean(self.place[arms], axis=0) if arms else self.place[top]
        thighs = np.mean([self.place[self.roles[f"{side}_up_leg"]] for side in SIDES], axis=0)
        way = shoulders - thighs
        if np.linalg.norm(way) < 0.2 * self.shape.legs * self.scale:  # no upper body is known
            upright = quat.rotate(self.turn[hips], self.axis(hips, 0))
            way = 0.5 * self.scale * upright
        # Joints of the column from the hips to the chest, and the share of the way at which each begins.
        between = set(skeleton.chain(chest)) - set(skeleton.chain(hips))
        spine = [hips, *(j for j in chain if j in between and self.anatomy.known[j])]
        shares = [float((self.place[j] - thighs) @ way / (way @ way)) for j in spine]
        ends = self.shape.torso[0][0], self.shape.torso[-1][0]
        stops = [*shares[1:], ends[1]]
        slim = 1 - _PLATE * np.arange(len(spine))[::-1]
        for joint, start, stop, wide in zip(spine, shares, stops, slim, strict=True):
            if joint == hips:
                self.trunk(joint, way, thighs, (ends[0], max(stop, _PELVIS)), wide)
            elif stop - start > _THIN:
                self.trunk(joint, way, thighs, (start, stop), wide)
        if "neck" in self.roles and "head" in self.roles:
            self.neck()

    def trunk(self, joint: int, way: Array, origin: Array, part: tuple[float, float], wide: float) -> None:
        """A piece of the torso, in a joint's axes, from one share to another of the way from origin."""
        table, length, (start, stop) = np.array(self.shape.torso), float(np.linalg.norm(way)), part
        grid = np.unique(np.concatenate([np.linspace(start, stop, 5), table[:, 0].clip(start, stop)]))
        half = np.stack([np.interp(grid, table[:, 0], table[:, i]) for i in (1, 2, 3)], -1) * self.scale
        half[:, 0] *= self.breadth()
        half[:, :2] *= wide
        frame = _frame(quat.rotate(quat.inv(self.turn[joint]), way / length), self.left(joint))
        rows = [(g * length, *h) for g, h in zip(grid, half, strict=True)]
        shade = self.torso_colour * (0.72 if start < 0 else 1.0)
        self.add(
            joint, shapes.limb(frame, self.inside(joint, origin), rows, shade, caps=(0.3, 0.3), square=2.4)
        )

    def breadth(self) -> float:
        """How much broader than the usual the shoulders are, for legs of this length."""
        arms = [self.roles.get(f"{side}_arm") for side in SIDES]
        if None in arms:
            return 1.0
        wide = float(np.linalg.norm(self.place[arms[0]] - self.place[arms[1]])) / self.scale
        return float(np.clip(wide / _SHOULDERS[self.anatomy.on_all_fours], 0.8, 1.25))

    def neck(self) -> None:
        chain = self.skeleton.chain(self.roles["head"])
        start = chain.index(self.roles["neck"]) if self.roles["neck"] in chain else len(chain)
        for joint, after in itertools.pairwise(chain[start:]):
            shade = self.torso_colour if self.anatomy.on_all_fours else SKIN
            self.tube(joint, self.bone(joint, after), "neck", shade)

    def tube(self, joint: int, bone: Array, part: str, shade: Floats) -> None:
        """A limb along a bone [3] from a joint, in its axes."""
        length = float(np.linalg.norm(bone))
        if length > _SHORT:
            profile = [(t * length, r * self.scale, r * self.scale) for t, r in self.shape.limbs[part]]
            self.add(joint, shapes.limb(shapes.across(bone / length), np.zeros(3), profile, shade))

    # The head: an egg with a nose and eyes, or a skull with a snout and ears.

    def head(self) -> None:
        joint = self.roles.get("head")
        if joint is None:
            return
        up, left = self.axis(joint, 0), self.left(joint)
        ahead = np.cross(left, up)
        tip = self.skeleton.end_sites.get(joint)
        if self.anatomy.on_all_fours and tip is not None and np.linalg.norm(tip) > _SHORT:
            ahead = tip - left * (left @ tip)  # such a head ends at the nose
            ahead = ahead / np.linalg.norm(ahead)
            up = np.cross(ahead, left)
        axes = np.stack([up, left, ahead])
        high, wide, deep, above, before = np.array(self.shape.head) * self.scale
        centre = up * above + ahead * before
        skull = np.stack([up * high, left * wide, ahead * deep])
        self.add(joint, shapes.ellipsoid(centre, skull, SKIN))
        if self.anatomy.on_all_fours:
            self.muzzle(joint, axes, centre)
            return
        face = deep * 0.93
        nose = centre + ahead * face - up * 0.1 * high
        s = self.scale
        self.add(joint, shapes.ellipsoid(nose, axes * np.array([[0.026], [0.014], [0.03]]) * s, SKIN * 0.86))
        for sign in (1, -1):
            eye = centre + ahead * 0.83 * deep + up * 0.14 * high + sign * left * 0.42 * wide
            self.add(joint, shapes.ellipsoid(eye, axes * np.array([[0.017], [0.011], [0.013]]) * s, EYES))
        hair = shapes.ellipsoid(
            centre + up * 0.13 * high - ahead * 0.3 * deep,
            np.stack([up * high * 0.98, left * wide * 1.1, ahead * deep * 0.95]),
            self.torso_colour * 0.45,
        )
        self.add(joint, hair)

    def muzzle(self, joint: int, axes: Array, centre: Array) -> None:
        up, left, ahead = axes
        s = self.scale
        rows = [(0.0, 0.036 * s, 0.036 * s), (0.09 * s, 0.024 * s, 0.022 * s)]
        start = centre + (ahead * 0.04 - up * 0.014) * s
        self.add(joint, shapes.limb(np.stack([ahead, left, up]), start, rows, SKIN))
        tip = start + ahead * 0.108 * s + up * 0.012 * s
        self.add(joint, shapes.ellipsoid(tip, axes * 0.013 * s, EYES))
        for sign, shade in ((1, SIDES["left"]), (-1, SIDES["right"])):
            eye = centre + (ahead * 0.052 + up * 0.022 + sign * left * 0.03) * s
            self.add(joint, shapes.ellipsoid(eye, axes * 0.0085 * s, EYES))
            root = centre + (up * 0.028 - ahead * 0.028 + sign * left * 0.03) * s
            ear = root + (up * 0.055 - ahead * 0.012 + sign * left * 0.014) * s
            self.add(joint, shapes.capsule(root, ear, (0.021 * s, 0.005 * s), shade))

    # Limbs, feet and hands of one side.

    def limbs(self, side: str, shade: Floats) -> None:
        for part, after in (*_LEG, ("shoulder", "arm"), ("arm", "forearm"), ("forearm", "hand")):
            joint, end = (self.roles.get(f"{side}_{name}") for name in (part, after))
            if joint is None:
                continue
            if end is not None:
                bone = self.bone(joint, end)
            elif part == "forearm" and self.anatomy.known[joint]:  # no hand: as long as the upper arm
                upper = self.bone(self.roles[f"{side}_arm"], joint)
                bone = self.axis(joint, 0) * 0.85 * np.linalg.norm(upper)
            else:
                continue
            self.tube(joint, bone, part, self.torso_colour if part == "shoulder" else shade)

    def foot(self, side: str, shade: Floats) -> None:
        joint = self.roles[f"{side}_foot"]
        tip_joint, point = touching(self.skeleton, side)
        tip = np.asarray(point if tip_joint == joint else self.bone(joint, tip_joint), np.float64)
        pale = shade + _PALE * (1 - shade)
        if self.anatomy.on_all_fours:
            self.paw(joint, tip, "foot", pale)
            return
        up, ahead = self.axis(joint, 0), self.axis(joint, 1)
        s, sole = self.scale, self.sole(joint, tip)
        toes = tip_joint != joint
        length = max(float(tip @ ahead), 0.1 * s)
        ankle = sole + 0.03 * s  # from the ground
        rows = []
        for along, wide, high in (
            (-0.058 * s, 0.026, 0.6 * ankle),
            (-0.036 * s, 0.034, 0.85 * ankle),
            (0.014 * s, 0.036, ankle),
            (0.55 * length, 0.04, 0.42 * ankle + 0.027 * s),
            (length, 0.045, 0.046 * s),
        ):
            rows.append((along, wide * s, high / 2, high / 2 - sole))
        frame = np.stack([ahead, np.cross(up, ahead), up])
        self.add(joint, shapes.limb(frame, np.zeros(3), rows, pale, caps=(0.3, 0.35), square=3.2))
        if toes:
            self.toes(tip_joint, pale)

    def toes(self, joint: int, shade: Floats) -> None:
        up, ahead = self.axis(joint, 0), self.axis(joint, 1)
        s, sole = self.scale, self.rest_height()
        end = self.skeleton.end_sites.get(joint)
        known = end is not None and np.linalg.norm(end) > 0.02 * s
        length = float(np.linalg.norm(end)) if known and end is not None else 0.06 * s
        rows = [
            (0.0, 0.044 * s, 0.021 * s, 0.021 * s - sole),
            (0.75 * length, 0.041 * s, 0.016 * s, 0.016 * s - sole),
        ]
        frame = np.stack([ahead, np.cross(up, ahead), up])
        self.add(joint, shapes.limb(frame, np.zeros(3), rows, shade, caps=(0.5, 0.9), square=2.8))

    def sole(self, joint: int, tip: Array) -> float:
        """How far the sole lies below a foot's joint when it stands flat."""
        low = self.rest_height() - float(tip @ self.axis(joint, 0))
        return float(np.clip(low, 0.02 * self.scale, 0.16 * self.scale))

    def rest_height(self) -> float:
        """How far above the ground what touches it rests, at most what a foot is thick."""
        usual = 0.02 * self.scale
        sole = self.anatomy.sole
        return usual if not np.isfinite(sole) else float(np.clip(sole, 0.004 * self.scale, 0.06 * self.scale))

    def paw(self, joint: int, tip: Array, part: str, shade: Floats) -> None:
        self.tube(joint, tip, part, shade)
        s = self.scale
        length = max(float(np.linalg.norm(tip)), 1e-6)
        # The paw lies across the bone, ahead of it.
        ahead = self.axis(joint, 1)
        along = tip / length
        ahead = ahead - along * (along @ ahead)
        ahead /= max(float(np.linalg.norm(ahead)), 1e-6)
        axes = np.stack([along * 0.019, np.cross(along, ahead) * 0.024, ahead * 0.033]) * s
        self.add(joint, shapes.ellipsoid(tip - (along * 0.013 - ahead * 0.014) * s, axes, shade))

    def hand(self, side: str, shade: Floats) -> None:
        joint = self.roles.get(f"{side}_hand")
        if joint is None or not self.anatomy.known[joint]:
            return
        pale = shade + _PALE * (1 - shade)
        if self.anatomy.on_all_fours:
            end = self.skeleton.end_sites.get(joint)
            if end is not None:
                self.paw(joint, np.asarray(end, np.float64), "hand", pale)
            return
        along, wide = self.axis(joint, 0), self.axis(joint, 1)
        s = self.scale
        rows = [(0.0, 0.026, 0.019), (0.045, 0.04, 0.019), (0.09, 0.04, 0.016), (0.15, 0.03, 0.011)]
        frame = np.stack([along, wide, np.cross(along, wide)])
        stations = [tuple(value * s for value in row) for row in rows]
        self.add(joint, shapes.limb(frame, np.zeros(3), stations, pale, caps=(0.5, 0.8), square=2.6))
        thumb = (0.03 * along + 0.03 * wide) * s, (0.085 * along + 0.058 * wide) * s
        self.add(joint, shapes.capsule(*thumb, (0.014 * s, 0.011 * s), pale))

    def tails(self) -> None:
        """Chains without roles that hang from the hips and are long: tails."""
        skeleton = self.skeleton
        named = set(self.roles.values())
        for start in np.flatnonzero(skeleton.parents == self.roles["hips"]):
            below = [j for j in range(len(skeleton)) if start in skeleton.chain(j)]
            if named & set(below):
                continue
            bones = [(int(skeleton.parents[j]), self.bones[j]) for j in below[1:]]
            bones += [(j, skeleton.end_sites[j]) for j in below if j in skeleton.end_sites]
            total = sum(float(np.linalg.norm(bone)) for _, bone in bones)
            if total < 0.3 * self.shape.legs * self.scale:
                continue
            for i, (joint, bone) in enumerate(bones):
                thick = np.array([0.022, 0.014]) * (0.75**i) * self.scale
                self.add(joint, shapes.capsule(np.zeros(3), bone, (thick[0], thick[1]), self.torso_colour))


_LEG = (("up_leg", "leg"), ("leg", "foot"))
_PELVIS, _THIN = 0.2, 0.06  # shares of the way from thighs to shoulders: the pelvis' top, the least piece
_PLATE = 0.015  # share by which a piece is wider than the one below
_SHOULDERS = {False: 0.36, True: 0.11}  # metres between the arms of a usual person, and of a usual dog


def _frame(along: Array, left: Array) -> Array:
    """Rows along, left and belly [3, 3], left made perpendicular."""
    left = left - along * (along @ left)
    left = left / np.linalg.norm(left)
    return np.stack([along, left, np.cross(left, along)])
