"""What the numbers are that a mode-adaptive network takes and gives: a frame as vectors (REFERENCE 5).

Spaces and units are `lmm.pfnn.layout`'s: the trajectory around frame t and the joints at t - 1 go in, each in
its own frame's root; the joints at t come out, and how their root goes on.

With 27 joints and no contacts these are the dog's published sizes: 12 x (position, direction and velocity,
x and z; speed; six actions) + 27 x 12 = 480 in; the root's 3, 6 x (position, direction, velocity, x and z)
and 27 x 12 = 363 out; velocities of four feet, a speed and six actions, 19, at the gate. 27 are the dog's 21
joints and the ends of its 6 chains, which here are no joints. The order within the published vectors is not
told; here it is by block, as in `lmm.pfnn.layout`. Nor are the six actions; here they are the gaits of
`features.gait`, which tells them of four legs, too: whether a dog that does not walk paces, trots or canters,
is left to its speed. Contacts are put out besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motion import quat

from ..layout import rotations
from ..locomotion.layout import BlockLayout
from ..locomotion.window import FUTURE, GAITS, PRESENT, SAMPLES, slices

Array = NDArray[np.float32]

FORWARD, UP = np.array([0, 0, 1], np.float32), np.array([0, 1, 0], np.float32)


@dataclass(eq=False)
class Inputs:
    """What N frames are made of before they are vectors. Samples of the trajectory are the past's first.

    Attributes
    ----------
    path, facing : float32 [N, 12, 2], positions and unit directions x, z of the trajectory.
    gaits : float32 [N, 12, 6], weights by `GAITS`: the actions.
    going : float32 [N, 12, 2], the root's velocity x, z with which it comes there, m/s.
    speeds : float32 [N, 12], the speed wanted there, m/s.
    positions, velocities : float32 [N, J, 3], of the joints of the frame before, metres and m/s.
    rotations : float32 [N, J, 4], theirs, in root space.
    """

    path: Array
    facing: Array
    gaits: Array
    going: Array
    speeds: Array
    positions: Array
    rotations: Array
    velocities: Array


@dataclass(eq=False)
class Outputs:
    """What N frames are made of after they were vectors.

    Attributes
    ----------
    root_velocity : float32 [N, 2], x, z, m/s, to the next frame.
    turn_rate : float32 [N], rad/s; positive turns +Z to +X.
    contacts : float32 [N, C], 0 to 1.
    path, facing, going : float32 [N, 6, 2], trajectory from the next frame on, in its root.
    positions, velocities : float32 [N, J, 3], metres and m/s.
    rotations : float32 [N, J, 4], in root space.
    """

    root_velocity: Array
    turn_rate: Array
    contacts: Array
    path: Array
    facing: Array
    going: Array
    positions: Array
    rotations: Array
    velocities: Array


@dataclass(frozen=True)
class Layout(BlockLayout):
    """The vectors of a skeleton with so many joints, the ground root not counted, and so many contacts.

    Inputs, 156 + 12 J numbers: of the 12 samples all x, then all z of the positions, of the directions, then
    the gaits one after the other, all x, then all z of the velocities, the speeds; the joints' positions,
    joint by joint, their rotations as vectors forward (+Z turned) and up (+Y turned), their velocities.

    Outputs, 39 + C + 12 J numbers: the root's velocity x, z, its turn rate, C contacts; of the 6 samples
    positions, directions and velocities; the joints' positions, rotations and velocities.
    """

    input_type, output_type = Inputs, Outputs

    @cached_property
    def inputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        return slices(
            path=2 * SAMPLES,
            facing=2 * SAMPLES,
            gaits=len(GAITS) * SAMPLES,
            going=2 * SAMPLES,
            speeds=SAMPLES,
            positions=3 * self.joints,
            rotations=6 * self.joints,
            velocities=3 * self.joints,
        )

    @cached_property
    def outputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        return slices(
            root_velocity=2,
            turn_rate=1,
            contacts=self.contacts,
            path=2 * FUTURE,
            facing=2 * FUTURE,
            going=2 * FUTURE,
            positions=3 * self.joints,
            rotations=6 * self.joints,
            velocities=3 * self.joints,
        )

    def gate_columns(self, ends: Sequence[int]) -> NDArray[np.int64]:
        """The inputs [3 E + 7] that the gate sees: velocities of E joints, speed and gaits wanted now.

        ends are joints without the ground root, end effectors.
        """
        velocities, speeds, gaits = (self.inputs[name].start for name in ("velocities", "speeds", "gaits"))
        of_ends = velocities + 3 * np.asarray(ends, np.int64)[:, None] + np.arange(3)
        wanted = gaits + SAMPLES * np.arange(len(GAITS)) + PRESENT
        return np.concatenate([of_ends.ravel(), [speeds + PRESENT], wanted]).astype(np.int64)

    def written(self, rotations: Array) -> NDArray:
        return to_axes(rotations)

    def turned(self, numbers: Array) -> NDArray:
        return from_axes(numbers)


def to_axes(rotations: NDArray) -> NDArray:
    """Rotations [..., 4] as vectors [..., 6]: forward, +Z turned, and up, +Y turned."""
    return np.concatenate([quat.rotate(rotations, axis) for axis in (FORWARD, UP)], axis=-1)


def from_axes(axes: NDArray) -> NDArray:
    """Rotations [..., 4] of vectors [..., 6], forward and up; up gives way if they are no right angle.

    Vectors that are 0 or lie along each other turn nothing; what is no number stays none.
    """
    forward, up = axes[..., :3], axes[..., 3:]
    left = np.cross(up, forward)
    return rotations(np.stack([left, np.cross(forward, left)], axis=-1))
