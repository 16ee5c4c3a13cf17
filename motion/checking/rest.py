"""Rest poses that tools put into a capture: before it, after it, or between its frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import leadin
from ..roles import SIDES
from .body import Body
from .finding import Finding, spans

LEVEL = np.radians(20.0)  # arms of a T-pose from the line across the body, legs from the vertical
HELD = 0.3  # seconds; a T-pose held so long is for calibration, however it was reached


def findings(body: Body) -> list[Finding]:
    """Inserted rest poses: zero rotations reached by a jump, or the arms out like a T."""
    clip, frames = body.clip, len(body)
    found: list[Finding] = []
    first = leadin.lead_in(clip)
    if first:
        what = f"{_frames(0, first)}: a rest pose, or the blend out of it, before the capture"
        found.append(Finding("rest pose", 0, first, what, fatal=True))
    turned = clip.replace(positions=clip.positions[::-1], rotations=clip.rotations[::-1])
    last = leadin.lead_in(turned) if leadin.starts_at_rest(turned) else 0
    if last and first < frames - last:
        what = f"{_frames(frames - last, frames)}: a rest pose, or the blend into it, after the capture"
        found.append(Finding("rest pose", frames - last, frames, what, fatal=True))
    zero, tee = _unturned(body), _tee(body)
    posed = [(start, stop) for start, stop in spans(zero | tee) if first <= start and stop <= frames - last]
    if not posed:
        return found
    fastest = np.linalg.norm(body.rotation_steps[:, 1:], axis=-1).max(axis=1, initial=0) * body.fps
    for start, stop in posed:
        into = start == 0 or fastest[start - 1] > leadin.JUMP
        out = stop == frames or fastest[stop - 1] > leadin.JUMP
        inserted = into and out and (start > 0 or stop < frames)
        if inserted or (tee[start:stop].all() and body.seconds(start, stop) > HELD):
            how = "inserted into the capture" if inserted else f"held for {body.seconds(start, stop):.1f} s"
            what = f"{_frames(start, stop)}: a {'T-pose' if tee[start:stop].any() else 'rest pose'} {how}"
            found.append(Finding("rest pose", start, stop, what, fatal=True))
    return found


def _frames(start: int, stop: int) -> str:
    return f"frame {start}" if stop == start + 1 else f"frames {start} to {stop - 1}"


def _unturned(body: Body) -> NDArray[np.bool_]:
    """Frames [T] in which no joint but the root is turned."""
    if len(body.skeleton) < 2:
        return np.zeros(len(body), bool)
    # 2 acos w <= REST_ANGLE, for either sign of the quaternion.
    return (np.abs(body.clip.rotations[:, 1:, 0]) >= np.cos(leadin.REST_ANGLE / 2)).all(axis=1)


def _tee(body: Body) -> NDArray[np.bool_]:
    """Frames [T] in which both arms are stretched out sideways and both legs are straight down."""
    flags = np.ones(len(body), bool)
    if body.left is None or body.on_all_fours:
        return ~flags
    down = np.array([0.0, -1.0, 0.0])
    for side, sign in zip(SIDES, (1, -1), strict=True):
        out = sign * body.left
        limbs = (
            ("arm", "forearm", out),
            ("forearm", "hand", out),
            ("up_leg", "leg", down),
            ("leg", "foot", down),
        )
        for upper, lower, direction in limbs:
            joints = body.joints((f"{side}_{upper}", f"{side}_{lower}"))
            if not joints or not flags.any():
                return np.zeros(len(body), bool)
            bone = body.world[:, joints[1]] - body.world[:, joints[0]]
            flags &= (bone * direction).sum(axis=-1) > np.cos(LEVEL) * np.linalg.norm(bone, axis=-1)
    return flags
