"""Who stands above whom in a skeleton, and how far chains reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..skeleton import Skeleton


class Tree:
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

    def rest(self) -> NDArray[np.float64]:
        """World positions [J, 3] of the rest pose, all joints unturned."""
        world = self.skeleton.offsets.copy()
        for j, p in enumerate(self.parents[1:], 1):
            world[j] += world[p]
        return world
