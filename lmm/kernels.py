"""The learned stages' hot loops, compiled; `lmm.kernels_numpy` is the obvious twin of every function here."""

from __future__ import annotations

import math

import numba

from .lanes import PANEL, SHORT, TALL, active_times_panels, rows_times_panel, to_floats

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

BLOCK = 96  # rows that go through all layers together, so that what lies between layers stays in the cache
# Up to so many rows each goes by itself, past inputs that are 0; compact weights must be widened for more.
FEW, FEW_COMPACT = 3, 7


@_jit
def evaluate(x, layers, weights, numbers, columns, elu, work, active, y):
    """Write the network's outputs of x [N, I] to columns [V] of y [N, O]; the other columns are left alone.

    layers, weights, numbers: see `lmm.evaluator.Packed`; elu says which activation; work and active are
    scratch (`lmm.evaluator.Packed.scratch`), the same for any N.
    """
    count, inputs = x.shape
    last = len(layers) - 1
    width = (len(work) - layers[:, 0].max() * PANEL) // (2 * BLOCK)
    panel = work[2 * BLOCK * width :]
    few = FEW if weights.itemsize == 4 else FEW_COMPACT
    for start in range(0, count, BLOCK):
        rows = min(BLOCK, count - start)
        for n in range(rows):
            for i in range(inputs):
                work[n * width + i] = (x[start + n, i] - numbers[i]) / numbers[inputs + i]
        from_, to = 0, BLOCK * width
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
                for n in range(rows):
                    for k in range(to + n * width, to + n * width + layers[layer, 1] * PANEL):
                        if work[k] <= 0:
                            work[k] = math.expm1(work[k])
            from_, to = to, from_
        for n in range(rows):
            for v in range(len(columns)):
                y[start + n, columns[v]] = work[from_ + n * width + v]


@_jit
def _one_row(layer, weights, numbers, x, rectify, active, values, y):
    """One row through one layer: only inputs that are not 0 count."""
    inputs, panels, first, scale = layer[0], layer[1], layer[2], numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    count = 0
    for i in range(inputs):
        active[count], values[count] = i, x[i]
        count += x[i] != 0
    listed, value, p = active.ctypes.data, values.ctypes.data, 0
    while p < panels:
        at, place = first + p * inputs * PANEL, 4 * p * PANEL
        to = y.ctypes.data + place
        if p + 8 <= panels:
            active_times_panels(
                8, weights, at, inputs, listed, value, count, scale + place, bias + place, rectify, to
            )
            p += 8
        elif p + 2 <= panels:
            active_times_panels(
                2, weights, at, inputs, listed, value, count, scale + place, bias + place, rectify, to
            )
            p += 2
        else:
            active_times_panels(
                1, weights, at, inputs, listed, value, count, scale + place, bias + place, rectify, to
            )
            p += 1


@_jit
def _many_rows(layer, weights, numbers, work, from_, rows, width, rectify, floats, to):
    """Rows through one layer, panel by panel; rows beyond, up to a multiple of SHORT, are computed too."""
    inputs, panels, first, scale = layer[0], layer[1], layer[2], numbers.ctypes.data + 4 * layer[3]
    bias = scale + 4 * panels * PANEL
    for p in range(panels):
        at, place = first + p * inputs * PANEL, 4 * p * PANEL
        panel = weights.ctypes.data + 4 * at
        if weights.itemsize < 4:
            panel = floats.ctypes.data
            to_floats(weights, at, inputs * PANEL, panel)
        n = 0
        while n < rows:
            x = work.ctypes.data + 4 * (from_ + n * width)
            y = work.ctypes.data + 4 * (to + n * width) + place
            if n + TALL <= rows:
                rows_times_panel(
                    TALL, x, width, panel, inputs, scale + place, bias + place, rectify, y, width
                )
                n += TALL
            else:
                rows_times_panel(
                    SHORT, x, width, panel, inputs, scale + place, bias + place, rectify, y, width
                )
                n += SHORT
