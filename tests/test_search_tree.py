"""The exact index's parts: vector instructions beside NumPy, and what its tree promises."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from mm.search import lanes, tree


@numba.njit
def box_gaps(boxes, point, limit, gaps):
    return lanes.box_gaps(boxes.ctypes.data, point.ctypes.data, len(point), limit, gaps.ctypes.data)


@numba.njit
def near_rows(rows, point, limit):
    return lanes.near_rows(rows.ctypes.data, point.ctypes.data, len(point), limit)


@numba.njit
def box_norms(boxes, point, ends, limit, slack, gaps):
    return lanes.box_norms(
        boxes.ctypes.data, point.ctypes.data, ends.ctypes.data, len(ends), len(point), limit, slack,
        gaps.ctypes.data,
    )  # fmt: skip


@numba.njit
def near_norms(rows, point, ends, limit, first_slack, last_slack):
    return lanes.near_norms(
        rows.ctypes.data, point.ctypes.data, ends.ctypes.data, len(ends), len(point), limit, first_slack,
        last_slack,
    )  # fmt: skip


@numba.njit
def turn(vector, matrix, product):
    lanes.turn(vector.ctypes.data, len(vector), matrix.ctypes.data, len(product), product.ctypes.data)


@numba.njit
def lowest_bit(bits):
    return lanes.lowest_bit(bits)


def bits_of(near):
    return sum(1 << int(lane) for lane in np.flatnonzero(near))


@pytest.mark.parametrize("columns", [4, 28, 72])
def test_vector_instructions_equal_numpy(columns):
    rng = np.random.default_rng(columns)
    point = rng.normal(size=columns).astype(np.float32)
    corners = np.sort(rng.normal(size=(columns, 2, 16)), axis=1).astype(np.float16)
    wide = corners.astype(np.float64)
    gap = (np.maximum(0, np.maximum(wide[:, 0] - point[:, None], point[:, None] - wide[:, 1])) ** 2).sum(0)
    gaps = np.zeros(16, np.float32)
    for limit in (0.0, float(np.median(gap)) + 1e-3, np.inf):
        assert box_gaps(corners.view(np.uint16), point, np.float32(limit), gaps) == bits_of(gap < limit)
        np.testing.assert_allclose(gaps, gap, rtol=1e-5, atol=1e-6)

    rows = rng.normal(size=(columns, 32)).astype(np.float16)
    distance = ((rows.astype(np.float64) - point[:, None]) ** 2).sum(0)
    for limit in (0.0, float(np.median(distance)) + 1e-3, np.inf):
        assert near_rows(rows.view(np.uint16), point, np.float32(limit)) == bits_of(distance < limit)

    matrix = rng.normal(size=(columns, 48)).astype(np.float32)
    product = np.zeros(48, np.float32)
    turn(point, matrix, product)
    np.testing.assert_allclose(product, point @ matrix.astype(np.float64), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("ends", [[], [2, 3, 6], [3, 12], [8, 12]])
def test_sums_of_norms_equal_numpy(ends):
    rng = np.random.default_rng(len(ends))
    columns, ends = 12, np.array(ends, np.int64)
    point = rng.normal(size=columns).astype(np.float32)

    def cost(gaps, first_slack, last_slack):
        parts = np.split(gaps, ends)
        norms = sum((np.linalg.norm(part, axis=0) for part in parts[:-1]), np.zeros(gaps.shape[1]))
        last = np.maximum(0, np.linalg.norm(parts[-1], axis=0) - last_slack)
        return np.maximum(0, norms - first_slack) + last**2

    corners = np.sort(rng.normal(size=(columns, 2, 16)), axis=1).astype(np.float16)
    wide, at = corners.astype(np.float64), point[:, None].astype(np.float64)
    gaps = np.zeros(16, np.float32)
    truth = cost(np.maximum(0, np.maximum(wide[:, 0] - at, at - wide[:, 1])), 0.125, 0.125)
    limit = np.median(truth) + 1e-3
    found = box_norms(corners.view(np.uint16), point, ends, np.float32(limit), np.float32(0.125), gaps)
    assert found == bits_of(truth < limit)
    np.testing.assert_allclose(gaps, truth, rtol=1e-5, atol=1e-6)

    rows = rng.normal(size=(columns, 32)).astype(np.float16)
    truth = cost(rows.astype(np.float64) - at, 0.25, 0.5)
    limit = np.median(truth) + 1e-3
    found = near_norms(
        rows.view(np.uint16), point, ends, np.float32(limit), np.float32(0.25), np.float32(0.5)
    )
    assert found == bits_of(truth < limit)


def test_lowest_bit():
    assert [lowest_bit(bits) for bits in (1, 2, 12, 1 << 31, 3 << 40)] == [0, 1, 2, 31, 40]


@pytest.mark.parametrize(("count", "width"), [(1, 1), (31, 3), (33, 5), (5000, 27)])
def test_tree_holds_every_row_within_its_boxes(count, width):
    rng = np.random.default_rng(count)
    rows = (rng.normal(size=(count, width)) * rng.uniform(0.01, 30, width) + 5).astype(np.float32)
    axes = tree.principal_axes(rows)
    np.testing.assert_allclose(axes.T @ axes, np.eye(width), atol=1e-12)
    grown = tree.grow(rows, axes, np.zeros(0, np.int64))
    places = grown.places
    assert sorted(places[places >= 0]) == list(range(count)) and (places >= 0).all(1)[:-1].all()

    columns = grown.rows.shape[1]
    points = (rows.astype(np.float64) - grown.mean) @ grown.axes[:, :columns]
    np.testing.assert_allclose(
        np.linalg.norm(points[0] - points[-1]), np.linalg.norm(rows[0] - rows[-1]), rtol=1e-4, atol=1e-5
    )
    variance = points.var(axis=0)
    assert (np.diff(variance[:width]) <= 1e-6 * variance[0]).all()

    # A leaf's rows: near their half floats, inside their box, which is inside its parent's.
    leaves, level_start, level = len(places), len(grown.boxes), len(places)
    inner_low = inner_high = None
    while level > 1 or inner_low is None:
        nodes = -(-level // 16)
        level_start -= nodes
        boxes = grown.boxes[level_start : level_start + nodes].astype(np.float64)
        low = boxes[:, :, 0].transpose(0, 2, 1).reshape(-1, columns)[:level]
        high = boxes[:, :, 1].transpose(0, 2, 1).reshape(-1, columns)[:level]
        if inner_low is None:
            for leaf in range(leaves):
                mine = points[places[leaf][places[leaf] >= 0]]
                stored = grown.rows[leaf].T[places[leaf] >= 0].astype(np.float64)
                assert (np.linalg.norm(stored - mine, axis=1) <= grown.errors[leaf, 1] + 1e-5).all()
                assert (mine >= low[leaf] - 1e-5).all() and (mine <= high[leaf] + 1e-5).all()
        else:
            parent = np.arange(len(inner_low)) // 16
            assert (inner_low >= low[parent]).all() and (inner_high <= high[parent]).all()
        inner_low, inner_high, level = low, high, nodes
    assert level_start == 0


def test_half_floats_are_rounded_outwards():
    values = np.array([0.1, -0.1, 1 / 3, 1e-9, -1e-9, 1e6, -1e6, 2.0])
    below, above = tree.round_out(values, -1), tree.round_out(values, +1)
    assert (below.astype(np.float64) <= values).all() and (values <= above.astype(np.float64)).all()
    assert below[-1] == above[-1] == 2.0
    assert (above[:3].astype(np.float64) - below[:3] <= 5e-4).all()
