"""Other frame rates, and pieces of a clip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from . import kinematics_kernels as kernels
from .clip import Clip
from .errors import UserError

# Files print frame times with few digits (0.008333 for 120 Hz): rates this near to a whole ratio are at it.
_ROUNDING = 1e-4


def resample(clip: Clip, fps: float, *, method: str = "cubic") -> Clip:
    """The clip at another frame rate, from any rate to any rate.

    Frame k of the result is at k / fps seconds; the last is the last that does not lie beyond the clip's end.
    Positions follow a cubic spline (method "cubic") or straight lines ("linear"), rotations are slerped.
    The clip's own rate returns the clip itself; a whole multiple or fraction of it keeps the shared frames.

    Errors: ValueError for another method or a rate that is not positive.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"frame rate {fps}, expected a positive number")
    if method not in ("cubic", "linear"):
        raise ValueError(f"method {method!r}, expected cubic or linear")
    if fps == clip.fps:
        return clip
    step = frame_step(clip.fps, fps)
    if step == 1:
        return clip.replace(fps=fps)
    if step == round(step):
        whole = slice(None, None, round(step))
        return clip.replace(fps=fps, positions=clip.positions[whole], rotations=clip.rotations[whole])
    times = sample_times(len(clip), step)
    before, share = _split(times)
    rotations = np.empty((len(times), *clip.rotations.shape[1:]))
    kernels.slerp_frames(clip.rotations, before, share, rotations)
    return clip.replace(
        fps=fps, positions=_interpolate(clip.positions, times, method), rotations=rotations
    )


def frame_step(rate: float, fps: float) -> float:
    """Frames at rate for each frame at fps; whole, or one over whole, where the rates allow it."""
    step = rate / fps
    for whole in (round(step), 1 / max(round(1 / step), 1)):
        if whole > 0 and abs(step / whole - 1) < _ROUNDING:
            return float(whole)
    return step


def sample_times(frames: int, step: float) -> NDArray[np.float64]:
    """Instants 0, step, 2 step, ... in frames, up to the last frame (rounding errors beyond it included)."""
    count = int(np.floor((frames - 1) / step + 1e-6)) + 1 if frames else 0
    return np.minimum(np.arange(count) * step, frames - 1)


def crop(clip: Clip, start: int = 0, stop: int | None = None) -> Clip:
    """Frames start to stop (exclusive) of a clip; an empty range or one beyond the clip is a UserError."""
    stop = len(clip) if stop is None else stop
    if not 0 <= start < stop <= len(clip):
        raise UserError(
            f"cannot crop {clip.name} to frames {start} to {stop}",
            path=clip.source,
            remedy=f"it has {len(clip)} frames, {clip.seconds:.2f} s",
        )
    return clip.replace(positions=clip.positions[start:stop], rotations=clip.rotations[start:stop])


def _split(times: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Frame before each instant, and how far it lies towards the next, with instants on frames snapped."""
    before = np.floor(times + 1e-9).astype(np.int64)
    return before, np.where(times - before > 1e-9, times - before, 0.0)


def _interpolate(
    values: NDArray[np.float64], times: NDArray[np.float64], method: str
) -> NDArray[np.float64]:
    """Values [T, J, 3] at instants [K]; joints that never move, nearly all, are only copied."""
    out = np.repeat(values[:1], len(times), axis=0)
    moving = np.flatnonzero((values != values[0]).any(axis=(0, 2)))
    if len(moving) == 0:
        return out
    if method == "cubic":
        out[:, moving] = CubicSpline(np.arange(len(values)), values[:, moving])(times)
        return out
    before, share = _split(times)
    a, b = values[before][:, moving], values[np.minimum(before + 1, len(values) - 1)][:, moving]
    out[:, moving] = a + share[:, None, None] * (b - a)
    return out
