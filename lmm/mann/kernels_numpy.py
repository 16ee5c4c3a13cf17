"""The obvious twin of `lmm.mann.kernels`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from ..locomotion import layers_numpy as mixed
from ..network import elu


def gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares):
    """See `lmm.mann.kernels.gate`; scratch is left alone."""
    inputs = x.shape[1]
    h = (x[:, columns] - numbers[columns]) / numbers[inputs + columns]
    h = elu(elu(h @ w0 + b0) @ w1 + b1) @ w2 + b2
    counts = np.exp(h - h.max(axis=1, keepdims=True))
    shares[:] = counts / counts.sum(axis=1, keepdims=True)


def evaluate(x, columns, w0, b0, w1, b1, w2, b2, h0, h1, layers, weights, numbers, shares, order, ends, work,
             wide, panel, active, y):  # fmt: skip
    """See `lmm.mann.kernels.evaluate`."""
    experts = shares.shape[1]
    gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares)
    ends[0] = len(x)
    mixed.evaluate(
        x, experts, experts, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y
    )


def evaluate_pairs(tiles, x, columns, w0, b0, w1, b1, w2, b2, h0, h1, layers, weights, numbers, shares, order,
                   ends, work, wide, panel, active, y):  # fmt: skip
    """See `lmm.mann.kernels.evaluate_pairs`."""
    experts = shares.shape[1]
    gate(x, numbers, columns, w0, b0, w1, b1, w2, b2, h0, h1, shares)
    ends[0] = len(x)
    mixed.evaluate_pairs(
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
