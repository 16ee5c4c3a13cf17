"""Roles told by a file, checked, and put over those guessed."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping

from .. import config
from ..errors import UserError
from ..skeleton import Skeleton
from .vocabulary import ARM, LEG, ROLES, SIDES


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


def _check_role(role: str, path: str | os.PathLike[str] | None = None, line: int | None = None) -> None:
    if role not in ROLES:
        remedy = f"the roles are {', '.join(ROLES)}"
        raise UserError(f"unknown role {config.shown(role)}", path=path, line=line, remedy=remedy)
