"""The learned stages' hot loops, compiled; `lmm.kernels_numpy` is the obvious twin of every function here."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from mm.codecs.kernels import half as float_of_half

from .lanes import (
    GROUP,
    PANEL,
    SHORT,
    TALL,
    ZERO,
    active_times_panels,
    panel_to_floats,
    round_to_pairs,
    rows_times_pairs,
    rows_times_panel,
    split_to_pairs,
)
from .tiles import TALL_TILES, TILE, close_tiles, open_tiles, tiles_times_pairs

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

BLOCK = 96  # rows that go through all layers together, at most: what lies between them stays in the cache
# Up to so many rows each goes by itself, past inputs that are 0; more need floats, made of compact weights.
FEW, FEW_COMPACT = 3, 6
MANY = 2 * TALL  # from so many rows on, a panel of floats is copied, too, to stand in few cache lines
LOWEST, SMALL, ONE, TWO = np.float32(-17), np.float32(1 / 64), np.float32(1), np.float32(2)
SERIES = tuple(np.float32(1 / math.factorial(n)) for n in range(2, 7))  # of exp(y) - 1, from y^2 on
TINY: Any = np.float32(1e-8)  # shorter columns of a rotation are no direction


@_jit
def evaluate(x, layers, weights, numbers, columns, elu, rows_between, panel, active, y):
    """Write the network's outputs of x [N, I] to columns [V] of y [N, O]; the other columns are left alone.

    layers, weights, numbers: see `lmm.evaluator.Packed`; elu says which activation; rows_between, panel and
    active are scratch for any N, see `lmm.evaluator.Packed.scratch`.
    """
    count, inputs = x.shape
    last, block, width = len(layers) - 1, rows_between.shape[1], rows_between.shape[2]
    work = rows_between.reshape(rows_between.size)
    few = FEW if weights.itemsize == 4 else FEW_COMPACT
    for start in range(0, count, block):
        rows = min(block, count - start)
        _normalise(x, start, rows, numbers, inputs, work, width)
        from_, to = ZERO, block * width
        for layer in range(last + 1):
            rectify = 1 if layer < last and not elu else 0
            if rows <= few:
                for n in range(rows):
                    _one_row(
                        layers[layer], weights, numbers, work[from_ + n * width :], rectify, active, panel,
                        work[to + n * width :],
                    )  # fmt: skip
            else:
                _many_rows(layers[layer], weights, numbers, work, from_, rows, width, rectify, panel, to)
            if layer < last and elu:
                _elu(work, to, rows, width, layers[layer, 1] * PANEL)
            from_, to = to, from_
        _put(work, from_, rows, width, columns, y, start)


@_jit
def evaluate_pairs(tiles, split, x, layers, weights, numbers, columns, elu, rows_between, panel, active, y):
    """As `evaluate`, of weights in pairs (`lmm.lanes`): inputs of every layer are rounded to bfloat16.

    tiles: whether the process may use the processor's matrix tiles (`lmm.tiles`); split: whether inputs are
    sums of two bfloat16 numbers, 16 pairs of the larger ones before 16 of the smaller, and weights likewise
    stand there twice.
    """
    count, last = len(x), len(layers) - 1
    block, width = rows_between.shape[1], rows_between.shape[2]
    work = rows_between.reshape(rows_between.size)
    pairs, listed, few = work.view(np.uint32), panel.view(np.uint32), 1 if tiles else FEW
    if tiles:
        open_tiles()
    for start in range(0, count, block):
        rows = min(block, count - start)
        _normalise(x, start, rows, numbers, layers[0, 0] if split else 2 * layers[0, 0], work, width)
        from_, to = ZERO, block * width
        for layer in range(last + 1):
            rectify = 1 if layer < last and not elu else 0
            for n in range(rows):
                row = work.ctypes.data + 4 * (from_ + n * width)
                if split:
                    split_to_pairs(row, row, layers[layer, 0] // 2)
                else:
                    round_to_pairs(row, row, layers[layer, 0])
            if rows <= few:
                for n in range(rows):
                    _one_row(
                        layers[layer], weights, numbers, pairs[from_ + n * width :], rectify, active, listed,
                        work[to + n * width :],
                    )  # fmt: skip
            else:
                _many_rows_of_pairs(
                    layers[layer], weights, numbers, work, from_, rows, width, rectify, tiles, to
                )
            if layer < last and elu:
                _elu(work, to, rows, width, layers[layer, 1] * PANEL)
            from_, to = to, from_
        _put(work, from_, rows, width, columns, y, start)
    if tiles:
        close_tiles()


@_jit
def _normalise(x, start, rows, numbers, padded, work, width):
    """Rows from start on of x [N, I], each in units of its column's deviation, and 0 up to padded columns."""
    inputs = x.shape[1]
    for n in range(rows):
        for i in range(inputs):
            work[n * width + i] = (x[start + n, i] - numbers[i]) / numbers[inputs + i]
        for i in range(inputs, padded):
            work[n * width + i] = 0


