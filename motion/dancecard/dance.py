"""A list of moves as a clip with exact labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import quat
from ..clip import Clip
from . import arms, feet, legs, pelvis, rhythm, steps, trunk
from .figure import FIGURE
from .labels import Labels, label
from .path import Move, Path, plan
from .style import Style

FPS = 60.0


@dataclass(frozen=True, eq=False)
class Passage:
    """A dance: its clip of T frames at 60 Hz, its labels, and the path that was planned."""

    clip: Clip
    labels: Labels
    path: Path

    @property
    def name(self) -> str:
        """The clip's."""
        return self.clip.name


def perform(moves: Sequence[Move], *, name: str, style: Style, rng: np.random.Generator) -> Passage:
    """Dance moves one after the other, from a stand at the origin on."""
    path = plan(moves, FPS)
    stances = steps.walk(path, style, rng)
    tracks = (
        feet.track(stances[0], stances[1], path.time, path.running, style.foot_lift),
        feet.track(stances[1], stances[0], path.time, path.running, style.foot_lift),
    )
    beat = rhythm.rhythm(path, *tracks, style, rng)
    position, rotation = pelvis.carry(path, *tracks, beat, style)
    joints = trunk.hold(path, *tracks, beat, style, rotation) | arms.swing(path, beat, style)
    for side, foot, sign in (("Left", tracks[0], 1.0), ("Right", tracks[1], -1.0)):
        leg = legs.bend(position, rotation, foot, sign)
        joints |= {side + joint: bent for joint, bent in leg.items()}
    rotations = np.stack([rotation, *(joints[joint] for joint in FIGURE.names[1:])], axis=1)
    positions = np.repeat(FIGURE.offsets[None], len(path.time), axis=0)
    positions[:, 0] = position
    clip = Clip(name, FIGURE, FPS, positions, quat.unroll(rotations))
    return Passage(clip, label(path, stances, tracks, beat.stand), path)
