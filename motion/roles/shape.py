"""Arms and legs by the shape of the skeleton, where its names say nothing."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .tree import Tree
from .vocabulary import ARM, LEG, SIDES


def by_shape(tree: Tree, named: Mapping[str, int], positions: NDArray | None) -> dict[str, int]:
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


def _pairs(tree: Tree) -> list[tuple[list[int], list[int]]]:
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


def _main_joints(tree: Tree, chain: Sequence[int], slots: tuple[str, ...]) -> dict[str, int]:
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
    tree: Tree, roles: Mapping[str, int], found: dict[str, int], positions: NDArray | None
) -> None:
    """Swap left and right in found where the body's frame says so.

    Up goes from the feet to the hips; forward from the hips to the chest if that lies level (a quadruped),
    else along the feet; left is up x forward. Without such a frame left is +x.
    """
    world = tree.rest() if positions is None else np.asarray(positions, np.float64)
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


def _end_direction(tree: Tree, joint: int, positions: NDArray | None) -> NDArray:
    # An end site's direction is known in the rest pose only.
    return np.asarray(tree.skeleton.end_sites.get(joint, np.zeros(3))) if positions is None else np.zeros(3)
