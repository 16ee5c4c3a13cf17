"""Smooth curves: ramps, quintic Hermite splines, band-limited wandering, filters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]


def ease(x: Array) -> Array:
    """From 0 to 1 with speed and acceleration zero at both ends: minimum jerk (Flash and Hogan 1985)."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10 + x * (6 * x - 15))


def smoothstep(x: Array) -> Array:
    """From 0 to 1 with speed zero at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)


def hermite(times: Array, values: Array, rates: Array, at: Array) -> Array:
    """The curve through knots (times [K] ascending) with given rates and no acceleration there, at times [T].

    Constant before the first and after the last knot.
    """
    i = np.clip(np.searchsorted(times, at, "right") - 1, 0, len(times) - 2)
    span = times[i + 1] - times[i]
    x = np.clip((at - times[i]) / span, 0.0, 1.0)
    x3 = x * x * x
    up = x3 * (10 + x * (6 * x - 15))
    out = x - x3 * (6 + x * (3 * x - 8))
    back = -x3 * (4 + x * (3 * x - 7))
    return values[i] * (1 - up) + values[i + 1] * up + span * (rates[i] * out + rates[i + 1] * back)


def travel(x: Array, speeds: Sequence[tuple[float, float]]) -> Array:
    """From 0 to 1 while x goes from 0 to 1, at speeds (x, relative speed) joined by smoothsteps."""
    x = np.clip(x, 0.0, 1.0)
    way, whole = np.zeros_like(x), 0.0
    for (start, before), (stop, after) in pairwise(speeds):
        y = np.clip((x - start) / (stop - start), 0.0, 1.0)
        way += (stop - start) * (before * y + (after - before) * y * y * y * (1 - y / 2))
        whole += (stop - start) * (before + after) / 2
    return way / whole


def smooth(values: Array, frames: float) -> Array:
    """Gaussian filter along axis 0, of a standard deviation in frames; ends repeat."""
    return ndimage.gaussian_filter1d(values, frames, axis=0, mode="nearest", truncate=3.0)


def wander(
    rng: np.random.Generator, frames: int, fps: float, channels: int, slowest: float, fastest: float
) -> Array:
    """Smooth random curves [T, channels] of unit variance, periods between slowest and fastest seconds."""
    waves, block = 4, 64
    period = np.exp(rng.uniform(np.log(fastest), np.log(slowest), (channels, waves, 1)))
    start = rng.uniform(0, 2 * np.pi, (channels, waves, 1))
    # The sine of a sum: of where a block begins, and of the frame in it.
    rate = 2 * np.pi / (fps * period)
    begin, inside = start + rate * block * np.arange(-(-frames // block)), rate * np.arange(block)
    sum_ = np.matmul(np.sin(begin).swapaxes(1, 2), np.cos(inside))
    sum_ += np.matmul(np.cos(begin).swapaxes(1, 2), np.sin(inside))
    return np.ascontiguousarray(sum_.reshape(channels, -1)[:, :frames].T) * np.sqrt(2 / waves)


def dot(a: Array, b: Array) -> Array:
    """Scalar products [...] of vectors [..., K]."""
    product: Array = np.einsum("...i,...i->...", a, b)
    return product


def cross(a: Array, b: Array) -> Array:
    """Vector products [T, 3]; np.cross spends most of its time on generality."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    out = np.empty_like(a)
    out[:, 0], out[:, 1], out[:, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return out
