"""The ground root: a joint 0 that travels with the character on the ground and faces where it faces.

REFERENCE 2.6: the chest projected to the ground and smoothed; the hips' forward axis projected to the ground
and smoothed. The filters' windows are lengths of time, so that any frame rate gives the same root.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from . import kinematics, quat
from .clip import Clip
from .errors import UserError
from .skeleton import Skeleton

Array = NDArray[np.floating]

POSITION_WINDOW, HEADING_WINDOW = 31 / 60, 61 / 60  # seconds
NAME = "root"

# A hips' axis within this angle is the forward axis; rigs point it forward to within about 20 degrees.
_AXIS_TOLERANCE = np.radians(30)
# Between these lengths of the forward axis on the ground, its direction gives way to that of the legs' line.
_STEEP, _LEVEL = 0.3, 0.6


def ground(
    clip: Clip, *, position_window: float = POSITION_WINDOW, heading_window: float = HEADING_WINDOW
) -> Clip:
    """Give a clip a ground root as joint 0, named "root": y = 0, +Z is where the character faces.

    World transforms of all other joints stay. A ground root that the clip has (role root) is replaced.

    Parameters
    ----------
    clip : needs the role hips and a pair of up_leg, arm or shoulder. Frames of any rate, at least one.
    position_window, heading_window : seconds over which the root is smoothed (Savitzky-Golay, order 3).
    """
    world_pos, world_rot = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    position = root_positions(clip.skeleton, clip.fps, world_pos, window=position_window)
    rotation = quat.from_yaw(
        root_headings(clip.skeleton, clip.fps, world_pos, world_rot, window=heading_window)
    )
    old = clip.skeleton
    if "root" in old.roles:
        positions, rotations = clip.positions.copy(), clip.rotations.copy()
        under = np.flatnonzero(old.parents == 0)
        moved = under
    else:
        positions = np.concatenate([position[:, None], clip.positions], axis=1)
        rotations = np.concatenate([rotation[:, None], clip.rotations], axis=1)
        under, moved = np.array([0]), np.array([1])
    back = quat.inv(rotation)[:, None]
    positions[:, moved] = quat.rotate(back, world_pos[:, under] - position[:, None])
    rotations[:, moved] = quat.mul(back, world_rot[:, under])
    positions[:, 0], rotations[:, 0] = position, quat.unroll(rotation)
    rotations[:, moved] = quat.unroll(rotations[:, moved])
    return clip.replace(skeleton=_with_root(old), positions=positions, rotations=rotations)


def root_positions(
    skeleton: Skeleton, fps: float, world_pos: Array, *, window: float = POSITION_WINDOW
) -> Array:
    """The ground root's position [T, 3], metres: the chest on the ground, smoothed.

    world_pos [T, J, 3] are world positions of all joints. Without a chest the neck, spine or hips serve.
    """
    joint = next((skeleton.roles[r] for r in ("chest", "neck", "spine") if r in skeleton.roles), None)
    joint = skeleton.role("hips") if joint is None else joint
    return smooth(world_pos[:, joint], fps, window) * np.array([1.0, 0.0, 1.0])


def root_headings(
    skeleton: Skeleton, fps: float, world_pos: Array, world_rot: Array, *, window: float = HEADING_WINDOW
) -> Array:
    """The ground root's heading [T], radians, unwrapped: the hips' forward axis on the ground, smoothed."""
    direction = _unit(smooth(facing(skeleton, world_pos, world_rot), fps, window))
    return np.unwrap(np.arctan2(direction[:, 0], direction[:, 2]))


def facing(skeleton: Skeleton, world_pos: Array, world_rot: Array) -> Array:
    """Where the hips face, unit vectors on the ground [T, 3], unsmoothed.

    That is the hips' own axis nearest to what the legs say (left x up = forward), since zero rotations of
    many rigs are no T-pose. Where the axis stands steep, or no axis is near, the legs' line alone decides.
    """
    hips = skeleton.role("hips")
    left = across(skeleton, world_pos)
    by_line = _unit(np.cross(left, [0.0, 1.0, 0.0]))
    inside = quat.rotate(quat.inv(world_rot[:, hips]), by_line).sum(axis=0)
    size = np.linalg.norm(inside)
    main = int(np.argmax(np.abs(inside)))
    if size == 0 or np.abs(inside[main]) < np.cos(_AXIS_TOLERANCE) * size:
        return by_line
    axis = np.zeros(3)
    axis[main] = np.sign(inside[main])
    forward = quat.rotate(world_rot[:, hips], np.broadcast_to(axis, by_line.shape)) * np.array(
        [1.0, 0.0, 1.0]
    )
    share = np.clip((np.linalg.norm(forward, axis=-1, keepdims=True) - _STEEP) / (_LEVEL - _STEEP), 0, 1)
    return _unit(share * _unit(forward) + (1 - share) * by_line)


def across(skeleton: Skeleton, world_pos: Array) -> Array:
    """From the right to the left of the body [T, 3], metres: between the thighs, else the arms."""
    for part in ("up_leg", "arm", "shoulder"):
        pair = [skeleton.roles.get(f"{side}_{part}") for side in ("left", "right")]
        if None not in pair:
            return world_pos[:, pair[0]] - world_pos[:, pair[1]]
    known = ", ".join(skeleton.roles) or "none"
    raise UserError(
        f"cannot tell where the character faces: no pair of up_leg, arm or shoulder (roles found: {known})",
        remedy=f"name them in a roles file; the joints are {', '.join(skeleton.names)}",
    )


def smooth(values: Array, fps: float, window: float, order: int = 3) -> Array:
    """Savitzky-Golay filter along time, values [T, ...], window in seconds.

    The window is the nearest odd number of frames, at most the clip's; the order goes down with it.
    """
    frames = min(odd_frames(window, fps), (len(values) - 1) // 2 * 2 + 1)
    if frames < 3:
        return values.copy()
    return savitzky_golay(values, frames, min(order, frames - 1))


def savitzky_golay(values: Array, window: int, order: int) -> Array:
    """Each frame of [T, ...] by the polynomial that fits the window (odd) around it best; T >= window.

    At the ends the polynomial of the first and last whole window stands (Savitzky and Golay 1964; what
    ``scipy.signal.savgol_filter`` does, whose import takes longer than a database's building).
    """
    half, flat = window // 2, values.reshape(len(values), -1)
    powers = np.vander(np.arange(-half, half + 1, dtype=np.float64), order + 1, increasing=True)
    fit = np.linalg.pinv(powers)
    out = np.empty_like(flat)
    for column, smoothed in zip(flat.T, out.T, strict=True):
        smoothed[half : len(out) - half] = np.convolve(column, fit[0, ::-1], "valid")
    out[:half] = powers[:half] @ (fit @ flat[:window])
    out[len(out) - half :] = powers[half + 1 :] @ (fit @ flat[-window:])
    return out.reshape(values.shape)


def odd_frames(seconds: float, fps: float) -> int:
    """The odd number of frames nearest to a length of time."""
    return 2 * round((seconds * fps - 1) / 2) + 1


def _unit(v: Array) -> Array:
    """Unit vectors on the ground [T, 3]; where there is none, the last one before (or first after) stays."""
    v = v * np.array([1.0, 0.0, 1.0])
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    good = length[:, 0] > 1e-9
    if not good.any():
        return np.broadcast_to([0.0, 0.0, 1.0], v.shape).copy()
    if not good.all():
        last = np.maximum.accumulate(np.where(good, np.arange(len(v)), -1))
        last = np.where(last < 0, np.flatnonzero(good)[0], last)
        v, length = v[last], length[last]
    return v / length


@lru_cache(maxsize=16)  # clips that share a skeleton go on sharing one
def _with_root(old: Skeleton) -> Skeleton:
    """The skeleton whose joint 0 is our ground root, a new one unless it has one."""
    if "root" in old.roles:
        return replace(
            old,
            names=(NAME, *old.names[1:]),
            offsets=np.concatenate([np.zeros((1, 3)), old.offsets[1:]]),
            end_sites={j: o for j, o in old.end_sites.items() if j != 0},
        )
    names = list(old.names)
    if NAME in names:
        taken = names.index(NAME)
        names[taken] = "hips" if taken == old.roles.get("hips") and "hips" not in names else "root_1"
    return Skeleton(
        (NAME, *names),
        np.concatenate([[-1], old.parents + 1]),
        np.concatenate([np.zeros((1, 3)), old.offsets]),
        {"root": 0} | {role: joint + 1 for role, joint in old.roles.items()},
        {joint + 1: offset for joint, offset in old.end_sites.items()},
    )
