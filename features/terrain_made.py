"""Heightmaps out of a seed: hills, slopes and steps, for those without a captured landscape."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from motion.errors import UserError

from .terrain import SPACING, Heightmap

Kind = Literal["hills", "slopes", "steps", "mixed"]
KINDS: tuple[str, ...] = get_args(Kind)

Array = NDArray[np.float64]

MOST_POINTS = 20_000_000
# Metres: how wide hills are, widest first, and how high each kind is at scale 1 (one standard deviation).
_WIDTHS, _HILL_HEIGHT = (3.0, 1.2, 0.5), (0.35, 0.12, 0.03)
_FACETS, _CORNER = 1.6, 0.25  # metres from corner to corner of slopes; deviation of their heights
_TREAD, _RISER = 0.3, 0.17  # metres: a comfortable stair (two risers and a tread are 63 cm)
_BLOCKS, _BLOCK = 0.12, (0.5, 2.0)  # share of the ground under blocks; their sides, metres


def make(
    seed: int,
    kind: Kind = "mixed",
    *,
    size: tuple[float, float] = (20.0, 12.0),
    spacing: float = SPACING,
    scale: float = 1.0,
) -> Heightmap:
    """A heightmap of size metres along x and z, the same for the same seed; its median height is 0.

    hills are smooth, slopes are planes that meet in edges, steps are stairs and blocks; mixed goes from one
    to the other. scale multiplies heights.
    """
    if kind not in KINDS:
        raise UserError(f"no terrain of the kind {kind!r}", remedy=f"choose one of {', '.join(KINDS)}")
    for name, value in (("spacing", spacing), ("scale", scale), ("size", min(size))):
        if not 0 < value < 1e6:
            raise UserError(f"a terrain's {name} of {value:g}", remedy="give a number above 0")
    rows, columns = (max(2, round(length / spacing) + 1) for length in size)
    if rows * columns > MOST_POINTS:
        raise UserError(
            f"a terrain of {rows} x {columns} points", remedy="make it smaller, or its spacing wider"
        )
    rng = np.random.default_rng(seed)
    shape = (rows, columns)
    makers = {"hills": _hills, "slopes": _slopes, "steps": _steps}
    if kind != "mixed":
        heights = makers[kind](rng, shape, spacing)
    else:
        fields = np.stack([noise(rng, shape, spacing, 2.5) for _ in makers])
        shares = np.exp(3 * fields)
        shares /= shares.sum(axis=0)
        parts = np.stack([one(rng, shape, spacing) for one in makers.values()])
        heights = np.sum(shares * parts, axis=0)
    return Heightmap(((heights - np.median(heights)) * scale).astype(np.float32), spacing)


def noise(rng: np.random.Generator, shape: tuple[int, int], spacing: float, width: float) -> Array:
    """Smooth noise [R, C] of mean 0 and deviation 1: white noise under a Gaussian of width metres."""
    rows, columns = shape
    u = np.fft.fftfreq(rows, spacing)[:, None]
    v = np.fft.rfftfreq(columns, spacing)
    keep = np.exp(-2 * (np.pi * width / 2) ** 2 * (u * u + v * v))
    keep[0, 0] = 0
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * keep, s=shape)
    deviation = field.std()
    return field / deviation if deviation > 1e-12 else np.zeros(shape)


def _hills(rng: np.random.Generator, shape: tuple[int, int], spacing: float) -> Array:
    parts = zip(_WIDTHS, _HILL_HEIGHT, strict=True)
    return np.sum([height * noise(rng, shape, spacing, width) for width, height in parts], axis=0)


def _slopes(rng: np.random.Generator, shape: tuple[int, int], spacing: float) -> Array:
    """Triangles between corners of random height, one to two metres apart."""
    from scipy.interpolate import LinearNDInterpolator

    x, z = _grid(shape, spacing)
    corners = np.mgrid[-1 : x.max() / _FACETS + 2, -1 : z.max() / _FACETS + 2].reshape(2, -1).T
    corners = (corners + rng.uniform(-0.35, 0.35, corners.shape)) * _FACETS
    return LinearNDInterpolator(corners, rng.normal(0, _CORNER, len(corners)))(x, z)


def _steps(rng: np.random.Generator, shape: tuple[int, int], spacing: float) -> Array:
    """Stairs up and down along a bent direction, and blocks on them."""
    x, z = _grid(shape, spacing)
    angle = rng.uniform(0, 2 * np.pi)
    way = np.cos(angle) * x + np.sin(angle) * z + 0.5 * noise(rng, shape, spacing, 4.0)
    flight = rng.integers(3, 8)
    # Up a flight, along a landing, down again: a triangle wave with cut tops.
    period = 4 * flight * _TREAD
    wave = np.abs(np.mod(way / period, 1) - 0.5) * 4 * flight
    out = np.floor(np.clip(wave - flight / 2, 0, flight)) * _RISER
    blocks = round(_BLOCKS * x.max() * z.max() / np.mean(_BLOCK) ** 2)
    for _ in range(blocks):
        side, (mx, mz) = rng.uniform(*_BLOCK, 2), rng.uniform(0, 1, 2) * (x.max(), z.max())
        turned = rng.uniform(0, np.pi)
        along = np.cos(turned) * (x - mx) + np.sin(turned) * (z - mz)
        across = np.cos(turned) * (z - mz) - np.sin(turned) * (x - mx)
        inside = (np.abs(along) < side[0] / 2) & (np.abs(across) < side[1] / 2)
        out[inside] += rng.uniform(0.1, 0.45)
    return out


def _grid(shape: tuple[int, int], spacing: float) -> tuple[Array, Array]:
    x, z = (spacing * np.arange(count, dtype=np.float64) for count in shape)
    return np.broadcast_to(x[:, None], shape), np.broadcast_to(z, shape)
