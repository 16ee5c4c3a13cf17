"""The obvious twin of `lmm.pfnn.kernels`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from ..lanes import GROUP, PANEL
from ..network import elu
from . import spline

_MODES = {used: mode for mode, used in spline.USED.items()}


def evaluate(x, phases, sets, used, layers, weights, numbers, first, shares, order, ends, work, wide, panel,
             active, y):  # fmt: skip
    """See `lmm.pfnn.kernels.evaluate`; scratch is left alone."""
    stored = weights.view(np.float16) if weights.dtype == np.uint16 else weights
    inputs = x.shape[1]
    begin, share = spline.shares(phases, _MODES[used])
    which = (begin[:, None] + np.arange(used)) % sets
    h = (x - numbers[:inputs]) / numbers[inputs : 2 * inputs]
    for layer, (depth, panels, at, scale) in enumerate(layers):
        stacked = _stacked(stored, sets, depth + 1, panels, at).astype(np.float32)
        one = np.concatenate([elu(h) if layer else h, np.ones((len(h), 1), h.dtype)], axis=1)
        scales, biases = numbers[scale : scale + 2 * panels * PANEL].reshape(2, -1)
        h = np.zeros((len(x), panels * PANEL), np.float32)
        for u in range(used):  # a set at a time: rows of one set are one product
            for s in np.unique(which[:, u]):
                rows = np.flatnonzero(which[:, u] == s)
                h[rows] += share[rows, u, None].astype(np.float32) * (one[rows] @ stacked[s])
        h = (h * scales + biases)[:, : layers[layer + 1, 0] if layer + 1 < len(layers) else y.shape[1]]
    y[:] = h


def _stacked(stored, sets, depth, panels, at):
    """A layer's weights and biases [sets, inputs + 1, 32 panels] out of its groups."""
    groups = []
    for p in range(0, panels, GROUP):
        width = PANEL * min(GROUP, panels - p)
        start = at + PANEL * p * sets * depth
        groups.append(stored[start : start + sets * depth * width].reshape(sets, depth, width))
    return np.concatenate(groups, axis=-1)
