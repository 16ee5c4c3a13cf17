"""Rest poses that a converter put before a capture, and the blend out of them.

Some files begin with a T-pose for the sake of retargeting tools, and a filter that ran afterwards smeared it
into the frames that follow. Neither is motion: left in, they make velocities of tens of metres a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import quat
from .clip import Clip

REST_ANGLE = 0.25  # radians by which joints may miss zero rotation in a rest pose
JUMP, CALM = 25.0, 10.0  # rad/s of the fastest joint: above what limbs do; about what they do
LONGEST = 0.15  # seconds that a blend may last


def starts_at_rest(clip: Clip) -> bool:
    """Whether the first frame is an inserted rest pose (zero rotations but for the root).

    The clip leaves it at a steady speed then, as a filter smears a step. In files resampled after the
    insertion, where the first frame is but a part of the blend, the speed falls at once.
    """
    if len(clip) < 4 or len(clip.skeleton) < 2:
        return False
    angles = quat.angle_between(clip.rotations[0, 1:], quat.identity(1))
    speeds = _speeds(clip, 3)
    return bool(np.all(angles < REST_ANGLE) and speeds[0] > JUMP and speeds[2] > speeds[0] / 2)


def lead_in(clip: Clip) -> int:
    """How many first frames are a rest pose or the blend out of it; 0 for clips that begin with motion."""
    if len(clip) < 3 or len(clip.skeleton) < 2:
        return 0
    # A blend's first frame may itself be half out of the rest pose: most joints still are at rest. Joints
    # that never leave it (fingers) tell nothing.
    turns = np.abs(clip.rotations[:, 1:, 0]).min(axis=0) < np.cos(REST_ANGLE / 2)
    if not turns.any():
        return 0
    angles = quat.angle_between(clip.rotations[0, 1:][turns], quat.identity(1))
    frames = min(len(clip) - 1, max(2, round(LONGEST * clip.fps)))
    speeds = _speeds(clip, frames)
    if not (np.median(angles) < REST_ANGLE and speeds[0] > JUMP):
        return 0
    # What begins in a sprint is never calm: there the speed falls once the blend is over, or it was none.
    calm = np.flatnonzero(speeds < CALM)
    slower = calm if len(calm) else np.flatnonzero(speeds < speeds[0] / 2)
    return int(slower[0]) if len(slower) else 0


def without_lead_in(clip: Clip) -> Clip:
    """The clip from its first captured frame on; the same clip if there is no lead-in."""
    count = lead_in(clip)
    if count == 0:
        return clip
    return clip.replace(positions=clip.positions[count:], rotations=clip.rotations[count:])


def _speeds(clip: Clip, frames: int) -> NDArray[np.float64]:
    """Angular speed [frames] of the fastest joint below the root, between first frames, rad/s."""
    first = clip.rotations[: frames + 1, 1:]
    return quat.angle_between(first[:-1], first[1:]).max(axis=-1) * clip.fps