@_jit
def _elu(work, at, rows, width, count):
    for n in range(rows):
        elu_of(work[at + n * width :], count)


@_jit
def elu_of(row, count):
    """x where positive, else exp(x) - 1, to a few parts in 10^7; loops over vectors, which expm1 does not.

    With e(y) = exp(y) - 1, e(2 y) = e(y) (e(y) + 2): six times from the series at y = x / 64.
    """
    for k in range(count):
        x = row[k]
        y = (LOWEST if x < LOWEST else x) * SMALL
        e = y * (ONE + y * (SERIES[0] + y * (SERIES[1] + y * (SERIES[2] + y * (SERIES[3] + y * SERIES[4])))))
        e = e * (e + TWO)
        e = e * (e + TWO)
        e = e * (e + TWO)
        e = e * (e + TWO)
        e = e * (e + TWO)
        e = e * (e + TWO)
        row[k] = x if x > 0 else e


@_jit
def _put(work, at, rows, width, columns, y, start):
    """Rows that begin at a place of work to columns [V] of y, from row start on."""
    for n in range(rows):
        for v in range(len(columns)):
            y[start + n, columns[v]] = work[at + n * width + v]


@_jit
def _one_row(layer, weights, numbers, x, rectify, active, values, y):
    """One row through one layer: only inputs that are not 0 count."""
    inputs, panels, first, scale = layer[0], layer[1], layer[2], numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    count = ZERO
    for i in range(inputs):
        active[count], values[count] = i, x[i]
        count += x[i] != 0
    listed, value, to = active.ctypes.data, values.ctypes.data, y.ctypes.data
    listed_times_layer(weights, first, inputs, panels, listed, value, count, scale, bias, rectify, to)


@_jit
def listed_times_layer(weights, first, inputs, panels, listed, value, count, scale, bias, rectify, y):
    """`active_times_panels` of all panels of a layer, which begins at number first of weights."""
    p = ZERO
    while p < panels:
        at, stride = panel_at(first, inputs, panels, p)
        place = 4 * p * PANEL
        if p + GROUP <= panels:
            active_times_panels(
                GROUP, weights, at, stride, listed, value, count, scale + place, bias + place, rectify,
                y + place,
            )  # fmt: skip
            p += GROUP
        elif p + 2 <= panels:
            active_times_panels(
                2, weights, at, stride, listed, value, count, scale + place, bias + place, rectify, y + place
            )
            p += 2
        else:
            active_times_panels(
                1, weights, at, stride, listed, value, count, scale + place, bias + place, rectify, y + place
            )
            p += 1


@_jit
def panel_at(first, inputs, panels, p):
    """Where panel p of a layer begins that begins at number first of the weights, and the stride of it."""
    group = p // GROUP * GROUP
    return first + PANEL * (group * inputs + p - group), PANEL * min(GROUP, panels - group)


