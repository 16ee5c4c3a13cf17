"""Columns of features, their components, speeds: what is made by hand is found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bench.data import components, features, reach
from bench.data.clips import Clips
from features.schema import Feature, Schema

SCHEMA = Schema(
    "two",
    (
        Feature("hips", "velocity", role="hips"),
        Feature("way", "trajectory_position", times=(0.5,), weight=2.0),
    ),
)


def clips(*lengths, fps=10.0):
    stops = np.cumsum(lengths)
    names = tuple(f"clip{i}" for i in range(len(lengths)))
    return Clips(np.arange(stops[-1]), stops - lengths, stops, names, fps)


@pytest.fixture
def values():
    out = np.random.default_rng(1).normal(size=(1000, 5)) * [1, 2, 3, 1, 1] + [0, 1, 0, 5, 0]
    out[:, 0] = np.exp(out[:, 0])
    return out


def test_columns_are_what_scipy_says(values):
    table = features.columns(SCHEMA, values)
    assert list(table["column"]) == list(SCHEMA.columns)
    assert list(table["feature"]) == ["hips"] * 3 + ["way"] * 2
    assert list(table["unit"]) == ["m/s"] * 3 + ["m"] * 2
    np.testing.assert_allclose(table["mean"], values.mean(axis=0))
    np.testing.assert_allclose(table["std"], values.std(axis=0))
    np.testing.assert_allclose(table["p95"], np.percentile(values, 95, axis=0))
    np.testing.assert_allclose(table["skewness"], stats.skew(values), atol=1e-9)
    assert not table["constant"].any()


def test_columns_that_hardly_vary_are_constant(values):
    values[:, 1] = 7
    values[:, 3] = 5 + 0.02 * (values[:, 3] - 5)  # two centimetres, where the other one makes a metre
    assert list(features.columns(SCHEMA, values)["constant"]) == [False, True, False, True, False]
    assert np.isfinite(features.columns(SCHEMA, values)["skewness"]).all()


def test_what_lies_far_out_is_told_with_clip_and_second(values):
    values[:, 0] = np.random.default_rng(2).normal(size=1000)
    values[312, 2] = 60.0
    values[313, 2] = 50.0
    values[700, 1] = -25.0
    table = features.columns(SCHEMA, values)
    found = features.outliers(table, values, clips(300, 400, 300))
    assert list(found["clip"]) == ["clip1", "clip2"]
    assert list(found["column"]) == ["hips.velocity.z", "hips.velocity.y"]
    np.testing.assert_allclose(found["from_s"], [1.2, 0.0])
    np.testing.assert_allclose(found["to_s"], [1.4, 0.1])
    np.testing.assert_allclose(found["at_s"], [1.2, 0.0])
    np.testing.assert_allclose(found["value"], [60.0, -25.0])
    assert list(found["frame"]) == [312, 700]
    assert table["far_out"].iloc[2] == pytest.approx(0.002)
    z = values[:, 2]
    quartiles = np.percentile(z, [25, 75])
    spread = max(np.ptp(quartiles), 1.349 * z.std())
    assert found["far"][0] == pytest.approx((60 - quartiles[1]) / spread)


def test_a_column_that_mostly_stands_has_no_swarm_of_outliers():
    x = np.zeros((1000, 5))
    x[:200] = np.random.default_rng(3).normal(size=(200, 5))  # moves a fifth of the time
    table = features.columns(SCHEMA, x)
    assert (table["p75"] - table["p25"] < 0.1).all()
    assert (table["far_out"] < 0.05).all()


def test_columns_that_say_the_same_are_found(values):
    rng = np.random.default_rng(4)
    values[:, 4] = -3 * values[:, 2] + 0.1 * rng.normal(size=1000)
    values[:, 1] = 2.0
    correlations = features.correlation(SCHEMA, values)
    truth = np.corrcoef(values[:, [0, 2, 3, 4]].T)
    np.testing.assert_allclose(correlations.to_numpy()[np.ix_([0, 2, 3, 4], [0, 2, 3, 4])], truth, atol=1e-9)
    assert (correlations.to_numpy()[1] == 0).all()
    pairs = features.redundant(correlations)
    assert pairs[["column", "other"]].values.tolist() == [
        ["hips.velocity.z", "trajectory.position[+0.500].z"]
    ]
    assert pairs["correlation"][0] == pytest.approx(-1, abs=0.001)


def test_a_features_weight_is_its_share_of_squared_distances():
    rows = np.random.default_rng(5).normal(size=(5000, 5)) * [1, 1, 1, 2, 2]
    table = features.weights(SCHEMA, rows, rows[:10], rows[:10] + np.eye(5)[3])
    np.testing.assert_allclose(table["any_share"], [3 / 11, 8 / 11], atol=0.02)
    np.testing.assert_allclose(table["near_share"], [0, 1])
    assert list(table["columns"]) == [3, 2]


def test_components_are_the_axes_that_data_was_made_of():
    rng = np.random.default_rng(6)
    axes = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    rows = rng.normal(size=(20_000, 5)) * np.sqrt([8, 4, 2, 1, 1]) @ axes.T + 3
    found = components.find(rows)
    np.testing.assert_allclose(found.share, np.array([8, 4, 2, 1, 1]) / 16, atol=0.02)
    assert abs(found.axes[:, 0] @ axes[:, 0]) > 0.99
    np.testing.assert_allclose(found.scores.var(axis=0), found.variance[:2])
    assert (found.needed(0.45), found.needed(0.7), found.needed(1.0)) == (1, 2, 5)
    table = components.table(found, SCHEMA.columns)
    assert table["cumulative"].iloc[-1] == pytest.approx(1)
    strongest = SCHEMA.columns[int(np.abs(axes[:, 0]).argmax())]
    assert table["made_of"][0].startswith("+") and strongest in table["made_of"][0].split(",")[0]


def test_what_never_varies_has_no_components():
    assert (components.find(np.ones((10, 3))).share == 0).all()


def test_speeds_by_direction_and_turn():
    fps = 10.0
    # Speed, direction (left is positive), turn rate: 3 s each, but for the last.
    moves = [(0.1, 90, 0), (0.4, 0, 70), (0.4, 90, 0), (0.9, 180, 0), (0.9, -170, 0), (0.9, -90, -90)]
    states = np.repeat(np.array([*moves, (1.6, 10, 0)], float), [30] * 6 + [10], axis=0)
    table = reach.by_speed(states, np.repeat([0, 1], [100, 90]), fps).set_index("from_mps")
    assert list(table.index) == [0, 0.25, 0.5, 1.0, 1.5]
    assert table["to_mps"].iloc[-1] == 2.0
    np.testing.assert_allclose(table["seconds"], [3, 6, 9, 0, 1])
    np.testing.assert_allclose(table["left"], [np.nan, 3, 0, 0, 0])
    np.testing.assert_allclose(table["back"], [np.nan, 0, 6, 0, 0])
    np.testing.assert_allclose(table["right"], [np.nan, 0, 3, 0, 0])
    np.testing.assert_allclose(table["ahead"], [np.nan, 3, 0, 0, 1])
    np.testing.assert_allclose(table["turn_left"], [0, 3, 0, 0, 0])
    np.testing.assert_allclose(table["turn_right"], [0, 0, 3, 0, 0])
    assert list(table["clips"]) == [1, 1, 2, 0, 1]
    table = table.reset_index()
    assert reach.spans(table, "seconds") == [(0, 1.0)]
    assert reach.spans(table, "back") == [(0.5, 1.0)]
    assert reach.spans(table, "ahead") == [(0.25, 0.5)]  # a second of 1.6 m/s is too little
    assert reach.spans(table, "turn_left") == [(0.25, 0.5)]
