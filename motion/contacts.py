"""When feet stand on the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import kinematics, quat
from .clip import Clip
from .errors import UserError
from .roles import on_all_fours
from .skeleton import Skeleton

HANDS = ("left_hand", "right_hand")
SPEED, WINDOW = 0.15, 0.1  # m/s; seconds, 6 frames at 60 Hz


def contact_roles(skeleton: Skeleton, positions: NDArray | None = None) -> tuple[str, ...]:
    """The roles whose contacts are told by default, left before right: toes, or feet where there are none.

    The hands follow where world positions [T, J, 3] of some frames show the body on all fours.
    """
    for part in ("toe", "foot"):
        roles = (f"left_{part}", f"right_{part}")
        if all(role in skeleton.roles for role in roles):
            fours = positions is not None and on_all_fours(skeleton, positions)
            return (*roles, *HANDS) if fours else roles
    known = ", ".join(skeleton.roles) or "none"
    raise UserError(
        f"no pair of toes or feet to tell contacts of (roles found: {known})",
        remedy=f"name left_foot and right_foot in a roles file; the joints are {', '.join(skeleton.names)}",
    )


def contacts(
    clip: Clip, *, roles: Sequence[str] | None = None, speed: float = SPEED, window: float = WINDOW
) -> NDArray[np.uint8]:
    """Ground contacts [T, C], 1 where what roles[c] (default `contact_roles`) touches with is still.

    Still means slower than speed (m/s), after a median filter over window seconds (REFERENCE 2.6).
    """
    if roles is None:
        roles = contact_roles(clip.skeleton, some_positions([clip]))
    velocities = _world_velocities(clip, *touching_points(clip.skeleton, roles))
    return still(velocities, clip.fps, speed=speed, window=window)


def touching_points(skeleton: Skeleton, roles: Sequence[str]) -> tuple[list[int], NDArray[np.float64]]:
    """What roles touch the ground with: joints [C], and the points in these joints' frames [C, 3], metres.

    A toe touches with its joint. A foot or a hand without joints beyond touches with its end site where it
    has one (the tip of the foot, the paw): the joint itself is an ankle, which never rests.
    """
    joints = [skeleton.role(role) for role in roles]
    points = np.zeros((len(joints), 3))
    for c, (role, joint) in enumerate(zip(roles, joints, strict=True)):
        if not role.endswith("toe") and not np.any(skeleton.parents == joint):
            points[c] = skeleton.end_sites.get(joint, np.zeros(3))
    return joints, points


def place_points(
    world_positions: NDArray, world_rotations: NDArray, joints: Sequence[int], points: NDArray
) -> NDArray[np.floating]:
    """World positions [..., C, 3] of `touching_points`, from the joints' world transforms [..., J, ..]."""
    joints = list(joints)
    return world_positions[..., joints, :] + quat.rotate(world_rotations[..., joints, :], points)


def some_positions(clips: Sequence[Clip], count: int = 200) -> NDArray[np.floating]:
    """World positions [S, J, 3] at about count frames, spread over clips of one skeleton."""
    step = max(1, sum(map(len, clips)) // count)
    positions, rotations = (
        np.concatenate([getattr(clip, what)[step // 2 % len(clip) :: step] for clip in clips])
        for what in ("positions", "rotations")
    )
    return kinematics.forward(clips[0].skeleton, positions, rotations)[0]


def still(
    velocities: NDArray, fps: float, *, speed: float = SPEED, window: float = WINDOW
) -> NDArray[np.uint8]:
    """Whether world velocities [T, C, 3] (m/s) are slower than speed, median-filtered, uint8 [T, C]."""
    rates = np.linalg.norm(velocities, axis=-1)
    return median(rates < speed, max(1, round(window * fps))).astype(np.uint8)


def _world_velocities(clip: Clip, joints: Sequence[int], points: NDArray) -> NDArray[np.floating]:
    """World velocities [T, C, 3] of points of joints, through the hierarchy as the public reference does.

    Differences of world positions are the same to second order only, which matters near the threshold.
    """
    skeleton = clip.skeleton
    needed = sorted({j for joint in joints for j in skeleton.chain(joint)})
    place = {j: i for i, j in enumerate(needed)}
    chain = Skeleton(
        tuple(skeleton.names[j] for j in needed),
        np.array([place.get(int(skeleton.parents[j]), -1) for j in needed], np.int32),
        skeleton.offsets[needed],
    )
    positions, rotations = clip.positions[:, needed], clip.rotations[:, needed]
    _, world_rotations, velocities, angular = kinematics.forward_velocities(
        chain,
        positions,
        rotations,
        kinematics.velocities(positions, clip.fps),
        kinematics.angular_velocities(rotations, clip.fps),
    )
    own = [place[j] for j in joints]
    arms = quat.rotate(world_rotations[:, own], points)
    return velocities[:, own] + np.cross(angular[:, own], arms)


def median(flags: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """Median of flags [T, ...] over size frames, size // 2 of them before; the ends repeat; ties are true."""
    if len(flags) == 0:
        return flags.copy()
    before = size // 2
    padded = np.concatenate(
        [np.repeat(flags[:1], before, axis=0), flags, np.repeat(flags[-1:], size - 1 - before, axis=0)]
    )
    total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded]).astype(np.int64), axis=0)
    return 2 * (total[size:] - total[:-size]) >= size
