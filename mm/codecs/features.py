"""Normalised features in few bytes. The search runs on what is decoded of them, which is held as float32."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from motion.errors import UserError

COLUMNS = 3  # that share a code of product quantisation, as the index faiss-pq does by default
ROWS_PER_CENTROID = 39  # fewer make k-means poor, faiss warns
CHUNK = 65536


def encode(features: NDArray[np.float32], codec: str) -> dict[str, NDArray]:
    """Arrays by name of features [T, F], see `mm.codecs.codec.FEATURES`.

    "8bit" rounds every column to 256 values between its least and largest: wrong by (largest - least) / 510
    at most. "pq" is product quantisation: 256 centroids for every three columns, a byte each.
    """
    features = np.ascontiguousarray(features, np.float32)
    if codec in ("float32", "float16"):
        return {"features": features.astype(codec)}
    if codec == "8bit":
        low, high = features.min(axis=0), features.max(axis=0)
        step = (high.astype(np.float64) - low) / 255
        codes = np.rint((features.astype(np.float64) - low) / np.where(step > 0, step, 1))
        return {"codes": codes.astype(np.uint8), "low": low, "step": step.astype(np.float32)}
    return _product(features)


def _product(features: NDArray[np.float32]) -> dict[str, NDArray]:
    from mm.search.faiss_indexes import faiss  # takes a while to load

    frames, columns = features.shape
    centroids = min(256, 1 << int(np.log2(max(1, frames // ROWS_PER_CENTROID))))
    if centroids < 16:
        raise UserError(
            f"product quantisation of {frames} frames",
            remedy=f"give {16 * ROWS_PER_CENTROID} frames or more, or take 8bit",
        )
    blocks = -(-columns // COLUMNS)
    padded = np.pad(features, ((0, 0), (0, blocks * COLUMNS - columns))).reshape(frames, blocks, COLUMNS)
    codes, found = (
        np.empty((frames, blocks), np.uint8),
        np.empty((blocks, centroids, COLUMNS), np.float32),
    )
    for b in range(blocks):
        rows = np.ascontiguousarray(padded[:, b])
        means = faiss.Kmeans(COLUMNS, centroids, niter=25, seed=1)
        means.train(rows)
        found[b] = means.centroids
        codes[:, b] = faiss.knn(rows, found[b], 1)[1][:, 0]
    return {"codes": codes, "centroids": found}


def decode(arrays: Mapping[str, NDArray], columns: int) -> NDArray[np.float32]:
    """Features [T, F]."""
    if "features" in arrays:
        return np.ascontiguousarray(arrays["features"], np.float32)
    codes = np.asarray(arrays["codes"])
    if "step" in arrays:
        return arrays["low"] + codes * arrays["step"]
    centroids = np.asarray(arrays["centroids"])
    rows = [centroids[b, codes[:, b]] for b in range(len(centroids))]
    return np.ascontiguousarray(np.concatenate(rows, axis=1)[:, :columns])


def expected(codec: str, frames: int, columns: int) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Types and shapes of the arrays, without centroids, of which there may be fewer."""
    if codec in ("float32", "float16"):
        return {"features": (codec, (frames, columns))}
    if codec == "8bit":
        edges = ("float32", (columns,))
        return {"codes": ("uint8", (frames, columns)), "low": edges, "step": edges}
    return {"codes": ("uint8", (frames, -(-columns // COLUMNS)))}
