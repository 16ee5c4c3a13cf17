"""The obvious twin of `lmm.kernels`: the same functions over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from .lanes import GROUP, LANES, PANEL
from .layout import Layout
from .network import elu as elu_of
from .network import to_bfloat16


def evaluate(x, layers, weights, numbers, columns, elu, rows_between, panel, active, y):
    """See `lmm.kernels.evaluate`."""
    stored = weights.view(np.float16) if weights.dtype == np.uint16 else weights
    matrices = [_matrix(stored, *layer[:3]) for layer in layers]
    _layers(x, matrices, layers, numbers, columns, elu, lambda h: h, y)


def evaluate_pairs(tiles, split, x, layers, weights, numbers, columns, elu, rows_between, panel, active, y):
    """See `lmm.kernels.evaluate_pairs`."""
    matrices = []
    for layer in layers:
        pairs = _matrix(weights, *layer[:3])
        if split:
            pairs = pairs.reshape(-1, 2, LANES, pairs.shape[1])[:, 0].reshape(-1, pairs.shape[1])
        both = np.stack([pairs << 16, pairs & 0xFFFF0000], axis=1)
        matrices.append(both.reshape(2 * len(pairs), pairs.shape[1]).view(np.float32))
    _layers(x, matrices, layers, numbers, columns, elu, _two_bfloat16 if split else to_bfloat16, y)


def _two_bfloat16(x):
    """x as the sum of two bfloat16 numbers."""
    nearest = to_bfloat16(x)
    return nearest + to_bfloat16(x - nearest)


def _matrix(stored, depth, panels, first):
    """A layer's weights [depth, 32 panels] out of its groups."""
    stop, step = first + depth * panels * PANEL, depth * GROUP * PANEL
    groups = [
        stored[start : min(start + step, stop)].reshape(depth, -1) for start in range(first, stop, step)
    ]
    return np.concatenate([np.zeros((depth, 0), stored.dtype), *groups], axis=1)


def _layers(x, matrices, layers, numbers, columns, elu, rounded, y):
    """Write what layers make of x to columns of y; rounded is what happens to every layer's inputs."""
    inputs, last = x.shape[1], len(layers) - 1
    h = (x - numbers[:inputs]) / numbers[inputs : 2 * inputs]
    for layer, matrix in enumerate(matrices):
        scale, width = layers[layer, 3], matrix.shape[1]
        scales, biases = numbers[scale : scale + 2 * width].reshape(2, width)
        depth = min(h.shape[1], len(matrix))  # what pads either is 0
        h = rounded(h[:, :depth]) @ matrix[:depth].astype(np.float32) * scales + biases
        if layer < last:
            h = elu_of(h) if elu else np.maximum(h, 0)
    y[:, columns] = h[:, : len(columns)]


def rows_of(frames, features, latents, out):
    out[:] = np.concatenate([features[frames], latents[frames].view(np.float16)], axis=1)


def root_mean_square(a, b, scale, out):
    out[:] = np.sqrt((((a - b) * scale) ** 2).mean(axis=1))


def advance(values, rates, fps):
    """See `lmm.kernels.advance`."""
    values += rates / fps


def follow(near, last, tags, borne):
    known = near >= 0
    np.minimum(near + 1, last[near], out=near, where=known)
    if tags is not None:
        np.copyto(borne, tags[near], where=known)


def unpack(vectors, fps, positions, rotations, velocities, angular, contacts):
    """See `lmm.kernels.unpack`."""
    poses, contacts[:] = Layout(positions.shape[1], contacts.shape[1]).unpack(vectors, fps)
    for to, values in zip((positions, rotations, velocities, angular), poses.arrays().values(), strict=True):
        to[:] = values
