"""A phase-functioned network's hot loops, compiled; `lmm.pfnn.kernels_numpy` is the obvious twin."""

from __future__ import annotations

import math

import numba

from ..locomotion import layers as mixed

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

_evaluate, _evaluate_pairs = mixed.evaluate, mixed.evaluate_pairs


@_jit
def share(phases, sets, used, first, shares):
    """Write which sets phases [N] need to first [N] and shares [N, used], see `lmm.pfnn.spline.shares`."""
    for n in range(len(phases)):
        if used == 4:
            place = phases[n] * (4 / (2 * math.pi))
            begin = math.floor(place)
            w = place - begin
            k = int(begin)
            first[n] = 0
            shares[n, (k - 1) % 4] = -w / 2 + w * w - w * w * w / 2
            shares[n, k % 4] = 1 - 5 / 2 * w * w + 3 / 2 * w * w * w
            shares[n, (k + 1) % 4] = w / 2 + 2 * w * w - 3 / 2 * w * w * w
            shares[n, (k + 2) % 4] = -w * w / 2 + w * w * w / 2
        else:
            place = phases[n] * (sets / (2 * math.pi))
            begin = math.floor(place if used == 2 else place + 0.5)
            first[n] = int(begin) % sets
            shares[n, 0] = 1
            if used == 2:
                shares[n, 0], shares[n, 1] = 1 - (place - begin), place - begin


@_jit
def sort(first, sets, order, ends):
    """Write rows [N] by their first set to order, and where each set's rows end to ends [sets]."""
    ends[:] = 0
    for n in range(len(first)):
        ends[first[n]] += 1
    total = 0
    for s in range(sets):
        total += ends[s]
        ends[s] = total - ends[s]  # where it begins, until its rows are placed
    for n in range(len(first)):
        order[ends[first[n]]] = n
        ends[first[n]] += 1


@_jit
def evaluate(x, phases, sets, used, layers, weights, numbers, first, shares, order, ends, work, wide, panel,
             active, y):  # fmt: skip
    """Write the network's outputs of x [N, I] at phases [N] to y [N, O].

    layers, weights, numbers: see `lmm.locomotion.evaluator.Packed`; the rest is scratch for N rows.
    """
    share(phases, sets, used, first, shares)
    sort(first, sets, order, ends)
    _evaluate(x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y)


@_jit
def evaluate_pairs(tiles, x, phases, sets, used, layers, weights, numbers, first, shares, order, ends, work,
                   wide, panel, active, y):  # fmt: skip
    """As `evaluate`, of weights in pairs, see `lmm.locomotion.layers.evaluate_pairs`."""
    share(phases, sets, used, first, shares)
    sort(first, sets, order, ends)
    _evaluate_pairs(
        tiles, x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y
    )
