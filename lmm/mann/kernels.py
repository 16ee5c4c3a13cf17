"""A mode-adaptive network's gate, compiled; `lmm.mann.kernels_numpy` is the obvious twin.

Experts are weight sets of which every row needs all (`lmm.locomotion.layers`): nothing is blended, a row goes
through all experts' products at once.
"""

from __future__ import annotations

import math

import numba

from ..kernels import elu_of

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


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
