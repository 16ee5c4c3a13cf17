"""Which joint plays which role: guessed from names and shape, or told by a file.

For a quadruped the hind legs are the legs and the front legs are the arms. `chest` is the uppermost joint of
the spine; `root` exists only where the skeleton has a joint for the ground under the character.
"""

from __future__ import annotations

import functools
import itertools
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import config
from .errors import UserError
from .skeleton import Skeleton

LEG = ("up_leg", "leg", "foot", "toe")
ARM = ("shoulder", "arm", "forearm", "hand")
SIDES = ("left", "right")
ROLES: tuple[str, ...] = (
    *("root", "hips", "spine", "chest", "neck", "head"),
    *(f"{side}_{part}" for part in LEG + ARM for side in SIDES),
)


def _vocabulary(*entries: tuple[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    return {word: fits for words, fits in entries for word in words.split()}


# Words for parts, each with how well it fits a slot of a limb (3 is certain). Joints are named by the bone
# that they begin ("Calf") or by the articulation that they are ("Knee"); both stand for the same joint.
_LEG_WORDS = _vocabulary(
    ("upleg upperleg thigh femur legupper legup topleg", {"up_leg": 3}),
    ("hip hips", {"up_leg": 1.5}),
    ("leg", {"leg": 2, "up_leg": 1}),
    ("lowerleg lowleg shin calf tibia knee leglower leglow stifle crus", {"leg": 3}),
    ("foot feet paw hoof", {"foot": 2.5, "toe": 1}),
    ("ankle hock tarsus", {"foot": 3}),
    ("toe toes toebase ball foretoe toeball", {"toe": 3}),
)
_ARM_WORDS = _vocabulary(
    ("clavicle collar collarbone clav scapula", {"shoulder": 3}),
    ("shoulder", {"shoulder": 1.5, "arm": 1.6}),
    ("upperarm uparm humerus shldr bicep armupper armup", {"arm": 3}),
    ("arm", {"arm": 2.5}),
    ("forearm lowerarm lowarm elbow radius ulna armlower armlow farm", {"forearm": 3}),
    ("hand", {"hand": 2.5}),
    ("wrist carpus", {"hand": 2}),
)
_FRONT = dict(zip(LEG, ("arm", "forearm", "hand", ""), strict=True))
_CENTER = {
    "hips": ("hips", "hip", "pelvis"),
    "spine": (
        *("spine", "chest", "thorax", "torso", "abdomen", "back", "lowerback", "upperback", "upperchest"),
        *("abdomenlower", "abdomenupper", "chestlower", "chestupper", "waist", "ribcage", "stomach", "belly"),
        *("spinebase", "spinemid", "spineshoulder", "spinelower", "spineupper", "spinechest", "spinenavel"),
    ),
    "neck": ("neck", "lowerneck", "upperneck", "necklower", "neckupper", "cervical"),
    "head": ("head", "skull"),
    "root": (
        *("root", "simulation", "trajectory", "reference", "ground", "world", "origin", "armature", "master"),
        *("motion", "global", "scene", "rootmotion", "skeleton", "null", "main"),
    ),
}
_CENTER_WORDS = {word: part for part, words in _CENTER.items() for word in words}
_SIDE_WORDS = {"l": "left", "left": "left", "lft": "left", "r": "right", "right": "right", "rgt": "right"}
_FILLER = frozenset(
    "joint jnt jt bone bn b bip biped def org skin bind sk j jj node mixamorig character cc base valve "
    "valvebiped bend main rig skel".split()
)
# A joint with one of these words in its name hangs beside the chain that moves the body.
_HELPERS = frozenset(
    "twist roll ik fk pole target ctrl control helper corrective tweak end nub tip site effector eff weapon "
    "prop socket attach dummy muscle skirt hair cloth aux offset top thumb index middle mid ring pinky "
    "little finger fingers eye eyes jaw tongue ear tail wing metatarsal metatarsals heel breast pectoral "
    "butt buttock mch vb cor share constraint locator camera cam goal hint knuckle palm big adj "
    "scale grp".split()
)
# Corners of a quadruped: front, and the three words for hind.
_QUARTERS = {
    "f": ("fl", "fr"),
    "h": ("bl", "br"),
    "h2": ("hl", "hr"),
    "h3": ("rl", "rr"),
}


@dataclass(frozen=True)
class _Name:
    """What a joint's name says: its side, front or hind, its part's word and how many words are left."""

    side: str | None
    quarter: str | None
    word: str
    left_over: int
    helper: bool


def guess(skeleton: Skeleton, positions: NDArray | None = None) -> dict[str, int]:
    """Roles of a skeleton's joints, by name and, for limbs with unknown names, by shape.

    Parameters
    ----------
    skeleton : any humanoid or quadruped.
    positions : [J, 3] world positions of any frame, Y up. Only used to tell left from right where names do
        not, for skeletons whose rest pose does not show it; default: the rest pose.

    Returns
    -------
    role to joint index; a role that no joint seems to play is absent.
    """
    names = _read_names(skeleton.names)
    tree = _Tree(skeleton)
    roles: dict[str, int] = {}
    for side in SIDES:
        roles |= _limb(tree, names, side, LEG)
        roles |= _limb(tree, names, side, ARM)
    _drop_unpaired(roles)
    shaped = _by_shape(tree, roles, positions)
    roles |= {role: joint for role, joint in shaped.items() if role not in roles}
    roles |= _center(tree, names, roles)
    return {role: roles[role] for role in ROLES if role in roles}


def load_overrides(path: str | os.PathLike[str]) -> dict[str, str]:
    """Read a TOML file whose table ``[roles]`` maps role names to joint names.

    A missing or malformed file, another table and an unknown role are UserErrors.
    """
    example = 'write [roles] and lines such as left_foot = "LeftAnkle"'
    data, text = config.read_toml(path)
    unknown = sorted(set(data) - {"roles"})
    if unknown or not isinstance(data.get("roles"), dict):
        what = f"unknown key {unknown[0]!r}" if unknown else "no table [roles]"
        raise UserError(what, path=path, remedy=example)
    for role, joint in data["roles"].items():
        line = config.line_of(text, ("roles", role))
        _check_role(role, path, line)
        if not isinstance(joint, str):
            what = f"roles.{role} is {config.shown(joint)}, expected a joint's name"
            raise UserError(what, path=path, line=line, remedy=example)
    return dict(data["roles"])


def apply(skeleton: Skeleton, overrides: Mapping[str, str]) -> Skeleton:
    """The skeleton with some roles set by joint name; an empty name removes the role.

    An unknown role or joint is a UserError that lists those there are.
    """
    roles = dict(skeleton.roles)
    for role, joint in overrides.items():
        _check_role(role)
        if joint:
            roles[role] = skeleton.index(joint)
        else:
            roles.pop(role, None)
    _check_places(skeleton, roles, overrides)
    return skeleton.with_roles({role: roles[role] for role in ROLES if role in roles})


def _check_places(skeleton: Skeleton, roles: Mapping[str, int], told: Mapping[str, str]) -> None:
    """A UserError where two roles are told one joint, or one told lies above one that it belongs below."""
    remedy = "correct the roles; an empty name removes one"
    for one, other in itertools.combinations([role for role, joint in told.items() if joint], 2):
        # A spine of one joint is its own chest.
        if told[one] == told[other] and {one, other} != {"spine", "chest"}:
            what = f"joint {told[one]!r} is told to play two roles, {one} and {other}"
            raise UserError(what, remedy=remedy)
    for limb in ([f"{side}_{part}" for part in limb] for side in SIDES for limb in (LEG, ARM)):
        found = [role for role in limb if role in roles]
        for upper, lower in itertools.pairwise(found):
            below = roles[upper] in skeleton.chain(roles[lower])
            if not below and (told.get(upper) or told.get(lower)):
                what = f"{skeleton.names[roles[lower]]!r} ({lower}) is not below "
                raise UserError(what + f"{skeleton.names[roles[upper]]!r} ({upper})", remedy=remedy)


def opposite(role: str) -> str:
    """The role on the other side of the body; a role of the middle is its own opposite."""
    for side, other in (SIDES, SIDES[::-1]):
        if role.startswith(side + "_"):
            return other + role[len(side) :]
    return role


def on_all_fours(skeleton: Skeleton, positions: NDArray) -> bool:
    """Whether a body mostly walks on its hands (front paws) too, by world positions [T, J, 3] of some frames.

    Then, in more than half of them, the shoulders are hardly above the hips and the hands near the feet: by a
    third of the legs' length. Who stands up, crouches or picks something up now and then does not. False for
    a skeleton without both pairs of limbs.
    """
    parts = ("up_leg", "leg", "foot", "arm", "hand")
    if not all(f"{side}_{part}" in skeleton.roles for side in SIDES for part in parts):
        return False
    limbs = {p: positions[:, [skeleton.roles[f"{side}_{p}"] for side in SIDES]] for p in parts}
    bones = (limbs["up_leg"] - limbs["leg"], limbs["leg"] - limbs["foot"])
    reach = sum(np.linalg.norm(bone, axis=-1).mean(axis=-1) for bone in bones)
    height = {part: limb[..., 1].mean(axis=-1) for part, limb in limbs.items()}
    level = height["arm"] - height["up_leg"] < reach / 3
    low = height["hand"] - height["foot"] < reach / 3
    return bool(np.mean(level & low) > 0.5)


def _check_role(role: str, path: str | os.PathLike[str] | None = None, line: int | None = None) -> None:
    if role not in ROLES:
        remedy = f"the roles are {', '.join(ROLES)}"
        raise UserError(f"unknown role {config.shown(role)}", path=path, line=line, remedy=remedy)


# Names


def _tokens(name: str) -> list[str]:
    name = name.rsplit(":", 1)[-1].rsplit("|", 1)[-1]
    return [t.lower() for t in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)]


@functools.lru_cache(maxsize=4096)
def side_and_rest(name: str) -> tuple[str | None, tuple[str, ...]]:
    """Side that a joint's name states (left, right or None) and its other words, lower case.

    ``LeftUpLeg``, ``thigh_l``, ``Bip01 L Thigh`` and ``lfemur`` all state the left.
    """
    known = {**_LEG_WORDS, **_ARM_WORDS}
    side, rest = None, []
    for token in _tokens(name):
        if side is None and token in _SIDE_WORDS:
            side = _SIDE_WORDS[token]
            continue
        if side is None:
            for mark in ("left", "right", "l", "r"):
                front, back = token.removeprefix(mark), token.removesuffix(mark)
                long = len(mark) > 1
                if front != token and (front in known or front in _STUCK or (long and front)):
                    side, token = _SIDE_WORDS[mark], front
                    break
                if back != token and (back in known or (long and back)):
                    side, token = _SIDE_WORDS[mark], back
                    break
        rest.append(token)
    return side, tuple(rest)


# Words that stand for parts without a role, which names glue to an "l" or "r" as well.
_STUCK = frozenset("hipjoint fingers thumb toes buttock eye ear index heel".split())


def _read_names(names: Sequence[str]) -> list[_Name]:
    split = [side_and_rest(name) for name in names]
    counts = Counter(t for _, rest in split for t in set(rest))
    common = {t for t, n in counts.items() if len(names) >= 8 and n > 0.6 * len(names)}
    words = {t for _, rest in split for t in rest}
    quarters: dict[str, tuple[str, str]] = {}
    if "fl" in words and words & {"bl", "hl", "rl"}:
        for kind, (left, right) in _QUARTERS.items():
            quarters |= {left: ("left", kind[0]), right: ("right", kind[0])}
    return [_read(side, rest, common, quarters) for side, rest in split]


def _read(
    side: str | None, rest: tuple[str, ...], common: set[str], quarters: Mapping[str, tuple[str, str]]
) -> _Name:
    quarter, tokens = None, []
    for token in rest:
        if token in quarters:
            side, quarter = quarters[token]
        elif token in ("front", "fore") and "arm" not in rest:
            quarter = "f"
        elif token in ("hind", "rear", "back") and len(rest) > 1 and set(rest) & {"leg", *_LEG_WORDS}:
            quarter = "h"
        elif token == "foreleg":
            quarter = "f"
            tokens.append("leg")
        elif not token.isdigit() and token not in common:
            tokens.append(token)
    useful = [t for t in tokens if t not in _FILLER] or tokens
    known = {**_LEG_WORDS, **_ARM_WORDS, **_CENTER_WORDS}
    spans = sorted(itertools.combinations(range(len(useful) + 1), 2), key=lambda s: s[0] - s[1])
    for start, stop in spans:
        word = "".join(useful[start:stop])
        if word in known or (stop - start == 2 and "".join(useful[start:stop][::-1]) in known):
            others = useful[:start] + useful[stop:]
            return _Name(side, quarter, word, len(others), bool(set(others) & _HELPERS))
    return _Name(side, quarter, "", len(useful), bool(set(useful) & _HELPERS))


# Chains


class _Tree:
    """Ancestry questions about a skeleton."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self.parents = skeleton.parents.tolist()
        self.children: list[list[int]] = [[] for _ in self.parents]
        for j, p in enumerate(self.parents[1:], 1):
            self.children[p].append(j)
        self.lengths = np.linalg.norm(skeleton.offsets, axis=-1)
        # Of each joint the child on the way to its farthest leaf, from the leaves up.
        self.longest = [-1] * len(self.parents)
        ways = [0.0] * len(self.parents)
        for j in reversed(range(len(self.parents))):
            below = [(self.lengths[c] + ways[c], c) for c in self.children[j]]
            if below:
                # Of equals the first in the file.
                ways[j], self.longest[j] = max(below, key=lambda way: way[0])
            else:
                ways[j] = float(np.linalg.norm(skeleton.end_sites.get(j, 0.0)))

    def path(self, joint: int) -> list[int]:
        """From joint 0 to joint."""
        path = [joint]
        while self.parents[path[-1]] >= 0:
            path.append(self.parents[path[-1]])
        return path[::-1]

    def above(self, ancestor: int, joint: int) -> bool:
        """Whether ancestor lies strictly above joint."""
        return ancestor != joint and ancestor in self.path(joint)

    def meet(self, a: int, b: int) -> int:
        """Lowest common ancestor."""
        return [j for j, k in zip(self.path(a), self.path(b), strict=False) if j == k][-1]

    def longest_chain(self, joint: int) -> list[int]:
        """Joints from joint to the leaf at the greatest distance along bones."""
        chain = [joint]
        while self.longest[chain[-1]] >= 0:
            chain.append(self.longest[chain[-1]])
        return chain

    def reach(self, chain: Sequence[int]) -> float:
        ends = self.skeleton.end_sites
        return float(self.lengths[list(chain)].sum() + np.linalg.norm(ends.get(chain[-1], 0.0)))


def _limb(tree: _Tree, names: Sequence[_Name], side: str, slots: tuple[str, ...]) -> dict[str, int]:
    """The best chain of joints down one limb by the words of their names."""
    words = {n.word for n in names}
    by_articulation = bool(words & {"elbow", "knee"})
    candidates: dict[str, list[tuple[float, int]]] = {slot: [] for slot in slots}
    for j, name in enumerate(names):
        if name.side != side or name.helper:
            continue
        fits = _ARM_WORDS.get(name.word, {}) if slots is ARM else _LEG_WORDS.get(name.word, {})
        if name.quarter == "f":
            fits = {_FRONT[slot]: fit for slot, fit in _LEG_WORDS.get(name.word, {}).items()}
            fits |= _ARM_WORDS.get(name.word, {})
        if name.word == "wrist" and by_articulation:
            fits = {"hand": 3.0}
        for slot, fit in fits.items():
            if slot in candidates:
                candidates[slot].append((fit - 0.3 * name.left_over, j))
    best, best_score = {}, 0.0
    # Of equals the first in the file wins: the second joint of a split bone is a helper.
    for chosen in itertools.product(*([*candidates[s][:12], None] for s in slots)):
        joints = [c[1] for c in chosen if c is not None]
        if any(not tree.above(a, b) for a, b in itertools.pairwise(joints)):
            continue
        score = sum(c[0] for c in chosen if c is not None)
        if score > best_score + 1e-9:
            best_score = score
            best = {f"{side}_{s}": c[1] for s, c in zip(slots, chosen, strict=True) if c is not None}
    return best


def _drop_unpaired(roles: dict[str, int]) -> None:
    for role in list(roles):
        if opposite(role) not in roles:
            del roles[role]


def _by_shape(tree: _Tree, named: Mapping[str, int], positions: NDArray | None) -> dict[str, int]:
    """Legs and arms, where names gave none, as the two longest pairs of equal chains."""
    missing = [slots for slots in (LEG, ARM) if not any(f"left_{slot}" in named for slot in slots)]
    if not missing:
        return {}
    taken = set()
    for joint in named.values():
        taken |= set(tree.path(joint)[1:])
    pairs = [p for p in _pairs(tree) if not taken & set(p[0] + p[1])]
    if not pairs:
        return {}
    longest = max(tree.reach(a) for a, _ in pairs)
    # The hands and feet that hang from a limb are pairs of their own sides only, so any pair left is a limb.
    limbs = sorted((p for p in pairs if tree.reach(p[0]) > 0.35 * longest), key=lambda p: -tree.reach(p[0]))
    limbs = sorted(limbs[: len(missing)], key=lambda p: len(tree.path(p[0][0])))
    found: dict[str, int] = {}
    for slots, (a, b) in zip(missing, limbs, strict=False):
        for side, chain in zip(SIDES, (a, b), strict=True):
            joints = _main_joints(tree, chain, slots)
            found |= {f"{side}_{slot}": j for slot, j in joints.items()}
    _sort_sides(tree, {**found, **named}, found, positions)
    return found


def _pairs(tree: _Tree) -> list[tuple[list[int], list[int]]]:
    """Pairs of sibling chains of equal bone lengths, outermost only."""
    pairs: list[tuple[list[int], list[int]]] = []
    inside: set[int] = set()
    for joint in range(len(tree.parents)):
        if joint in inside:
            continue
        chains = [tree.longest_chain(c) for c in tree.children[joint]]
        for a, b in itertools.combinations(chains, 2):
            if len(a) == len(b) >= 3 and np.allclose(
                tree.lengths[a], tree.lengths[b], rtol=0.08, atol=0.01 * tree.reach(a) + 1e-9
            ):
                pairs.append((a, b))
                for top in (a[0], b[0]):
                    stack = [top]
                    while stack:
                        inside.add(stack[-1])
                        stack.extend(tree.children[stack.pop()])
                break
    return pairs


def _main_joints(tree: _Tree, chain: Sequence[int], slots: tuple[str, ...]) -> dict[str, int]:
    """Slots of a limb along a chain: its long bones begin where the first bone of half the longest begins."""
    bones = [*tree.lengths[list(chain[1:])].tolist(), 0.0]
    long = [b >= 0.5 * max(bones) for b in bones]
    first = long.index(True)
    if slots is LEG:
        return dict(zip(LEG, chain[first : first + 4], strict=False))
    if long[first : first + 3] == [True, True, True]:
        first += 1  # three long bones before the hand: the first is a collar bone
    found = dict(zip(ARM[1:], chain[first : first + 3], strict=False))
    if first > 0:
        found["shoulder"] = chain[first - 1]
    return found


def _sort_sides(
    tree: _Tree, roles: Mapping[str, int], found: dict[str, int], positions: NDArray | None
) -> None:
    """Swap left and right in found where the body's frame says so.

    Up goes from the feet to the hips; forward from the hips to the chest if that lies level (a quadruped),
    else along the feet; left is up x forward. Without such a frame left is +x.
    """
    world = _rest(tree) if positions is None else np.asarray(positions, np.float64)
    legs = [f"{side}_{LEG[0]}" for side in SIDES]
    left = np.array([1.0, 0.0, 0.0])
    if all(role in roles for role in legs):
        hips = tree.meet(*(roles[role] for role in legs))
        ends = [tree.longest_chain(roles[role]) for role in legs]
        feet = np.mean(
            [world[roles.get(f"{s}_foot", e[-1])] for s, e in zip(SIDES, ends, strict=True)], axis=0
        )
        toes = np.mean([world[e[-1]] + _end_direction(tree, e[-1], positions) for e in ends], axis=0)
        up = world[hips] - feet
        size = np.linalg.norm(up)
        if size > 1e-9:
            up /= size
            arms = [roles[f"{s}_arm"] for s in SIDES if f"{s}_arm" in roles]
            body = world[tree.meet(*arms)] - world[hips] if len(arms) == 2 else np.zeros(3)
            forward = body - up * (body @ up)
            if np.linalg.norm(forward) < 0.5 * size:
                forward = (toes - feet) - up * ((toes - feet) @ up)
            across = np.cross(up, forward)
            if np.linalg.norm(across) > 0.02 * size:
                left = across / np.linalg.norm(across)
    for slots in (LEG, ARM):
        names = [s for s in slots if f"left_{s}" in found]
        if not names:
            continue
        apart = [world[found[f"left_{s}"]] - world[found[f"right_{s}"]] for s in names]
        if sum(float(d @ left) for d in apart) < 0:
            for s in names:
                a, b = f"left_{s}", f"right_{s}"
                found[a], found[b] = found[b], found[a]


def _end_direction(tree: _Tree, joint: int, positions: NDArray | None) -> NDArray:
    # An end site's direction is known in the rest pose only.
    return np.asarray(tree.skeleton.end_sites.get(joint, np.zeros(3))) if positions is None else np.zeros(3)


def _rest(tree: _Tree) -> NDArray[np.float64]:
    world = tree.skeleton.offsets.copy()
    for j, p in enumerate(tree.parents[1:], 1):
        world[j] += world[p]
    return world


# The middle of the body


def _center(tree: _Tree, names: Sequence[_Name], limbs: Mapping[str, int]) -> dict[str, int]:
    """Hips, spine, chest, neck, head and ground root."""

    def named(part: str) -> list[int]:
        hits = [
            (n.left_over, j)
            for j, n in enumerate(names)
            if n.side is None and not n.helper and _CENTER_WORDS.get(n.word) == part
        ]
        return [j for left_over, j in hits if left_over == min(hits)[0]]

    def meeting(slots: tuple[str, ...]) -> int | None:
        for slot in slots:
            pair = [limbs[f"{s}_{slot}"] for s in SIDES if f"{s}_{slot}" in limbs]
            if len(pair) == 2:
                return tree.meet(*pair)
        return None

    legs_meet, arms_meet = meeting(LEG), meeting(ARM)
    roles: dict[str, int] = {}
    hips = [j for j in named("hips") if legs_meet is None or j == legs_meet or tree.above(j, legs_meet)]
    if hips:
        roles["hips"] = hips[0]
    elif legs_meet is not None:
        roles["hips"] = legs_meet
    else:
        return roles
    # Some rigs hang the hips and the spine side by side under one centre.
    base = roles["hips"] if arms_meet is None else tree.meet(roles["hips"], arms_meet)
    heads = [j for j in named("head") if tree.above(base, j)]
    necks = [j for j in named("neck") if tree.above(base, j)]
    tops = heads or necks
    if not tops and arms_meet is not None:
        limb_joints = set(limbs.values())
        ways = [tree.longest_chain(c) for c in tree.children[arms_meet]]
        ways = [w for w in ways if not limb_joints & set(w)]
        tops = [max(ways, key=tree.reach)[-1]] if ways else []
    if heads:
        roles["head"] = heads[0]
    column = tree.path(tops[0] if tops else arms_meet if arms_meet is not None else base)
    column = column[column.index(base) + 1 :]
    spine = []
    for j in column:
        if j in necks or j in heads:
            break
        below_arms = arms_meet is not None and (j == arms_meet or tree.above(j, arms_meet))
        is_spine = _CENTER_WORDS.get(names[j].word) == "spine" and bool(heads or necks)
        if (below_arms or is_spine) and not names[j].helper:
            spine.append(j)
    if spine:
        roles["spine"], roles["chest"] = spine[0], spine[-1]
    beyond = [j for j in column if not spine or (j != spine[-1] and tree.above(spine[-1], j))]
    beyond = [j for j in beyond if j not in spine]
    if necks:
        roles["neck"] = necks[0]
    elif len(beyond) > 1:
        roles["neck"] = beyond[0]
    if "head" not in roles and beyond:
        roles["head"] = next((j for j in beyond if len(tree.children[j]) > 1), beyond[-1])
    if roles["hips"] != 0 and _is_ground_root(tree, names, roles["hips"]):
        roles["root"] = 0
    return roles


def _is_ground_root(tree: _Tree, names: Sequence[_Name], hips: int) -> bool:
    """Joint 0 is named as one, or the hips rest well away from it."""
    if _CENTER_WORDS.get(names[0].word) == "root":
        return True
    reach = max((tree.reach(tree.longest_chain(c)) for c in tree.children[hips]), default=0.0)
    offset = tree.skeleton.offsets[tree.path(hips)[1:]].sum(axis=0)
    return bool(np.linalg.norm(offset) > 0.5 * reach > 0)
