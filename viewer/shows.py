"""What is shown: anything that has poses at any time, as clips and recorded runs have."""

from __future__ import annotations

import os
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mm.recording import Recording
from motion import anatomy, files, kinematics, quat, root, sources
from motion.clip import Clip
from motion.errors import UserError
from motion.gltf import Skin
from motion.gltf import skin as skin_of
from motion.options import about
from motion.skeleton import Skeleton

from .body import Body, body, bones
from .timeline import between

Array = NDArray[np.floating]

SKINNED = (".gltf", ".glb")
MOST = 64  # characters of a recording that are shown


class Worn(NamedTuple):
    """A skin, and the joints [J'] of a show's skeleton that it hangs on, in its order."""

    skin: Skin
    joints: NDArray[np.int64]


class Show(Protocol):
    """N characters of one skeleton, in metres, at any time.

    Attributes
    ----------
    name : what stands above them.
    skeleton : J joints; where one has the role root, it is joint 0, on the ground, +Z ahead.
    body : what they look like.
    skin : the mesh of a file that they wear instead, and which joints of the skeleton are its own; or None.
    fps : frames a second at which new poses come; between them poses are interpolated.
    count : N.
    seconds : how long it lasts; None: as long as one looks.
    """

    name: str
    skeleton: Skeleton
    body: Body
    skin: Worn | None
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
        self.skin: Worn | None = None
        self.positions = np.asarray(positions, np.float32)
        self.rotations = np.asarray(rotations, np.float32)
        self.count = positions.shape[1]
        self.seconds: float | None = (len(positions) - 1) / fps

    def __repr__(self) -> str:
        return f"Recorded({self.name!r}, {self.count} x {len(self.skeleton)} joints, {self.seconds} s)"

    def clip(self, character: int = 0) -> Clip:
        """What one character does, as a clip."""
        rotations = quat.normalize(self.rotations[:, character].astype(np.float64))
        positions = self.positions[:, character].astype(np.float64)
        return Clip(self.name, self.skeleton, self.fps, positions, quat.unroll(rotations))

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


def load(path: str | os.PathLike[str], *, skinned: bool = True) -> Recorded:
    """The show of a motion file or of a recording (`mm run --record`), whichever path is.

    skinned : whether a glTF file's own mesh is shown, where it has one, not a body made of its skeleton.
    Errors: UserError for what is neither; of a file with several animations one is named, ``hero.glb#Walk``.
    """
    if files.kind(sources.split(path)[0]) == "file" and files.format_of(sources.split(path)[0]):
        return of_recording(Recording.load(path), name=os.path.splitext(os.path.basename(path))[0])
    clip = sources.load(path)
    file, animation = sources.split(path)
    with about(file):
        show = of_clip(clip)
        if skinned and file.suffix.lower() in SKINNED:
            worn = skin_of(file, animation)
            show.skin = None if worn is None else _worn(worn, clip.skeleton, show.skeleton)
    return show


def of_clip(clip: Clip) -> Recorded:
    """A show of a clip; it gets a ground root where its roles tell hips."""
    if len(clip) == 0:
        raise UserError("no frames to show")
    clip = grounded(clip)
    shape = shape_of(clip)
    return Recorded(
        clip.name, clip.skeleton, clip.fps, clip.positions[:, None], clip.rotations[:, None], shape
    )


def of_recording(run: Recording, *, name: str | None = None, shape: Body | None = None) -> Recorded:
    """A show of a recorded run: its characters, the first `MOST` of them; shape is what they look like."""
    if len(run) == 0:
        raise UserError("no frames to show")
    positions, rotations = run["positions"][:, :MOST], run["rotations"][:, :MOST]
    shape = shape_of(run.clip(0)) if shape is None else shape
    return Recorded(name or run.system, run.skeleton, run.fps, positions, rotations, shape)


def _worn(skin: Skin, own: Skeleton, shown: Skeleton) -> Worn | None:
    """The skin on the joints of a skeleton that may have got a ground root, or another one than its own."""
    if own.roles.get("root") is not None and (skin.joints == own.roles["root"]).any():
        return None  # its root is ours now, and turned otherwise
    first = len(shown) - len(own)
    return Worn(skin, np.arange(first, len(shown)))


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
