"""Key frames: values of animation samplers at any instants, and the frame rate that keys were taken at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import kinematics_kernels as kernels
from .. import quat

Array = NDArray[np.float64]

DEFAULT_FPS = 60.0  # where keys are too far apart to tell
_SLOWEST, _FASTEST = 20.0, 250.0  # rates that keys every so often are taken for
_RATES = tuple(map(float, "20 24 25 30 48 50 60 72 75 90 96 100 120 144 150 180 200 240 250".split()))
_NEAR = 0.01  # frames by which an instant may miss a key and still be at it: times are float32


@dataclass(frozen=True, eq=False)
class Sampler:
    """Keys of one property of a node.

    Attributes
    ----------
    times : [K] seconds, not falling.
    values : [K, C]; for CUBICSPLINE [K, 3, C]: tangent in, value, tangent out.
    interpolation : LINEAR, STEP or CUBICSPLINE.
    """

    times: Array
    values: Array
    interpolation: str


class Instants:
    """Where instants [T] (seconds) lie among keys: the key before each and the share on to the next."""

    def __init__(self, times: Array, instants: Array, fps: float) -> None:
        last = len(times) - 1
        near = _NEAR / fps
        before = np.clip(np.searchsorted(times, instants + near, side="right") - 1, 0, last)
        gap = times[np.minimum(before + 1, last)] - times[before]
        passed = instants - times[before]
        inside = (passed > near) & (gap > 0)
        self.before = before
        self.share = np.where(inside, np.clip(passed / np.where(inside, gap, 1), 0, 1), 0.0)
        self.gap = gap

    @cached_property
    def after(self) -> NDArray[np.int64]:
        """The key at or after each instant."""
        return self.before + (self.share > 0)


def sample(values: Array, interpolation: str, at: Instants) -> Array:
    """Values [T, C] by the specification's formulas (appendix C), straight lines for LINEAR."""
    if interpolation == "STEP":
        return values[at.before]
    t = at.share[:, None]
    if interpolation == "LINEAR":
        start = values[at.before]
        return start + t * (values[at.after] - start)
    before, after, gap = values[at.before], values[at.after], at.gap[:, None]
    return (
        (2 * t**3 - 3 * t**2 + 1) * before[:, 1]
        + gap * (t**3 - 2 * t**2 + t) * before[:, 2]
        + (-2 * t**3 + 3 * t**2) * after[:, 1]
        + gap * (t**3 - t**2) * after[:, 0]
    )


def slerp(values: Array, at: Instants) -> Array:
    """Rotations [T, G, 4] between keys [K, G, 4], unit quaternions, on the short side."""
    out = np.empty((len(at.before), *values.shape[1:]))
    kernels.slerp_frames(np.ascontiguousarray(values), at.before, at.share, out)
    return out


def rotations(values: Array) -> Array:
    """Our unit quaternions (w, x, y, z) from the format's (x, y, z, w) ``[..., 4]``."""
    return quat.normalize(np.roll(values, 1, axis=-1))


def frame_rate(times: Sequence[Array]) -> float:
    """Frames a second that keys at times [K] (seconds, several samplers') were taken at.

    One over the most common distance of keys, times a small whole number where keys were thinned out, and a
    common rate where it is within 1 % of one. `DEFAULT_FPS` where keys are farther apart than that tells.
    """
    gaps = np.concatenate([np.diff(t) for t in times])
    gaps = gaps[gaps > 1e-4]
    if len(gaps) == 0:
        return DEFAULT_FPS
    rounded, counts = np.unique(np.round(gaps, 4), return_counts=True)
    commonest = rounded[np.argmax(counts)]
    rate = 1 / float(np.median(gaps[np.abs(gaps - commonest) <= 1e-4]))
    if rate > 1000:
        return DEFAULT_FPS
    for whole in range(1, 13):
        if rate * whole > _FASTEST:
            break
        if rate * whole >= _SLOWEST / 1.01 and np.mean(_on_grid(gaps * rate * whole)) > 0.95:
            return _common(rate * whole)
    return _common(rate) if rate >= _SLOWEST / 1.01 else DEFAULT_FPS


def _on_grid(frames: Array) -> NDArray[np.bool_]:
    """Whether distances are whole numbers of frames, to 5 % of one and the precision of times."""
    return np.abs(frames - np.round(frames)) < 0.05 + 1e-3 * frames


def _common(rate: float) -> float:
    near = min(_RATES, key=lambda known: abs(known - rate))
    if abs(near / rate - 1) < 0.01:
        return near
    return float(round(rate)) if abs(round(rate) / rate - 1) < 0.001 else rate
