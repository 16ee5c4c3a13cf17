"""A mode-adaptive network's hot loops, compiled; `lmm.mann.kernels_numpy` is the obvious twin.

Experts are weight sets of which every row needs all (`lmm.locomotion.layers`): nothing is blended, a row goes
through all experts' products at once.
"""

from __future__ import annotations

import math

import numba

from ..kernels import elu_of
from ..locomotion import layers as mixed

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

_evaluate, _evaluate_pairs = mixed.evaluate, mixed.evaluate_pairs


@_jit
def gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares):
    """Write what each expert counts to shares [N, K], for inputs x [N, I].

    numbers begin with the inputs' means and deviations; columns [G] are those that the gate sees. w, b are
    the weights and biases of its layers, h0, h1 scratch for what lies between.
    """
    inputs, experts = x.shape[1], shares.shape[1]
    for n in range(len(x)):
        for o in range(len(h0)):
            h0[o] = b0[o]
        for i in range(len(columns)):
            column = columns[i]
            value = (x[n, column] - numbers[column]) / numbers[inputs + column]
            for o in range(len(h0)):
                h0[o] += value * w0[i, o]
        elu_of(h0, len(h0))
        _dense(h0, w1, b1, h1)
        elu_of(h1, len(h1))
        share = shares[n]
        _dense(h1, w2, b2, share)
        most, total = share[0], 0.0
        for k in range(experts):
            most = max(most, share[k])
        for k in range(experts):
            share[k] = math.exp(share[k] - most)
            total += share[k]
        for k in range(experts):
            share[k] /= total


@_jit
def _dense(x, weights, biases, y):
    for o in range(len(y)):
        y[o] = biases[o]
    for i in range(len(x)):
        value = x[i]
        for o in range(len(y)):
            y[o] += value * weights[i, o]


@_jit
def evaluate(x, columns, w0, b0, w1, b1, w2, b2, h0, h1, layers, weights, numbers, shares, order, ends, work,
             wide, panel, active, y):  # fmt: skip
    """Write the network's outputs of x [N, I] to y [N, O], what experts count to shares [N, K].

    columns to h1: see `gate`; order [N] is 0 to N - 1; layers, weights, numbers: see
    `lmm.locomotion.evaluator.Packed`; the rest is scratch for N rows.
    """
    experts = shares.shape[1]
    gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares)
    ends[0] = len(x)
    _evaluate(
        x, experts, experts, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y
    )


@_jit
def evaluate_pairs(tiles, x, columns, w0, b0, w1, b1, w2, b2, h0, h1, layers, weights, numbers, shares, order,
                   ends, work, wide, panel, active, y):  # fmt: skip
    """As `evaluate`, of weights in pairs, see `lmm.locomotion.layers.evaluate_pairs`; the gate is float32."""
    experts = shares.shape[1]
    gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares)
    ends[0] = len(x)
    _evaluate_pairs(
        tiles,
        x,
        experts,
        experts,
        layers,
        weights,
        numbers,
        shares,
        order,
        ends,
        work,
        wide,
        panel,
        active,
        y,
    )
