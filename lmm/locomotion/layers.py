"""Layers whose weights are mixed of weight sets, row by row, compiled; `layers_numpy` is the obvious twin.

A layer is linear in its weights: x W = the sum over weight sets of share x W_s. So a row is laid out as one
of all sets that it needs, [share_1 x, share_1, share_2 x, share_2, ..], and goes through plain products with
the sets' weights and biases on top of each other. Rows of one first set go together.
"""

from __future__ import annotations

import numba
import numpy as np

from ..kernels import all_times_pairs, all_times_panel, elu_of, listed_times_layer, panel_at
from ..lanes import PANEL, TALL, ZERO, panel_to_floats, round_to_pairs
from ..tiles import close_tiles, open_tiles

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

BLOCK = 96  # rows that go through all layers together, at most
# Up to so many rows each goes by itself, past inputs that are 0: of one set; of several, whose weights do not
# stay in the cache from row to row; and of half floats, which are made floats for many rows.
FEW, FEW_BLENDED, FEW_HALVES = 3, 1, 6
MANY = 2 * TALL  # from so many rows on, a panel is copied to stand in few cache lines


@_jit
def evaluate(x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y):
    """Write the outputs of x [N, I] to y [N, O], of weights that are sums over sets by shares [N, used].

    order [N] are rows by their first set, ends where each set's rows end; of a row the used sets from its
    first on, round the cycle, count. layers, weights, numbers: see `lmm.locomotion.evaluator.Packed`; the
    rest is scratch for N rows.
    """
    few = FEW_HALVES if weights.itemsize < 4 else FEW_BLENDED if used > 1 else FEW
    block, begin = len(work), 0
    for s in range(len(ends)):
        while begin < ends[s]:
            rows = min(block, ends[s] - begin)
            _normalise(x, order[begin : begin + rows], numbers, work)
            for layer in range(len(layers)):
                inputs, outputs = layers[layer, 0], layers[layer, 1] * PANEL
                for n in range(rows):
                    _widen(work[n], shares[order[begin + n]], inputs, layers[layer, 4], wide[n])
                if rows <= few:
                    for n in range(rows):
                        _one_row(
                            layers[layer], weights, numbers, sets, used, s, wide[n], active, panel, work[n]
                        )
                else:
                    _many_rows(layers[layer], weights, numbers, sets, used, s, wide, rows, panel, work)
                if layer < len(layers) - 1:
                    for n in range(rows):
                        elu_of(work[n], outputs)
            _put(work, order[begin : begin + rows], y)
            begin += rows


@_jit
def evaluate_pairs(tiles, x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel,
                   active, y):  # fmt: skip
    """As `evaluate`, of weights in pairs (`lmm.lanes`): inputs of every layer are rounded to bfloat16.

    tiles: whether the process may use the processor's matrix tiles (`lmm.tiles`).
    """
    few = 1 if tiles else FEW
    pairs, listed = wide.view(np.uint32), panel.view(np.uint32)
    block, begin = len(work), 0
    if tiles:
        open_tiles()
    for s in range(len(ends)):
        while begin < ends[s]:
            rows = min(block, ends[s] - begin)
            _normalise(x, order[begin : begin + rows], numbers, work)
            for layer in range(len(layers)):
                inputs, outputs, depth = layers[layer, 0], layers[layer, 1] * PANEL, layers[layer, 4]
                for n in range(rows):
                    _widen(work[n], shares[order[begin + n]], inputs, 2 * depth, wide[n])
                    row = wide.ctypes.data + 4 * n * wide.shape[1]
                    round_to_pairs(row, row, used * depth)
                if rows <= few:
                    for n in range(rows):
                        _one_row(
                            layers[layer], weights, numbers, sets, used, s, pairs[n], active, listed, work[n]
                        )
                else:
                    _many_rows_of_pairs(
                        layers[layer], weights, numbers, sets, used, s, wide, rows, listed, tiles, work
                    )
                if layer < len(layers) - 1:
                    for n in range(rows):
                        elu_of(work[n], outputs)
            _put(work, order[begin : begin + rows], y)
            begin += rows
    if tiles:
        close_tiles()


