"""Sampling heightmaps and patches of them, compiled; `features.terrain_kernels_numpy` is the twin."""

from __future__ import annotations

import math

import numba
import numpy as np

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


@_jit
def sample(heights, spacing, x0, z0, x, z, out):
    """Write the bilinear heights [M] of a map [R, C] at x, z [M] to out; beyond its edges as at the edge."""
    last_u, last_v = len(heights) - 1.0, heights.shape[1] - 1.0
    for i in range(len(x)):
        u, v = (x[i] - x0) / spacing, (z[i] - z0) / spacing
        if math.isnan(u + v):
            out[i] = np.nan
        else:
            out[i] = between(heights, min(max(u, 0.0), last_u), min(max(v, 0.0), last_v))


@numba.njit(inline="always", cache=True)
def between(heights, u, v):
    """The height at row u and column v, which lie inside."""
    i, j = min(int(u), heights.shape[0] - 2), min(int(v), heights.shape[1] - 2)
    a, b = u - i, v - j
    near = heights[i, j] + b * (heights[i, j + 1] - heights[i, j])
    far = heights[i + 1, j] + b * (heights[i + 1, j + 1] - heights[i + 1, j])
    return near + a * (far - near)


@numba.njit(inline="always", cache=True)
def reflect(u, last):
    """A coordinate on a map that goes on beyond its edges 0 and last as in a mirror."""
    u -= 2 * last * math.floor(u / (2 * last))
    return min(max(min(u, 2 * last - u), 0.0), last)


@_jit
def sample_patches(heights, transforms, points, out):
    """Write heights [P, M] of patches at points [M, 2] (x, z from their middles, metres) to out.

    transforms [P, 2, 3] take x, z, 1 to row and column of the map heights [R, C], which goes on beyond its
    edges as in a mirror.
    """
    last_u, last_v = len(heights) - 1.0, heights.shape[1] - 1.0
    for p in range(len(transforms)):
        t = transforms[p]
        for m in range(len(points)):
            x, z = points[m, 0], points[m, 1]
            u = reflect(t[0, 0] * x + t[0, 1] * z + t[0, 2], last_u)
            v = reflect(t[1, 0] * x + t[1, 1] * z + t[1, 2], last_v)
            out[p, m] = between(heights, u, v)


@_jit
def misfits(heights, transforms, down, down_y, up, up_y, over, weight, gap, out):
    """Write how badly patches meet feet to out [P], m^2 (Holden, Komura and Saito 2017, equations 10 to 13).

    down [D, 2] and up [U, 2] are the places x, z of feet in contact and off it, from the patches' middles;
    down_y [D] and up_y [U] their heights from the mean of those in contact; over [U] is 1 where a foot off
    contact jumps, so that ground more than gap (metres) below it counts. weight is that of contacts.
    """
    last_u, last_v = len(heights) - 1.0, heights.shape[1] - 1.0
    ground = np.empty(len(down))
    for p in range(len(transforms)):
        t = transforms[p]
        mean = 0.0
        for m in range(len(down)):
            x, z = down[m, 0], down[m, 1]
            u = reflect(t[0, 0] * x + t[0, 1] * z + t[0, 2], last_u)
            v = reflect(t[1, 0] * x + t[1, 1] * z + t[1, 2], last_v)
            ground[m] = between(heights, u, v)
            mean += ground[m] / len(down)
        contact, clear = 0.0, 0.0
        for m in range(len(down)):
            contact += (ground[m] - mean - down_y[m]) ** 2
        for m in range(len(up)):
            x, z = up[m, 0], up[m, 1]
            u = reflect(t[0, 0] * x + t[0, 1] * z + t[0, 2], last_u)
            v = reflect(t[1, 0] * x + t[1, 1] * z + t[1, 2], last_v)
            above = up_y[m] - (between(heights, u, v) - mean)
            clear += max(-above, 0.0) ** 2 + over[m] * max(above - gap, 0.0) ** 2
        out[p] = weight * contact / len(down) + clear / max(len(up), 1)
