"""The body in a clip as the detectors see it: where its joints are, its size, its soles and its ground."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .. import contacts, kinematics, quat, roles, root, units
from ..clip import Clip
from ..errors import UserError

GRAVITY = 9.81  # m/s²
JOINED = 0.1  # seconds; events closer than this are one
STILL = 0.4  # m/s of a person's foot; what is slower may carry the body. Captured soles slide at 0.1 to 0.3
FLOOR_SHARE = 10  # per cent of what stands that may stand lower than the ground (steps, pits, noise)

# Shares of the body's mass by joint, each segment's shared by its two ends (D. A. Winter, Biomechanics and
# Motor Control of Human Movement, table 4.1; the trunk's 0.497 by hips and chest).
MASS = {"hips": 0.25, "chest": 0.25, "head": 0.081} | {
    f"{side}_{part}": share
    for side in roles.SIDES
    for part, share in {
        "up_leg": 0.057,
        "leg": 0.070,
        "foot": 0.035,
        "arm": 0.016,
        "forearm": 0.021,
        "hand": 0.013,
    }.items()
}


class Body:
    """A clip with finite values, measured once for all detectors.

    Lengths are in metres and rates per second, as in the clip. Thresholds that belong to a person are scaled
    by `scale`, the length of the legs over a person's, so that children and dogs are judged by their size.
    """

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.skeleton, self.roles, self.fps = clip.skeleton, clip.skeleton.roles, clip.fps
        self.world, self.turns = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
        self.hips = self.roles.get("hips", 0)
        self.leg = self._leg()
        self.scale = self.leg / units.LEG
        self.gap = max(2, round(JOINED * clip.fps))

    def __len__(self) -> int:
        return len(self.clip)

    def seconds(self, start: int, stop: int) -> float:
        return (stop - start) / self.fps

    def joints(self, names: Iterable[str]) -> list[int]:
        """The joints that play these roles; none if any role is not played."""
        found = [self.roles.get(name, -1) for name in names]
        return [] if -1 in found else found

    def _leg(self) -> float:
        """Length of the legs, thigh and shin; half the body's extent where no leg is known."""
        found = [0.0]
        for side in roles.SIDES:
            chain = self.joints(f"{side}_{part}" for part in ("up_leg", "leg", "foot"))
            if chain:
                bones = np.diff(self.world[:, chain], axis=1)
                found.append(float(np.median(np.linalg.norm(bones, axis=-1).sum(axis=-1))))
        if max(found) > 0:
            return max(found)
        extent = float(np.median(np.ptp(self.world, axis=1).max(axis=-1)))
        return extent / 2 or units.LEG

    @functools.cached_property
    def rotation_steps(self) -> NDArray[np.float64]:
        """Turn of each joint in its parent from frame to frame, scaled angle axis [T-1, J, 3].

        Down to the hips the world counts instead: how the joints above them share it means nothing.
        """
        above = self.skeleton.chain(self.hips)
        local = self.clip.rotations.copy()
        local[:, above] = quat.identity()
        local[:, self.hips] = self.turns[:, self.hips]
        return kinematics.rotation_steps(local)

    @functools.cached_property
    def on_all_fours(self) -> bool:
        step = max(1, len(self) // 100)
        return roles.on_all_fours(self.skeleton, self.world[::step])

    @functools.cached_property
    def centre(self) -> NDArray:
        """World positions [T, 3] of the centre of mass, a person's; the mean of what has a role otherwise."""
        joints = self.joints(MASS)
        if joints and not self.on_all_fours:
            shares = np.array(list(MASS.values()))
        else:
            joints = sorted(set(self.roles.values())) or [0]
            shares = np.ones(len(joints))
        return np.einsum("tjx,j->tx", self.world[:, joints], shares / shares.sum())

    @functools.cached_property
    def soles(self) -> NDArray:
        """World positions [T, C, 3] of what touches the ground; empty where no feet are known."""
        try:
            names = contacts.contact_roles(self.skeleton, self.world[:: max(1, len(self) // 100)])
        except UserError:
            return np.zeros((len(self), 0, 3))
        if names[0].endswith("toe") and "left_foot" in self.roles and "right_foot" in self.roles:
            names = (*names, "left_foot", "right_foot")
        joints, points = contacts.touching_points(self.skeleton, names)
        return contacts.place_points(self.world, self.turns, joints, points)

    @functools.cached_property
    def sole_speeds(self) -> NDArray[np.float64]:
        """Speeds [T, C] of the soles, the slower of the steps to and from each frame."""
        return slower_of_steps(self.soles, self.fps)

    @functools.cached_property
    def ground(self) -> float:
        """Height of the lowest ground that the body stands on; of its lowest soles if it never stands."""
        heights = self.soles[..., 1]
        if heights.size == 0:
            return float(self.world[..., 1].min(axis=1).mean())
        lowest = heights.min(axis=1)
        rests = self.sole_speeds < STILL * np.sqrt(self.scale)
        standing = rests & (heights < lowest[:, None] + 0.05 * self.leg)
        if standing.sum() >= 3:
            return float(np.percentile(heights[standing], FLOOR_SHARE))
        return float(np.percentile(lowest, FLOOR_SHARE))

    @functools.cached_property
    def left(self) -> NDArray[np.float64] | None:
        """Unit vectors [T, 3] on the ground to the body's left by the roles; None without pairs."""
        try:
            across = root.across(self.skeleton, self.world) * [1.0, 0.0, 1.0]
        except UserError:
            return None
        return across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)

    @functools.cached_property
    def forward(self) -> NDArray[np.float64] | None:
        """Unit vectors [T, 3] where the body faces by the roles: left x up."""
        return None if self.left is None else np.cross(self.left, [0.0, 1.0, 0.0])


def slower_of_steps(positions: NDArray, fps: float) -> NDArray[np.float64]:
    """Speeds [T, ...] of points [T, ..., 3]: the slower of the steps to and from each frame."""
    if len(positions) < 2:
        return np.zeros(positions.shape[:-1])
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps
    return np.minimum(np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]]))
