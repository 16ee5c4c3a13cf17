"""Normalisation of feature vectors, and the cost of a pair (query, frame) by feature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .schema import Feature, Schema

Array = NDArray[np.floating]

CONSTANT = 1e30  # scale of what must not count: finite, so that denormalising gives the value back


def fit(schema: Schema, raw: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Offset [F] and scale [F] of raw features [T, F]; stored values are (raw - offset) / scale.

    "standard" (REFERENCE 2.2): the offset is the column's mean, the scale the mean over the block's columns
    of the population standard deviation, divided by the weight. "minmax": the column's minimum, and the mean
    over the block of maximum - minimum. "none": 0 and 1. A block is a feature, or all features of one group,
    each with its own weight. A block that does not vary, or has no weight, gets a scale so large that it adds
    nothing to any cost.
    """
    raw = np.asarray(raw)
    if raw.ndim != 2 or raw.shape[1] != schema.size or len(raw) == 0:
        raise ValueError(f"raw features {raw.shape}, expected (at least 1, {schema.size})")
    offset, scale = np.zeros(schema.size), np.ones(schema.size)
    for members in schema.groups().values():
        spreads = []
        for feature in members:
            columns = schema.slices[feature.name]
            offset[columns], spread = _spread(raw[:, columns], feature.scaler)
            spreads.append(spread)
        mean = float(np.mean(np.concatenate(spreads)))
        largest = max(float(np.max(np.abs(raw[:, schema.slices[f.name]]))) for f in members)
        varies = mean > 1e-6 * (1 + largest)  # what is less is float32's rounding
        for feature in members:
            counts = varies and feature.weight > 0
            scale[schema.slices[feature.name]] = mean / feature.weight if counts else CONSTANT
    return offset.astype(np.float32), scale.astype(np.float32)


def _spread(values: Array, scaler: str) -> tuple[Array, Array]:
    """Offset and spread of each column."""
    if scaler == "standard":
        return values.mean(axis=0, dtype=np.float64), values.std(axis=0, dtype=np.float64)
    if scaler == "minmax":
        low = values.min(axis=0).astype(np.float64)
        return low, values.max(axis=0) - low
    return np.zeros(values.shape[1]), np.ones(values.shape[1])


def normalise(raw: Array, offset: Array, scale: Array) -> NDArray[np.float32]:
    """(raw - offset) / scale, float32 ``[..., F]``."""
    return ((raw - offset) / scale).astype(np.float32, copy=False)


def denormalise(features: Array, offset: Array, scale: Array) -> NDArray[np.float32]:
    """Raw features of normalised ones, float32 ``[..., F]``."""
    return (features * scale + offset).astype(np.float32, copy=False)


def costs(schema: Schema, queries: Array, rows: Array) -> NDArray[np.float32]:
    """Cost of pairs by feature, float32 ``[..., number of features]``.

    queries and rows ``[..., F]`` are normalised and broadcast: ``[N, 1, F]`` with ``[T, F]`` gives every pair
    of N queries and T rows. Weights are in the normalisation already; `Feature` has the residuals.
    """
    difference = np.asarray(queries, np.float32) - np.asarray(rows, np.float32)
    if schema.euclidean:  # one call for all features
        starts = [part.start for part in schema.slices.values()]
        return np.add.reduceat(difference * difference, starts, axis=-1)
    out = np.empty((*difference.shape[:-1], len(schema.features)), np.float32)
    for i, feature in enumerate(schema.features):
        out[..., i] = _cost(feature, difference[..., schema.slices[feature.name]])
    return out


def total_costs(schema: Schema, queries: Array, rows: Array) -> NDArray[np.float32]:
    """Cost of pairs, the sum over features as a search counts it, float32 ``[...]``; see `costs`."""
    if schema.euclidean:
        difference = np.asarray(queries, np.float32) - np.asarray(rows, np.float32)
        return np.einsum("...f,...f->...", difference, difference)
    return costs(schema, queries, rows).sum(axis=-1)


def _cost(feature: Feature, difference: Array) -> Array:
    if feature.residual == "squared":
        return np.sum(difference * difference, axis=-1)
    if feature.residual == "absolute":
        return np.sqrt(np.sum(difference * difference, axis=-1))
    samples = difference.reshape(*difference.shape[:-1], -1, 2)
    steps = np.diff(samples, axis=-2)
    return np.linalg.norm(samples, axis=-1).sum(axis=-1) + np.linalg.norm(steps, axis=-1).sum(axis=-1)
