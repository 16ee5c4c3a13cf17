"""Roles guessed from names and shape."""

from __future__ import annotations

from numpy.typing import NDArray

from ..skeleton import Skeleton
from .center import center
from .limbs import drop_unpaired, limb
from .names import read_names
from .shape import by_shape
from .tree import Tree
from .vocabulary import ARM, LEG, ROLES, SIDES


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
    names = read_names(skeleton.names)
    tree = Tree(skeleton)
    roles: dict[str, int] = {}
    for side in SIDES:
        roles |= limb(tree, names, side, LEG)
        roles |= limb(tree, names, side, ARM)
    drop_unpaired(roles)
    shaped = by_shape(tree, roles, positions)
    roles |= {role: joint for role, joint in shaped.items() if role not in roles}
    roles |= center(tree, names, roles)
    return {role: roles[role] for role in ROLES if role in roles}
