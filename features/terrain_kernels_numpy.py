"""The obvious twin of `features.terrain_kernels`, for the tests to compare."""

from __future__ import annotations

import numpy as np


def sample(heights, spacing, x0, z0, x, z, out):
    u, v = ((np.asarray(w, np.float64) - o) / spacing for w, o in ((x, x0), (z, z0)))
    out[:] = _between(heights, *(np.clip(w, 0, n - 1) for w, n in zip((u, v), heights.shape, strict=True)))


def sample_patches(heights, transforms, points, out):
    """See `features.terrain_kernels.sample_patches`."""
    u, v = np.moveaxis(
        np.einsum("pab,mb->pma", transforms[..., :2], points) + transforms[:, None, :, 2], -1, 0
    )
    out[:] = _between(heights, *(_reflect(w, n - 1) for w, n in zip((u, v), heights.shape, strict=True)))


def misfits(heights, transforms, down, down_y, up, up_y, over, weight, gap, out):
    """See `features.terrain_kernels.misfits`."""
    ground_down, ground_up = np.empty((len(transforms), len(down))), np.empty((len(transforms), len(up)))
    sample_patches(heights, transforms, down, ground_down)
    sample_patches(heights, transforms, up, ground_up)
    mean = ground_down.mean(axis=1, keepdims=True)
    contact = np.sum((ground_down - mean - down_y) ** 2, axis=1) / len(down)
    above = up_y - (ground_up - mean)
    clear = np.maximum(-above, 0) ** 2 + over * np.maximum(above - gap, 0) ** 2
    out[:] = weight * contact + np.sum(clear, axis=1) / max(len(up), 1)


def _between(heights, u, v):
    safe = [np.where(np.isnan(u + v), 0, w) for w in (u, v)]
    i, j = (np.minimum(w.astype(np.int64), n - 2) for w, n in zip(safe, heights.shape, strict=True))
    a, b = u - i, v - j
    near = (1 - b) * heights[i, j] + b * heights[i, j + 1]
    far = (1 - b) * heights[i + 1, j] + b * heights[i + 1, j + 1]
    return (1 - a) * near + a * far


def _reflect(u, last):
    return last - np.abs(np.mod(u, 2 * last) - last)
