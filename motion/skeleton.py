"""What a skeleton is: joints, hierarchy, rest offsets, and the roles its joints play."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .errors import UserError
from .plain import plain


@dataclass(frozen=True, eq=False, repr=False)
class Skeleton:
    """A tree of joints, parents before children.

    Attributes
    ----------
    names : J joint names, unique.
    parents : int32 [J], the parent's index, -1 for joint 0 only.
    offsets : float64 [J, 3], rest position of each joint in its parent's frame, metres.
    roles : role name (see `motion.roles.ROLES`) to joint index; what schemas refer to.
    end_sites : joint index to the offset of its end site [3], metres (BVH ``End Site``), where there is one.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]
    offsets: NDArray[np.float64]
    roles: Mapping[str, int] = field(default_factory=dict)
    end_sites: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parents = plain(np.asarray(self.parents, np.int32))
        offsets = np.ascontiguousarray(self.offsets, np.float64)
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "parents", parents)
        object.__setattr__(self, "offsets", offsets)
        count = len(self.names)
        if parents.shape != (count,) or offsets.shape != (count, 3):
            raise ValueError(
                f"skeleton of {count} joints: parents {parents.shape}, offsets {offsets.shape}, "
                f"expected ({count},) and ({count}, 3)"
            )
        if count == 0 or parents[0] != -1 or np.any(parents[1:] < 0) or np.any(parents >= np.arange(count)):
            raise ValueError("a skeleton needs one root, joint 0, and parents before children")

    def __repr__(self) -> str:
        return f"Skeleton({len(self)} joints under {self.names[0]!r}, {len(self.roles)} roles)"

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Index of a joint by name; a UserError lists the joints."""
        try:
            return self.names.index(name)
        except ValueError:
            raise UserError(
                f"no joint {name!r}", remedy=f"the skeleton's joints are {listed(self.names)}"
            ) from None

    def role(self, role: str) -> int:
        """Index of the joint that plays a role; a UserError lists the joints and the roles known."""
        if role in self.roles:
            return self.roles[role]
        known = ", ".join(sorted(self.roles)) or "none"
        raise UserError(
            f"no joint plays the role {role!r} (roles found: {known})",
            remedy=f"name it in a roles file; the joints are {listed(self.names)}",
        )

    def with_roles(self, roles: Mapping[str, int]) -> Skeleton:
        """The same skeleton with another role map."""
        return replace(self, roles=dict(roles))

    def levels(self) -> list[NDArray[np.int64]]:
        """Joint indices by depth: level 0 is the root, each level's parents lie in the level before."""
        depth = np.zeros(len(self), np.int64)
        for j in range(1, len(self)):
            depth[j] = depth[self.parents[j]] + 1
        return [np.flatnonzero(depth == d) for d in range(depth.max() + 1)]

    def chain(self, joint: int, ancestor: int = 0) -> list[int]:
        """Joint indices from ancestor down to joint, both included."""
        path = [joint]
        while path[-1] != ancestor:
            parent = int(self.parents[path[-1]])
            if parent < 0:
                raise ValueError(f"joint {ancestor} is no ancestor of joint {joint}")
            path.append(parent)
        return path[::-1]

    def same_joints(self, other: Skeleton) -> bool:
        """Whether names and hierarchy agree (bone lengths may differ)."""
        return self.names == other.names and bool(np.array_equal(self.parents, other.parents))

    def to_json(self) -> dict:
        """A JSON-able description; `from_json` reads it back."""
        return {
            "names": list(self.names),
            "parents": self.parents.tolist(),
            "offsets": self.offsets.tolist(),
            "roles": dict(self.roles),
            "end_sites": {str(j): np.asarray(o).tolist() for j, o in self.end_sites.items()},
        }

    @staticmethod
    def from_json(data: Mapping) -> Skeleton:
        skeleton = Skeleton(
            tuple(data["names"]),
            np.array(data["parents"], np.int32),
            np.array(data["offsets"], np.float64).reshape(-1, 3),
            dict(data["roles"]),
            {int(j): np.array(o, np.float64) for j, o in data.get("end_sites", {}).items()},
        )
        known = range(len(skeleton))
        if not {*skeleton.roles.values(), *skeleton.end_sites} <= set(known):
            raise ValueError("roles or end sites of joints that the skeleton does not have")
        if len(set(skeleton.names)) < len(known) or not all(isinstance(n, str) for n in skeleton.names):
            raise ValueError("joint names that are not unique strings")
        ends = list(skeleton.end_sites.values())
        if not np.isfinite(skeleton.offsets).all() or not all(np.isfinite(e).all() for e in ends):
            raise ValueError("offsets that are not finite")
        if any(end.shape != (3,) for end in ends):
            raise ValueError("end sites that are not three numbers each")
        return skeleton


def listed(names: Sequence[str], most: int = 40) -> str:
    """Names for a message, the first of them where they are many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def sort_topologically(parents: Iterable[int]) -> NDArray[np.int64]:
    """An order of joints that puts parents before children, keeping the given order of siblings."""
    parents = list(parents)
    children: dict[int, list[int]] = {}
    for j, p in enumerate(parents):
        children.setdefault(p, []).append(j)
    order, stack = [], children.get(-1, [])[::-1]
    while stack:
        j = stack.pop()
        order.append(j)
        stack.extend(children.get(j, [])[::-1])
    return np.array(order, np.int64)


def distinct(names: Sequence[str]) -> tuple[str, ...]:
    """The names with a number behind those that another has before them."""
    if len(set(names)) == len(names):
        return tuple(names)
    taken, out = set(names), []
    seen: dict[str, int] = {}
    for name in names:
        found = name
        if name in seen:
            number = seen[name] + 1
            while (found := f"{name} {number}") in taken:
                number += 1
            seen[name] = number
            taken.add(found)
        else:
            seen[name] = 1
        out.append(found)
    return tuple(out)