@_jit
def _many_rows(layer, weights, numbers, work, from_, rows, width, rectify, floats, to):
    """Rows through one layer, panel by panel; rows beyond, up to a multiple of SHORT, are computed too."""
    inputs, panels, first, scale = layer[0], layer[1], layer[2], numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    x, y = work.ctypes.data + 4 * from_, work.ctypes.data + 4 * to
    for p in range(panels):
        at, stride = panel_at(first, inputs, panels, p)
        panel = weights.ctypes.data + 4 * at
        if weights.itemsize < 4 or rows > MANY:
            panel = ZERO + floats.ctypes.data
            panel_to_floats(weights, at, stride, inputs, panel)
            stride = PANEL
        place = 4 * p * PANEL
        all_times_panel(
            rows, x, width, panel, stride, inputs, scale + place, bias + place, rectify, y + place, width
        )


@_jit
def all_times_panel(rows, x, x_stride, panel, stride, inputs, scale, bias, rectify, y, y_stride):
    """`rows_times_panel` of any number of rows, and of those beyond up to a multiple of SHORT."""
    n = 0
    while n < rows:
        at, to = x + 4 * n * x_stride, y + 4 * n * y_stride
        if n + TALL <= rows:
            rows_times_panel(TALL, at, x_stride, panel, stride, inputs, scale, bias, rectify, to, y_stride)
            n += TALL
        else:
            rows_times_panel(SHORT, at, x_stride, panel, stride, inputs, scale, bias, rectify, to, y_stride)
            n += SHORT


@_jit
def _many_rows_of_pairs(layer, weights, numbers, work, from_, rows, width, rectify, tiles, to):
    """As `_many_rows`, of pairs; rows beyond go up to a multiple of TILE where there are tiles."""
    pairs, panels, first, scale = layer[0], layer[1], layer[2], numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    x, y = work.ctypes.data + 4 * from_, work.ctypes.data + 4 * to
    for p in range(panels):
        at, stride = panel_at(first, pairs, panels, p)
        panel, place = weights.ctypes.data + 4 * at, 4 * p * PANEL
        all_times_pairs(
            tiles, rows, x, width, panel, stride, pairs, scale + place, bias + place, rectify, y + place,
            width,
        )  # fmt: skip


@_jit
def all_times_pairs(tiles, rows, x, x_stride, panel, stride, pairs, scale, bias, rectify, y, y_stride):
    """As `all_times_panel`, of pairs, and of rows beyond up to a multiple of TILE where there are tiles."""
    n = 0
    while n < rows:
        at, to = x + 4 * n * x_stride, y + 4 * n * y_stride
        if tiles and n + TILE < rows:
            tiles_times_pairs(
                TALL_TILES, at, x_stride, panel, stride, pairs, scale, bias, rectify, to, y_stride
            )
            n += TALL_TILES
        elif tiles:
            tiles_times_pairs(TILE, at, x_stride, panel, stride, pairs, scale, bias, rectify, to, y_stride)
            n += TILE
        elif n + TALL <= rows:
            rows_times_pairs(TALL, at, x_stride, panel, stride, pairs, scale, bias, rectify, to, y_stride)
            n += TALL
        else:
            rows_times_pairs(SHORT, at, x_stride, panel, stride, pairs, scale, bias, rectify, to, y_stride)
            n += SHORT


@_jit
def rows_of(frames, features, latents, out):
    """Features [T, F] and latents [T, L], half floats seen as integers, of frames [N], to out [N, F + L]."""
    width = features.shape[1]
    for n in range(len(frames)):
        out[n, :width] = features[frames[n]]
        for c in range(latents.shape[1]):
            out[n, width + c] = float_of_half(latents[frames[n], c])


@_jit
def root_mean_square(a, b, scale, out):
    """To out [N] root mean squares of the differences of rows a, b [N, S], each column times its scale."""
    for n in range(len(a)):
        total = 0.0
        for c in range(a.shape[1]):
            total += (np.float64(a[n, c] - b[n, c]) * scale[c]) ** 2
        out[n] = math.sqrt(total / a.shape[1])


@_jit
def advance(values, rates, fps):
    """Add to values [N, S] what rates [N, S] per second make in a frame."""
    for n in range(values.shape[0]):
        for i in range(values.shape[1]):
            values[n, i] += rates[n, i] / fps


