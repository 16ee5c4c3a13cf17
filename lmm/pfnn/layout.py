"""What the numbers are that a phase-functioned network takes and gives: a frame as vectors (REFERENCE 4.2).

Everything is in the space of the ground root of its frame, in metres, seconds and radians. What goes in is
the trajectory around frame t and the joints at t - 1, each in its own frame's root; what comes out are the
joints at t in the root of t, and how that root goes on: the trajectory from t + 1 on is in the root of t + 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motion import quat

from ..locomotion.layout import BlockLayout
from ..locomotion.window import FUTURE, GAITS, SAMPLES, SIDES, slices

Array = NDArray[np.float32]


@dataclass(eq=False)
class Inputs:
    """What N frames are made of before they are vectors. Samples of the trajectory are the past's first.

    Attributes
    ----------
    path : float32 [N, 12, 2], positions x, z of the trajectory, metres.
    facing : float32 [N, 12, 2], its directions x, z, unit.
    gaits : float32 [N, 12, 6], weights by `GAITS`.
    positions, velocities : float32 [N, J, 3], of the joints of the frame before, metres and m/s.
    heights : float32 [N, 12, 3], of the ground to the right, in the middle and to the left, over the root's.
    """

    path: Array
    facing: Array
    gaits: Array
    positions: Array
    velocities: Array
    heights: Array


@dataclass(eq=False)
class Outputs:
    """What N frames are made of after they were vectors.

    Attributes
    ----------
    root_velocity : float32 [N, 2], x, z, m/s, to the next frame.
    turn_rate : float32 [N], rad/s; positive turns +Z to +X.
    phase_rate : float32 [N], rad/s.
    contacts : float32 [N, C], 0 to 1.
    path, facing : float32 [N, 6, 2], trajectory from the next frame on, in its root.
    positions, velocities : float32 [N, J, 3], metres and m/s.
    rotations : float32 [N, J, 4], in root space; `Layout.pack_outputs` keeps the sign that they have.
    """

    root_velocity: Array
    turn_rate: Array
    phase_rate: Array
    contacts: Array
    path: Array
    facing: Array
    positions: Array
    velocities: Array
    rotations: Array


@dataclass(frozen=True)
class Layout(BlockLayout):
    """The vectors of a skeleton with so many joints, the ground root not counted, and so many contacts.

    Inputs, 156 + 6 J numbers: of the 12 samples all x, then all z of the positions, then of the directions,
    then the gaits, one after the other; the joints' positions, then their velocities, joint by joint; of the
    12 samples all heights to the right, then in the middle, then to the left.

    Outputs, 28 + C + 9 J numbers: the root's velocity x, z, its turn rate, the phase's rate, C contacts; of
    the 6 samples all x, then all z of the positions, then of the directions; the joints' positions, their
    velocities, and their rotations in root space as exponential maps: axis times *half* the angle.
    """

    contacts: int = 4

    input_type, output_type = Inputs, Outputs

    @cached_property
    def inputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        return slices(
            path=2 * SAMPLES,
            facing=2 * SAMPLES,
            gaits=len(GAITS) * SAMPLES,
            positions=3 * self.joints,
            velocities=3 * self.joints,
            heights=SIDES * SAMPLES,
        )

    @cached_property
    def outputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        return slices(
            root_velocity=2,
            turn_rate=1,
            phase_rate=1,
            contacts=self.contacts,
            path=2 * FUTURE,
            facing=2 * FUTURE,
            positions=3 * self.joints,
            velocities=3 * self.joints,
            rotations=3 * self.joints,
        )

    def written(self, rotations: Array) -> NDArray:
        return quat.log(rotations) / 2

    def turned(self, numbers: Array) -> NDArray:
        return quat.exp(2 * numbers)