@_jit
def _put(work, rows, y):
    for n in range(len(rows)):
        row = rows[n]
        for o in range(y.shape[1]):
            y[row, o] = work[n, o]


@_jit
def _normalise(x, rows, numbers, work):
    """Rows of x, each number in units of its column's deviation."""
    inputs = x.shape[1]
    for n in range(len(rows)):
        row = rows[n]
        for i in range(inputs):
            work[n, i] = (x[row, i] - numbers[i]) / numbers[inputs + i]


@_jit
def _widen(row, shares, inputs, depth, wide):
    """A row and a 1 behind it, times every share, each with 0 up to depth numbers."""
    for u in range(len(shares)):
        at, part = u * depth, shares[u]
        for i in range(inputs):
            wide[at + i] = part * row[i]
        wide[at + inputs] = part
        for i in range(inputs + 1, depth):
            wide[at + i] = 0


@_jit
def _one_row(layer, weights, numbers, sets, used, s, wide, active, values, y):
    """One row through one layer: only inputs, or pairs, that are not 0 count."""
    depth, panels, first = layer[4], layer[1], layer[2]
    scale = numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    count = ZERO
    for u in range(used):
        begin = (s + u) % sets * depth
        for i in range(depth):
            value = wide[u * depth + i]
            active[count], values[count] = begin + i, value
            count += value != 0
    listed, value, to = active.ctypes.data, values.ctypes.data, y.ctypes.data
    listed_times_layer(weights, first, sets * depth, panels, listed, value, count, scale, bias, ZERO, to)


@_jit
def _many_rows(layer, weights, numbers, sets, used, s, wide, rows, floats, y):
    """Rows through one layer, panel by panel; rows beyond, up to a multiple of SHORT, are computed too."""
    depth, panels, first = layer[4], layer[1], layer[2]
    scale = numbers.ctypes.data + 4 * layer[3]
    bias, x, to = scale + 4 * panels * PANEL, ZERO + wide.ctypes.data, ZERO + y.ctypes.data
    for p in range(panels):
        at, stride = panel_at(first, sets * depth, panels, p)
        if weights.itemsize == 4 and rows <= MANY and s + used <= sets:
            panel, step = weights.ctypes.data + 4 * (at + s * depth * stride), stride
        else:
            panel, step = ZERO + floats.ctypes.data, PANEL
            for u in range(used):
                begin = (s + u) % sets * depth
                panel_to_floats(weights, at + begin * stride, stride, depth, panel + 4 * u * depth * PANEL)
        place = 4 * p * PANEL
        all_times_panel(
            rows, x, wide.shape[1], panel, step, used * depth, scale + place, bias + place, ZERO, to + place,
            y.shape[1],
        )  # fmt: skip


@_jit
def _many_rows_of_pairs(layer, weights, numbers, sets, used, s, wide, rows, copied, tiles, y):
    """As `_many_rows`, of pairs; rows beyond go up to a multiple of TILE where there are tiles."""
    depth, panels, first = layer[4], layer[1], layer[2]
    scale = numbers.ctypes.data + 4 * layer[3]
    bias, x, to = scale + 4 * panels * PANEL, ZERO + wide.ctypes.data, ZERO + y.ctypes.data
    for p in range(panels):
        at, stride = panel_at(first, sets * depth, panels, p)
        panel, step = weights.ctypes.data + 4 * (at + s * depth * stride), stride
        if s + used > sets:
            panel, step = ZERO + copied.ctypes.data, PANEL
            for i in range(used * depth):
                row = at + (s * depth + i) % (sets * depth) * stride
                copied[i * PANEL : (i + 1) * PANEL] = weights[row : row + PANEL]
        place = 4 * p * PANEL
        all_times_pairs(
            tiles, rows, x, wide.shape[1], panel, step, used * depth, scale + place, bias + place, ZERO,
            to + place, y.shape[1],
        )  # fmt: skip