@_jit
def follow(near, last, tags, borne):
    """Go on from frames near [N], where they are any (not -1), to the next ones, at most to the last [T] of
    their ranges; write which of tags [T], where those are known (not None), they bear [N]."""
    for n in range(len(near)):
        if near[n] >= 0:
            near[n] = min(near[n] + 1, last[near[n]])
            if tags is not None:
                borne[n] = tags[near[n]]


@_jit
def unpack(vectors, fps, positions, rotations, velocities, angular, contacts):
    """Poses [N, J, ..] and contacts [N, C] of vectors [N, D]; see `lmm.layout.Layout.unpack`."""
    joints = positions.shape[1]
    n = joints - 1
    for i in range(len(vectors)):
        vector = vectors[i]
        for j in range(1, joints):
            for a in range(3):
                at = 3 * (j - 1) + a
                positions[i, j, a] = vector[at]
                velocities[i, j, a] = vector[9 * n + at]
                angular[i, j, a] = vector[12 * n + at]
            at = 3 * n + 6 * (j - 1)
            w, x, y, z = rotation(
                vector[at], vector[at + 2], vector[at + 4], vector[at + 1], vector[at + 3], vector[at + 5]
            )
            rotations[i, j, 0], rotations[i, j, 1] = w, x
            rotations[i, j, 2], rotations[i, j, 3] = y, z
        root = 15 * n
        vx, vz, rate = vector[root], vector[root + 2], vector[root + 4]
        half = rate / (2 * fps)
        c, s = math.cos(half), math.sin(half)
        positions[i, 0, 0], positions[i, 0, 1] = (c * vx + s * vz) / fps, 0
        positions[i, 0, 2] = (c * vz - s * vx) / fps
        rotations[i, 0, 0], rotations[i, 0, 1], rotations[i, 0, 2], rotations[i, 0, 3] = c, 0, s, 0
        velocities[i, 0, 0], velocities[i, 0, 1], velocities[i, 0, 2] = vx, 0, vz
        angular[i, 0, 0], angular[i, 0, 1], angular[i, 0, 2] = 0, rate, 0
        for a in range(contacts.shape[1]):
            contacts[i, a] = vector[root + 6 + a] > 0.5


@numba.njit(nogil=True, error_model="numpy", inline="always")
def rotation(xx, xy, xz, yx, yy, yz):
    """The quaternion of two columns x and y of a matrix, made orthonormal (Gram-Schmidt, Shepperd).

    Those without direction turn nothing.
    """
    one, half = np.float32(1), np.float32(0.5)
    length = one / max(math.sqrt(xx * xx + xy * xy + xz * xz), TINY)
    xx, xy, xz = xx * length, xy * length, xz * length
    zx, zy, zz = xy * yz - xz * yy, xz * yx - xx * yz, xx * yy - xy * yx
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    if length < TINY:
        return one, 0, 0, 0
    length = one / length
    zx, zy, zz = zx * length, zy * length, zz * length
    yx, yy, yz = zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx
    trace = xx + yy + zz
    if trace >= xx and trace >= yy and trace >= zz:
        w = math.sqrt(max(one + trace, TINY)) * half
        scale = one / (4 * w)
        return w, (yz - zy) * scale, (zx - xz) * scale, (xy - yx) * scale
    if xx >= yy and xx >= zz:
        x = math.sqrt(max(one + xx - yy - zz, TINY)) * half
        scale = one / (4 * x)
        return (yz - zy) * scale, x, (xy + yx) * scale, (zx + xz) * scale
    if yy >= zz:
        y = math.sqrt(max(one - xx + yy - zz, TINY)) * half
        scale = one / (4 * y)
        return (zx - xz) * scale, (xy + yx) * scale, y, (yz + zy) * scale
    z = math.sqrt(max(one - xx - yy + zz, TINY)) * half
    scale = one / (4 * z)
    return (xy - yx) * scale, (zx + xz) * scale, (yz + zy) * scale, z
