"""Forward kinematics, and velocities by central differences."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import kinematics_kernels as kernels
from . import quat
from .skeleton import Skeleton

Array = NDArray[Any]  # float32 or float64


def forward(skeleton: Skeleton, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """World transforms from local ones.

    positions [..., J, 3] metres, rotations [..., J, 4]; returns the same shapes.
    """
    world_pos, world_rot = np.empty_like(positions, order="C"), np.empty_like(rotations, order="C")
    kernels.forward(skeleton.parents, *map(_flat, (positions, rotations, world_pos, world_rot)))
    return world_pos, world_rot


def forward_numpy(skeleton: Skeleton, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """The obvious twin of `forward`: level by level of the hierarchy."""
    world_pos, world_rot = positions.copy(), rotations.copy()
    for joints in skeleton.levels()[1:]:
        parent_rot = world_rot[..., skeleton.parents[joints], :]
        world_rot[..., joints, :] = quat.mul(parent_rot, rotations[..., joints, :])
        world_pos[..., joints, :] = world_pos[..., skeleton.parents[joints], :] + quat.rotate(
            parent_rot, positions[..., joints, :]
        )
    return world_pos, world_rot


def forward_velocities(
    skeleton: Skeleton, positions: Array, rotations: Array, velocities: Array, angular: Array
) -> tuple[Array, Array, Array, Array]:
    """World transforms and their velocities from local ones.

    velocities [..., J, 3] m/s and angular [..., J, 3] rad/s are in the parent's frame. Returns world
    positions, rotations, velocities and angular velocities.

        v_j = v_p + R_p v_j' + w_p x R_p x_j',   w_j = w_p + R_p w_j'
    """
    given = (positions, rotations, velocities, angular)
    world = [np.empty_like(array, order="C") for array in given]
    kernels.forward_velocities(skeleton.parents, *map(_flat, (*given, *world)))
    return world[0], world[1], world[2], world[3]


def forward_velocities_numpy(
    skeleton: Skeleton, positions: Array, rotations: Array, velocities: Array, angular: Array
) -> tuple[Array, Array, Array, Array]:
    """The obvious twin of `forward_velocities`: level by level of the hierarchy."""
    world_pos, world_rot = positions.copy(), rotations.copy()
    world_vel, world_ang = velocities.copy(), angular.copy()
    for joints in skeleton.levels()[1:]:
        parents = skeleton.parents[joints]
        parent_rot, parent_ang = world_rot[..., parents, :], world_ang[..., parents, :]
        arm = quat.rotate(parent_rot, positions[..., joints, :])
        world_pos[..., joints, :] = world_pos[..., parents, :] + arm
        world_rot[..., joints, :] = quat.mul(parent_rot, rotations[..., joints, :])
        world_vel[..., joints, :] = (
            world_vel[..., parents, :]
            + quat.rotate(parent_rot, velocities[..., joints, :])
            + np.cross(parent_ang, arm)
        )
        world_ang[..., joints, :] = parent_ang + quat.rotate(parent_rot, angular[..., joints, :])
    return world_pos, world_rot, world_vel, world_ang


def local(skeleton: Skeleton, world_pos: Array, world_rot: Array) -> tuple[Array, Array]:
    """Inverse of `forward`."""
    positions, rotations = np.empty_like(world_pos, order="C"), np.empty_like(world_rot, order="C")
    kernels.local(skeleton.parents, *map(_flat, (world_pos, world_rot, positions, rotations)))
    return positions, rotations


def local_numpy(skeleton: Skeleton, world_pos: Array, world_rot: Array) -> tuple[Array, Array]:
    """The obvious twin of `local`."""
    positions, rotations = world_pos.copy(), world_rot.copy()
    child = np.arange(1, len(skeleton))
    inverse = quat.inv(world_rot[..., skeleton.parents[child], :])
    rotations[..., child, :] = quat.mul(inverse, world_rot[..., child, :])
    positions[..., child, :] = quat.rotate(
        inverse, world_pos[..., child, :] - world_pos[..., skeleton.parents[child], :]
    )
    return positions, rotations


def _flat(array: Array) -> Array:
    """[..., J, C] as the kernels' [T, J, C]."""
    return np.ascontiguousarray(array).reshape(-1, *array.shape[-2:])


def _central(step: Array, fps: float) -> Array:
    """Rates [T, ...] from the steps between frames [T-1, ...]; ends continue the inner acceleration."""
    rate = np.empty((len(step) + 1, *step.shape[1:]), step.dtype)
    if len(step) == 0:
        rate[:] = 0
    elif len(step) < 3:
        rate[:-1], rate[-1] = step * fps, step[-1] * fps
    else:
        rate[1:-1] = (step[1:] + step[:-1]) * (fps / 2)
        # The second step of the acceleration, as the public reference has it (in four frames the first).
        i = 2 if len(rate) > 4 else 1
        rate[0] = rate[1] - (rate[i + 1] - rate[i])
        rate[-1] = rate[-2] + (rate[-2] - rate[-3])
    return rate


def velocities(positions: Array, fps: float) -> Array:
    """Time derivative of positions [T, ...] per second, by central differences.

    The two end frames are extrapolated from their neighbours (REFERENCE 2.6's public implementation).
    """
    return _central(np.diff(positions, axis=0), fps)[: len(positions)]


def angular_velocities(rotations: Array, fps: float) -> Array:
    """Angular velocity [T, ..., 3] (rad/s, in the parent's frame) of rotations [T, ..., 4]."""
    return _central(rotation_steps(rotations), fps)[: len(rotations)]


def rotation_steps(rotations: Array) -> Array:
    """Turns [T-1, ..., 3] between rotations [T, ..., 4] of frames: scaled axes in the parent's frame."""
    steps = np.empty((max(len(rotations) - 1, 0), *rotations.shape[1:-1], 3), rotations.dtype)
    joints = rotations[0, ..., 0].size if len(rotations) else 1
    kernels.rotation_steps(
        np.ascontiguousarray(rotations).reshape(-1, joints, 4), steps.reshape(-1, joints, 3)
    )
    return steps


def angular_velocities_numpy(rotations: Array, fps: float) -> Array:
    """The obvious twin of `angular_velocities`."""
    steps = quat.log(quat.shortest(quat.mul(rotations[1:], quat.inv(rotations[:-1]))))
    return _central(steps, fps)


def unroll(rotations: Array) -> Array:
    """`quat.unroll` of rotations [T, J, 4], compiled."""
    out = np.array(rotations, order="C")
    kernels.unroll(out)
    return out
