"""What is shown: anything that has poses at any time, as clips and recorded runs have."""

from __future__ import annotations

import os
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mm.recording import Recording
from motion import anatomy, files, kinematics, root, sources
from motion.clip import Clip
from motion.errors import UserError
from motion.options import about
from motion.skeleton import Skeleton

from .body import Body, body, bones
from .timeline import between

Array = NDArray[np.floating]

MOST = 64  # characters of a recording that are shown


class Show(Protocol):
    """N characters of one skeleton, in metres, at any time.

    Attributes
    ----------
    name : what stands above them.
    skeleton : J joints; where one has the role root, it is joint 0, on the ground, +Z ahead.
    body : what they look like.
    fps : frames a second at which new poses come; between them poses are interpolated.
    count : N.
    seconds : how long it lasts; None: as long as one looks.
    """

    name: str
    skeleton: Skeleton
    body: Body
    fps: float
    count: int
    seconds: float | None

    def pose(self, time: float) -> tuple[Array, Array]:
        """World positions [N, J, 3] and rotations [N, J, 4] at a time, seconds from the start."""
        ...


class Recorded:
    """A `Show` of poses that are known: local transforms positions [T, N, J, 3], rotations [T, N, J, 4]."""

    def __init__(
        self, name: str, skeleton: Skeleton, fps: float, positions: Array, rotations: Array, shape: Body
    ) -> None:
        self.name, self.skeleton, self.fps, self.body = name, skeleton, fps, shape
        self.positions = np.asarray(positions, np.float32)
        self.rotations = np.asarray(rotations, np.float32)
        self.count = positions.shape[1]
        self.seconds: float | None = (len(positions) - 1) / fps

    def __repr__(self) -> str:
        return f"Recorded({self.name!r}, {self.count} x {len(self.skeleton)} joints, {self.seconds} s)"

    def pose(self, time: float) -> tuple[Array, Array]:
        """See `Show`; before the start and after the end it stands still."""
        frame = float(np.clip(time * self.fps, 0, len(self.positions) - 1))
        before = int(frame + 1e-6)
        share = frame - before
        positions, rotations = self.positions[before], self.rotations[before]
        if share > 1e-6:
            after = self.positions[before + 1], self.rotations[before + 1]
            positions, rotations = between((positions, rotations), after, share)
        return kinematics.forward(self.skeleton, positions, rotations)


def load(path: str | os.PathLike[str]) -> Recorded:
    """The show of a motion file or of a recording (`mm run --record`), whichever path is.

    Errors: UserError for what is neither; of a file with several animations one is named, ``hero.glb#Walk``.
    """
    if files.kind(sources.split(path)[0]) == "file" and files.format_of(sources.split(path)[0]):
        return of_recording(Recording.load(path), name=os.path.splitext(os.path.basename(path))[0])
    clip = sources.load(path)
    with about(sources.split(path)[0]):
        return of_clip(clip)


def of_clip(clip: Clip) -> Recorded:
    """A show of a clip; it gets a ground root where its roles tell hips."""
    if len(clip) == 0:
        raise UserError("no frames to show")
    clip = grounded(clip)
    shape = shape_of(clip)
    return Recorded(
        clip.name, clip.skeleton, clip.fps, clip.positions[:, None], clip.rotations[:, None], shape
    )


def of_recording(run: Recording, *, name: str | None = None) -> Recorded:
    """A show of a recorded run: its characters, the first `MOST` of them."""
    if len(run) == 0:
        raise UserError("no frames to show")
    positions, rotations = run["positions"][:, :MOST], run["rotations"][:, :MOST]
    return Recorded(name or run.system, run.skeleton, run.fps, positions, rotations, shape_of(run.clip(0)))


def grounded(clip: Clip) -> Clip:
    """The clip with a ground root as joint 0; the clip as it is where no roles tell hips and a facing."""
    try:
        return root.ground(clip)
    except UserError:
        return clip


def shape_of(clip: Clip) -> Body:
    """A body for a clip's skeleton, of bare bones where its roles tell too little."""
    try:
        return body(anatomy.anatomy(clip.skeleton, [clip]))
    except UserError:
        return bones(clip.skeleton)
