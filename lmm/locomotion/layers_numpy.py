"""The obvious twin of `lmm.locomotion.layers`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from ..lanes import GROUP, PANEL
from ..network import elu, to_bfloat16


def evaluate(x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y):
    """See `lmm.locomotion.layers.evaluate`; scratch is left alone."""
    stored = weights.view(np.float16) if weights.dtype == np.uint16 else weights
    stacks = [_stacked(stored, sets, layer).astype(np.float32) for layer in layers]
    _layers(x, sets, used, layers, stacks, numbers, shares, order, ends, lambda h: h, y)


def evaluate_pairs(tiles, x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel,
                   active, y):  # fmt: skip
    """See `lmm.locomotion.layers.evaluate_pairs`; scratch is left alone."""
    stacks = []
    for layer in layers:
        pairs = _stacked(weights, sets, layer)
        both = np.stack([pairs << 16, pairs & 0xFFFF0000], axis=2)
        stacks.append(both.reshape(sets, -1, pairs.shape[2]).view(np.float32))
    _layers(x, sets, used, layers, stacks, numbers, shares, order, ends, to_bfloat16, y)


def _layers(x, sets, used, layers, stacks, numbers, shares, order, ends, rounded, y):
    """Write what layers make of x to y; rounded is what happens to every layer's inputs times their share."""
    inputs = x.shape[1]
    first = np.zeros(len(x), np.int64)
    first[order] = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    which = (first[:, None] + np.arange(used)) % sets
    h = (x - numbers[:inputs]) / numbers[inputs : 2 * inputs]
    for layer, stacked in enumerate(stacks):
        depth, panels, _, scale, _ = layers[layer]
        one = np.concatenate([elu(h) if layer else h, np.ones((len(h), 1), h.dtype)], axis=1)
        scales, biases = numbers[scale : scale + 2 * panels * PANEL].reshape(2, -1)
        h = np.zeros((len(x), panels * PANEL), np.float32)
        for u in range(used):  # a set at a time: rows of one set are one product
            for s in np.unique(which[:, u]):
                rows = np.flatnonzero(which[:, u] == s)
                h[rows] += rounded(shares[rows, u, None] * one[rows]) @ stacked[s, : depth + 1]
        h = (h * scales + biases)[:, : layers[layer + 1, 0] if layer + 1 < len(layers) else y.shape[1]]
    y[:] = h


def _stacked(stored, sets, layer):
    """A layer's weights and biases [sets, depth, 32 panels] out of its groups."""
    _, panels, at, _, depth = layer
    groups = []
    for p in range(0, panels, GROUP):
        width = PANEL * min(GROUP, panels - p)
        start = at + PANEL * p * sets * depth
        groups.append(stored[start : start + sets * depth * width].reshape(sets, depth, width))
    return np.concatenate(groups, axis=-1)
