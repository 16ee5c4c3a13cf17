"""Arms and legs by the words of their joints' names."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from .names import Name
from .tree import Tree
from .vocabulary import ARM, ARM_WORDS, FRONT, LEG_WORDS, opposite


def limb(tree: Tree, names: Sequence[Name], side: str, slots: tuple[str, ...]) -> dict[str, int]:
    """The best chain of joints down one limb by the words of their names."""
    words = {n.word for n in names}
    by_articulation = bool(words & {"elbow", "knee"})
    candidates: dict[str, list[tuple[float, int]]] = {slot: [] for slot in slots}
    for j, name in enumerate(names):
        if name.side != side or name.helper:
            continue
        fits = ARM_WORDS.get(name.word, {}) if slots is ARM else LEG_WORDS.get(name.word, {})
        if name.quarter == "f":
            fits = {FRONT[slot]: fit for slot, fit in LEG_WORDS.get(name.word, {}).items()}
            fits |= ARM_WORDS.get(name.word, {})
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


def drop_unpaired(roles: dict[str, int]) -> None:
    for role in list(roles):
        if opposite(role) not in roles:
            del roles[role]
