"""Stick figures: the colours of bones by side, and bodies laid on a page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .skeleton import Skeleton

Array = NDArray[np.floating]

LEFT, MIDDLE, RIGHT = "#d1495b", "#7a8288", "#2e86ab"
LIMBS = ("up_leg", "leg", "foot", "toe", "shoulder", "arm", "forearm", "hand")


def bone_colours(skeleton: Skeleton) -> list[str]:
    """A colour a joint, for the bone that leads to it: left, right, or neither, by roles and descent."""
    colours = [""] * len(skeleton)
    for side, colour in (("left", LEFT), ("right", RIGHT)):
        for limb in LIMBS:
            joint = skeleton.roles.get(f"{side}_{limb}")
            if joint is not None:
                colours[joint] = colour
    for joint in range(len(skeleton)):
        parent = skeleton.parents[joint]
        if not colours[joint]:
            above = colours[parent] if parent >= 0 else ""
            colours[joint] = above or MIDDLE
    return colours


def project(pose: Array, yaw: float, view: str = "side") -> Array:
    """Page coordinates [J, 2] of world positions [J, 3], the root at the origin, facing yaw turned away."""
    x, y, z = np.moveaxis(pose - pose[0] * [1, 0, 1], -1, 0)
    ahead, left = x * np.sin(yaw) + z * np.cos(yaw), x * np.cos(yaw) - z * np.sin(yaw)
    if view == "side":
        return np.stack([ahead, y], axis=-1)
    if view == "front":
        return np.stack([left, y], axis=-1)
    if view == "top":
        return np.stack([-left, ahead], axis=-1)
    raise ValueError(f"no view {view!r}; side, front or top")
