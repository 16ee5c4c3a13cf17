"""Features in few bytes: how far off they are."""

from __future__ import annotations

import numpy as np
import pytest

from mm.codecs import features
from motion.errors import UserError


def table(frames: int = 3000, columns: int = 7) -> np.ndarray:
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((frames, columns)) * np.arange(columns)  # the first column is constant
    return (rows + 3).astype(np.float32)


@pytest.mark.parametrize("codec", ["float32", "float16", "8bit", "pq"])
def test_arrays_are_those_expected_and_decoded_as_many(codec: str) -> None:
    rows = table()
    arrays = features.encode(rows, codec)
    for name, (dtype, shape) in features.expected(codec, 3000, 7).items():
        assert arrays[name].dtype == dtype and arrays[name].shape == shape
    decoded = features.decode(arrays, 7)
    assert decoded.shape == rows.shape and decoded.dtype == np.float32


def test_floats_are_rounded_as_floats_are() -> None:
    rows = table()
    np.testing.assert_array_equal(features.decode(features.encode(rows, "float32"), 7), rows)
    halves = features.decode(features.encode(rows, "float16"), 7)
    assert (np.abs(halves - rows) <= np.abs(rows) * 2.0**-11 + 2.0**-25).all()


def test_bytes_are_off_by_half_of_a_256th_of_the_column() -> None:
    rows = table()
    decoded = features.decode(features.encode(rows, "8bit"), 7)
    extent = rows.max(axis=0) - rows.min(axis=0)
    off = np.abs(decoded - rows).max(axis=0)
    assert (off <= extent / 510 + 1e-5).all() and (off[1:] > 0.9 * extent[1:] / 510).all()
    np.testing.assert_array_equal(decoded[:, 0], rows[:, 0])


def test_product_quantisation_takes_the_nearest_centroid() -> None:
    rows = table()
    arrays = features.encode(rows, "pq")
    codes, centroids = arrays["codes"], arrays["centroids"]
    assert codes.shape == (3000, 3) and centroids.shape == (3, 64, 3)
    padded = np.pad(rows, ((0, 0), (0, 2))).reshape(3000, 3, 1, 3)
    costs = ((padded - centroids) ** 2).sum(-1)
    taken = np.take_along_axis(costs, codes[..., None].astype(np.int64), -1)[..., 0]
    np.testing.assert_allclose(taken, costs.min(-1), rtol=1e-3, atol=1e-4)
    decoded = features.decode(arrays, 7)
    assert 1 - ((decoded - rows) ** 2).sum() / ((rows - rows.mean(0)) ** 2).sum() > 0.8


def test_too_few_frames_for_centroids() -> None:
    with pytest.raises(UserError, match=r"product quantisation of 100 frames.*8bit"):
        features.encode(table(100), "pq")
