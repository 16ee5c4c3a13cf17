"""The middle of the body: hips, spine, chest, neck, head and the ground root."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .names import Name
from .tree import Tree
from .vocabulary import ARM, CENTER_WORDS, LEG, SIDES


def center(tree: Tree, names: Sequence[Name], limbs: Mapping[str, int]) -> dict[str, int]:
    """Hips, spine, chest, neck, head and ground root."""

    def named(part: str) -> list[int]:
        hits = [
            (n.left_over, j)
            for j, n in enumerate(names)
            if n.side is None and not n.helper and CENTER_WORDS.get(n.word) == part
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
        is_spine = CENTER_WORDS.get(names[j].word) == "spine" and bool(heads or necks)
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


def _is_ground_root(tree: Tree, names: Sequence[Name], hips: int) -> bool:
    """Joint 0 is named as one, or the hips rest well away from it."""
    if CENTER_WORDS.get(names[0].word) == "root":
        return True
    reach = max((tree.reach(tree.longest_chain(c)) for c in tree.children[hips]), default=0.0)
    offset = tree.skeleton.offsets[tree.path(hips)[1:]].sum(axis=0)
    return bool(np.linalg.norm(offset) > 0.5 * reach > 0)
