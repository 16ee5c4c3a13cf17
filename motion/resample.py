"""Other frame rates, and pieces of a clip."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from . import kinematics_kernels as kernels
from .clip import Clip
from .errors import UserError

# Files print frame times with few digits (0.008333 for 120 Hz): rates this near to a whole ratio are at it.
_ROUNDING = 1e-4
MOST_FRAMES = 10_000_000  # of a clip that is resampled: two days at 60 frames a second


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
    if step == 1 or len(clip) == 0:
        return clip.replace(fps=fps)
    if step == round(step):
        whole = slice(None, None, round(step))
        return clip.replace(fps=fps, positions=clip.positions[whole], rotations=clip.rotations[whole])
    count = frames_after(len(clip), step)
    if count > MOST_FRAMES:
        raise UserError(
            f"{len(clip)} frames at {clip.fps:g} fps are {count:,} at {fps:g}, at most {MOST_FRAMES:,} fit",
            path=clip.source,
            remedy="give a lower rate, or the right one of the file",
        )
    times = sample_times(len(clip), step)
    before, share = _split(times)
    rotations = np.empty((len(times), *clip.rotations.shape[1:]))
    kernels.slerp_frames(clip.rotations, before, share, rotations)
    return clip.replace(fps=fps, positions=_interpolate(clip.positions, times, method), rotations=rotations)


def frame_step(rate: float, fps: float) -> float:
    """Frames at rate for each frame at fps; whole, or one over whole, where the rates allow it."""
    step = rate / fps
    for whole in (round(step), 1 / max(round(1 / step), 1)):
        if whole > 0 and abs(step / whole - 1) < _ROUNDING:
            return float(whole)
    return step


def sample_times(frames: int, step: float) -> NDArray[np.float64]:
    """Instants 0, step, 2 step, ... in frames, up to the last frame (rounding errors beyond it included)."""
    return np.minimum(np.arange(frames_after(frames, step)) * step, frames - 1)


def frames_after(frames: int, step: float) -> int:
    """How many `sample_times` there are."""
    return int(np.floor((frames - 1) / step + 1e-6)) + 1 if frames else 0


def crop(clip: Clip, start: int = 0, stop: int | None = None) -> Clip:
    """Frames start to stop (exclusive) of a clip; an empty range or one beyond the clip is a UserError."""
    stop = len(clip) if stop is None else stop
    if not 0 <= start < stop <= len(clip):
        raise UserError(
            f"cannot crop {clip.name} to frames {start} to {stop}: it has {len(clip)} frames, "
            f"{clip.seconds:.2f} s",
            path=clip.source,
            remedy="start within the clip and stop after that",
        )
    return clip.replace(positions=clip.positions[start:stop], rotations=clip.rotations[start:stop])


def _split(times: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Frame before each instant, and how far it lies towards the next, with instants on frames snapped."""
    before = np.floor(times + 1e-9).astype(np.int64)
    return before, np.where(times - before > 1e-9, times - before, 0.0)


def _interpolate(values: NDArray[np.float64], times: NDArray[np.float64], method: str) -> NDArray[np.float64]:
    """Values [T, J, 3] at instants [K]; joints that never move, nearly all, are only copied."""
    out = np.repeat(values[:1], len(times), axis=0)
    moving = np.flatnonzero((values != values[0]).any(axis=(0, 2)))
    if len(moving) == 0:
        return out
    known = values[:, moving].reshape(len(values), -1)
    curvature = np.zeros_like(known)
    if method == "cubic":
        _curvature(known, curvature)
    found = np.empty((len(times), known.shape[1]))
    _evaluate(known, curvature, *_split(times), found)
    out[:, moving] = found.reshape(len(times), len(moving), -1)
    return out


@numba.njit(cache=True, nogil=True)
def _curvature(y, m):
    """Second derivatives m [T, C] at the knots of the cubic spline through y [T, C], one frame apart.

    "Not-a-knot" ends, as ``scipy.interpolate.CubicSpline`` has them: m_0 - 2 m_1 + m_2 = 0 turns the first of
    m_{i-1} + 4 m_i + m_{i+1} = 6 d_i, d the second differences, into m_1 = d_1. Solved by elimination.
    """
    n = len(y)
    if n < 3:
        m[:] = 0
        return
    upper = np.zeros(n)
    for i in range(1, n - 1):
        inner = 1 < i < n - 2
        pivot = 4 - upper[i - 1] if inner else 1.0
        upper[i] = 1 / pivot if inner else 0.0
        for c in range(y.shape[1]):
            d = y[i + 1, c] - 2 * y[i, c] + y[i - 1, c]
            m[i, c] = (6 * d - m[i - 1, c]) / pivot if inner else d
    for i in range(n - 3, 0, -1):
        for c in range(y.shape[1]):
            m[i, c] -= upper[i] * m[i + 1, c]
    for c in range(y.shape[1]):
        m[0, c] = 2 * m[1, c] - m[2, c] if n > 3 else m[1, c]
        m[n - 1, c] = 2 * m[n - 2, c] - m[n - 3, c] if n > 3 else m[1, c]


@numba.njit(cache=True, nogil=True)
def _evaluate(y, m, before, share, out):
    """The spline with values y and second derivatives m at frames before [K] + share [K], into out [K, C]."""
    for k in range(len(before)):
        i, s = before[k], share[k]
        j, r = min(i + 1, len(y) - 1), 1 - s
        for c in range(y.shape[1]):
            bend = (r * r * r - r) * m[i, c] + (s * s * s - s) * m[j, c]
            out[k, c] = r * y[i, c] + s * y[j, c] + bend / 6
