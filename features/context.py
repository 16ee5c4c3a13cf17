"""What a feature is computed from: joints and the ground root's trajectory, seen from the ground root."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import quat
from motion.pose import Poses
from motion.skeleton import Skeleton

Array = NDArray[np.floating]

END_SECONDS = 0.2  # over which the speed and turn rate at a clip's end are taken
_IDENTITY = np.array([1, 0, 0, 0], np.float32)


class Context:
    """What a feature is computed from, for n consecutive frames; joints are evaluated when first asked for.

    All that the methods return is in the frame of each frame's ground root: origin on the ground under the
    character, +Z its facing.

    Attributes
    ----------
    skeleton : J joints, joint 0 the ground root.
    fps : frames per second.
    frames : slice of the n frames in `poses`.
    poses : all T frames, local transforms as the database holds them.
    """

    def __init__(self, skeleton: Skeleton, poses: Poses, samples: Samples, frames: slice) -> None:
        self.skeleton, self.fps, self.poses, self.frames = skeleton, samples.fps, poses, frames
        self._samples = samples
        self._placed: dict[int, tuple[Array, Array]] = {}
        self._moved: dict[int, tuple[Array, Array]] = {}

    def __len__(self) -> int:
        return self.frames.stop - self.frames.start

    def position(self, role: str) -> Array:
        """Position [n, 3] of a joint, metres."""
        return self._place(self.skeleton.role(role))[0]

    def rotation(self, role: str) -> Array:
        """Rotation [n, 4] of a joint."""
        return self._place(self.skeleton.role(role))[1]

    def velocity(self, role: str) -> Array:
        """Velocity [n, 3] of a joint, m/s: the world's, expressed in the root's frame."""
        return self._move(self.skeleton.role(role))[0]

    def angular_velocity(self, role: str) -> Array:
        """Angular velocity [n, 3] of a joint, rad/s: the world's, expressed in the root's frame."""
        return self._move(self.skeleton.role(role))[1]

    def trajectory_positions(self, times: ArrayLike, beyond: str = "clamp") -> Array:
        """Ground root (x, z) [n, K, 2] at times [K] seconds from each frame, metres."""
        times = np.atleast_1d(np.asarray(times, np.float64))
        found = self._samples.at(self._samples.positions, times, self.frames)
        if beyond == "continue":
            found = found + self._samples.carried_on(times, self.frames)[0]
        return self._turn(found - self._samples.positions[self.frames, None])

    def trajectory_directions(self, times: ArrayLike, beyond: str = "clamp") -> Array:
        """Facing (x, z) [n, K, 2], unit length, of the ground root at times [K] seconds from each frame."""
        times = np.atleast_1d(np.asarray(times, np.float64))
        found = self._samples.at(self._samples.facings, times, self.frames)
        if beyond == "continue":
            found = _rotated(found, self._samples.carried_on(times, self.frames)[1])
        length = np.sqrt(np.sum(found * found, axis=-1, keepdims=True))
        return self._turn(found / np.where(length > 0, length, 1))

    def _turn(self, vectors: Array) -> Array:
        """World (x, z) [n, K, 2] into the frames of the roots."""
        facing = self._samples.facings[self.frames, None]
        sin, cos, x, z = facing[..., 0], facing[..., 1], vectors[..., 0], vectors[..., 1]
        return np.stack([cos * x - sin * z, sin * x + cos * z], axis=-1)

    def _place(self, joint: int) -> tuple[Array, Array]:
        """Position and rotation of a joint, from its parent's."""
        if joint not in self._placed:
            position: Array = self.poses.positions[self.frames, joint]
            rotation: Array = self.poses.rotations[self.frames, joint]
            parent = int(self.skeleton.parents[joint])
            if parent < 0:
                position, rotation = np.zeros_like(position), np.broadcast_to(_IDENTITY, rotation.shape)
            elif parent > 0:
                parent_position, parent_rotation = self._place(parent)
                position = parent_position + quat.rotate(parent_rotation, position)
                rotation = quat.mul(parent_rotation, rotation)
            self._placed[joint] = position, rotation
        return self._placed[joint]

    def _move(self, joint: int) -> tuple[Array, Array]:
        """Velocity and angular velocity of a joint: v_p + R_p v' + w_p x R_p x' and w_p + R_p w'."""
        if joint not in self._moved:
            velocity: Array = self.poses.velocities[self.frames, joint]
            angular: Array = self.poses.angular_velocities[self.frames, joint]
            parent = int(self.skeleton.parents[joint])
            if parent < 0:
                inverse = quat.inv(self.poses.rotations[self.frames, joint])
                self._moved[joint] = quat.rotate(inverse, velocity), quat.rotate(inverse, angular)
            else:
                parent_position, parent_rotation = self._place(parent)
                parent_velocity, parent_angular = self._move(parent)
                arm = self._place(joint)[0] - parent_position
                if parent > 0:
                    velocity, angular = (
                        quat.rotate(parent_rotation, velocity),
                        quat.rotate(parent_rotation, angular),
                    )
                velocity = parent_velocity + velocity + np.cross(parent_angular, arm)
                self._moved[joint] = velocity, parent_angular + angular
        return self._moved[joint]


