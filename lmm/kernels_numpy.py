"""The obvious twin of `lmm.kernels`: the same functions over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from .lanes import GROUP, PANEL
from .layout import Layout
from .network import elu as elu_of


def evaluate(x, layers, weights, numbers, columns, elu, rows_between, panel, active, y):
    """See `lmm.kernels.evaluate`."""
    inputs, last = x.shape[1], len(layers) - 1
    stored = weights.view(np.float16) if weights.dtype == np.uint16 else weights
    h = (x - numbers[:inputs]) / numbers[inputs : 2 * inputs]
    for layer, (depth, panels, first, scale) in enumerate(layers):
        width = panels * PANEL
        starts = range(first, first + depth * width, depth * GROUP * PANEL)
        groups = [
            stored[start : min(start + depth * GROUP * PANEL, first + depth * width)] for start in starts
        ]
        matrix = np.concatenate(
            [np.zeros((depth, 0)), *(group.reshape(depth, -1) for group in groups)], axis=1, dtype=np.float32
        )
        scales, biases = numbers[scale : scale + 2 * width].reshape(2, width)
        h = h[:, :depth] @ matrix * scales + biases
        if layer < last:
            h = elu_of(h) if elu else np.maximum(h, 0)
    y[:, columns] = h[:, : len(columns)]


def advance(values, rates, fps):
    """See `lmm.kernels.advance`."""
    values += rates / fps


def unpack(vectors, fps, positions, rotations, velocities, angular, contacts):
    """See `lmm.kernels.unpack`."""
    poses, contacts[:] = Layout(positions.shape[1], contacts.shape[1]).unpack(vectors, fps)
    for to, values in zip((positions, rotations, velocities, angular), poses.arrays().values(), strict=True):
        to[:] = values