class Samples:
    """The ground root's path and facing over all frames, and its samples at other times."""

    def __init__(self, poses: Poses, fps: float, starts: ArrayLike, stops: ArrayLike) -> None:
        starts, stops = np.asarray(starts, np.int64), np.asarray(stops, np.int64)
        edges = np.append(starts, len(poses))
        if not np.array_equal(edges[1:], stops) or edges[0] != 0 or np.any(stops <= starts):
            raise ValueError(
                f"ranges {starts} to {stops} do not cover {len(poses)} frames one after the other"
            )
        self.poses, self.fps = poses, float(fps)
        self.first = np.repeat(starts, stops - starts)
        self.last = np.repeat(stops - 1, stops - starts)

    @cached_property
    def positions(self) -> Array:
        """x, z of the ground root in the world [T, 2]."""
        return np.ascontiguousarray(self.poses.positions[:, 0, ::2])

    @cached_property
    def facings(self) -> Array:
        """x, z of its +Z axis in the world [T, 2], unit length."""
        w, x, y, z = self.poses.rotations[:, 0].T
        facing = np.stack([2 * (x * z + w * y), 1 - 2 * (x * x + y * y)], axis=-1)
        return facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-12)

    def at(self, values: Array, times: NDArray[np.float64], frames: slice) -> Array:
        """Values [T, 2] at times [K] seconds from frames: [n, K, 2]; between two frames, interpolated."""
        shift = times * self.fps
        whole = np.where(np.abs(shift - np.rint(shift)) < 1e-3, np.rint(shift), np.floor(shift)).astype(
            np.int64
        )
        part = np.maximum(shift - whole, 0).astype(values.dtype)
        part[part < 1e-3] = 0
        here = np.arange(frames.start, frames.stop)[:, None] + whole
        first, last = self.first[frames, None], self.last[frames, None]
        found = values[np.clip(here, first, last)]
        if np.any(part):
            found += part[:, None] * (values[np.clip(here + 1, first, last)] - found)
        return found

    @cached_property
    def ends(self) -> tuple[Array, Array, Array, Array]:
        """How ranges begin and end: velocities [T, 2], turn rates [T] at the first and at the last frame."""
        steps = np.clip(np.rint(END_SECONDS * self.fps).astype(np.int64), 1, None)
        rates = []
        for near, far in (
            (self.first, np.minimum(self.first + steps, self.last)),
            (self.last, np.maximum(self.last - steps, self.first)),
        ):
            seconds = (far - near) / self.fps
            seconds = np.where(seconds == 0, np.inf, seconds)
            (x0, z0), (x1, z1) = self.facings[near].T, self.facings[far].T
            turned = np.arctan2(x1 * z0 - z1 * x0, x1 * x0 + z1 * z0)
            chord = (self.positions[far] - self.positions[near]) / seconds[:, None]
            # On an arc the tangent at the end has turned by half of the turn from the chord.
            rates.append(_rotated(chord, -turned / 2) / np.sinc(turned / (2 * np.pi))[:, None])
            rates.append(turned / seconds)
        return rates[0], rates[1], rates[2], rates[3]

    def carried_on(self, times: NDArray[np.float64], frames: slice) -> tuple[Array, Array]:
        """Displacement [n, K, 2] and turn [n, K] since a range's end, where times lie beyond it; else 0.

        Speed and turn rate stay: the path is an arc whose velocity turns at w, so over t it moves
        (sin(wt)/w v_x + (1 - cos(wt))/w v_z, sin(wt)/w v_z - (1 - cos(wt))/w v_x).
        """
        at = np.arange(frames.start, frames.stop)[:, None] + times * self.fps
        before, after = at - self.first[frames, None], at - self.last[frames, None]
        over = np.where(before < 0, before, np.maximum(after, 0)) / self.fps
        v0, w0, v1, w1 = (rate[frames, None] for rate in self.ends)
        early = before < 0
        velocity, rate = np.where(early[..., None], v0, v1), np.where(early, w0, w1)
        angle = rate * over
        along = over * np.sinc(angle / np.pi)
        aside = over * np.sinc(angle / (2 * np.pi)) * np.sin(angle / 2)
        x, z = velocity[..., 0], velocity[..., 1]
        moved = np.stack([along * x + aside * z, along * z - aside * x], axis=-1)
        return moved.astype(np.float32), angle


def _rotated(vectors: Array, angles: Array) -> Array:
    """Ground vectors (x, z) [..., 2] turned about the vertical by angles [...]."""
    sin, cos, x, z = np.sin(angles), np.cos(angles), vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x + sin * z, cos * z - sin * x], axis=-1)
