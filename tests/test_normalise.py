"""Normalisation and costs, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from features import presets
from features.normalise import costs, denormalise, fit, normalise, total_costs
from features.schema import Feature, Schema

LMM, O3DE = presets.load("lmm27"), presets.load("o3de59")


def rows(schema: Schema, count: int = 200, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    spread = random.uniform(0.1, 5, schema.size)
    return (random.normal(size=(count, schema.size)) * spread + random.uniform(-3, 3, schema.size)).astype(
        np.float32
    )


def test_standard_is_the_published_formula():
    raw = rows(LMM)
    offset, scale = fit(LMM, raw)
    wide = raw.astype(np.float64)
    for feature in LMM.features:
        part = wide[:, LMM.slices[feature.name]]
        deviation = [np.sqrt(np.mean((column - np.mean(column)) ** 2)) for column in part.T]
        np.testing.assert_allclose(offset[LMM.slices[feature.name]], part.mean(axis=0), rtol=1e-6)
        np.testing.assert_allclose(
            scale[LMM.slices[feature.name]], np.mean(deviation) / feature.weight, rtol=1e-6
        )


def test_a_group_shares_its_scale_but_not_its_weights():
    one = (Feature("a", "position", "head", group="g"), Feature("b", "height", "hips", weight=4, group="g"))
    schema = Schema("s", one)
    raw = rows(schema)
    _, scale = fit(schema, raw)
    np.testing.assert_allclose(scale, raw.std(axis=0, dtype=np.float64).mean() / [1, 1, 1, 4], rtol=1e-6)


def test_minmax_puts_a_single_column_into_its_weight():
    schema = Schema("s", (Feature("a", "height", "head", weight=3, scaler="minmax"),))
    raw = rows(schema)
    values = normalise(raw, *fit(schema, raw))
    assert values.min() == 0
    np.testing.assert_allclose(values.max(), 3, rtol=1e-6)


def test_none_keeps_raw_units():
    schema = Schema("s", (Feature("a", "position", "head", weight=2, scaler="none"),))
    raw = rows(schema)
    np.testing.assert_allclose(normalise(raw, *fit(schema, raw)), 2 * raw, rtol=1e-6)


@pytest.mark.parametrize("scaler", ["standard", "minmax"])
@pytest.mark.parametrize("value", [0.0, 0.93, -1234.5])
def test_a_constant_block_is_finite_and_costs_nothing(scaler, value):
    schema = Schema(
        "s",
        (
            Feature("still", "position", "head", scaler=scaler),
            Feature("moves", "height", "hips", scaler=scaler),
        ),
    )
    raw = rows(schema)
    # float32's rounding is no motion
    raw[:, :3] = value * (1 + np.random.default_rng(1).uniform(-1e-7, 1e-7, (len(raw), 3)))
    offset, scale = fit(schema, raw)
    values = normalise(raw, offset, scale)
    assert np.all(np.isfinite(values)) and np.all(np.isfinite(scale))
    query = values[0] + normalise(raw[0] + [5, -5, 5, 1], offset, scale)
    cost = costs(schema, query, values)
    assert np.all(cost[:, 0] == 0)
    assert np.any(cost[:, 1] > 0)
    np.testing.assert_allclose(denormalise(values, offset, scale), raw, rtol=1e-5, atol=1e-5)


def test_one_constant_column_leaves_its_block_alone():
    raw = rows(LMM)
    raw[:, 1] = 0.5
    offset, scale = fit(LMM, raw)
    np.testing.assert_allclose(scale[:3], raw[:, :3].std(axis=0, dtype=np.float64).mean() / 0.75, rtol=1e-6)
    assert np.all(normalise(raw, offset, scale)[:, 1] == 0)


def test_a_weight_of_zero_costs_nothing():
    schema = Schema("s", (Feature("a", "position", "head", weight=0), Feature("b", "height", "hips")))
    raw = rows(schema)
    values = normalise(raw, *fit(schema, raw))
    cost = costs(schema, values[:1], values[1:])
    assert np.all(cost[:, 0] == 0) and np.all(cost[:, 1] > 0)


@given(st.integers(0, 10_000), st.sampled_from([LMM, O3DE]), st.integers(2, 50))
def test_denormalise_undoes_normalise(seed, schema, count):
    raw = rows(schema, count, seed)
    offset, scale = fit(schema, raw)
    np.testing.assert_allclose(
        denormalise(normalise(raw, offset, scale), offset, scale), raw, rtol=1e-5, atol=1e-5
    )


def test_squared_costs_add_up_to_the_squared_distance():
    raw = rows(LMM)
    values = normalise(raw, *fit(LMM, raw)).astype(np.float64)
    found = costs(LMM, values[:7, None], values)
    assert found.shape == (7, 200, len(LMM.features))
    distance = np.sum((values[:7, None] - values) ** 2, axis=-1)
    np.testing.assert_allclose(found.sum(axis=-1), distance, rtol=1e-5)
    np.testing.assert_allclose(total_costs(LMM, values[:7, None], values), distance, rtol=1e-5)
    assert np.all(np.diagonal(found, axis1=0, axis2=1) == 0)


def test_absolute_is_the_norm_times_the_weight():
    schema = Schema("s", (Feature("a", "velocity", "head", weight=3, residual="absolute"),))
    raw = rows(schema)
    values = normalise(raw, *fit(schema, raw))
    unit = raw.std(axis=0, dtype=np.float64).mean()
    expected = 3 * np.linalg.norm(raw[0] - raw, axis=-1) / unit
    np.testing.assert_allclose(costs(schema, values[0], values)[:, 0], expected, rtol=1e-4)


def test_path_adds_samples_and_steps():
    times = (0.5, 1.0, 1.5)
    feature = Feature("p", "trajectory_position", times=times, residual="path", scaler="none", weight=2)
    schema = Schema("s", (feature,))
    query = np.array([0, 0, 3, 4, 3, 4], np.float32)
    row = np.array([0, 1, 0, 0, 3, 4], np.float32)
    # samples: 1, 5, 0; steps of the query (3, 4) (0, 0), of the row (0, -1) (3, 4)
    expected = 2 * (1 + 5 + 0 + np.hypot(3, 5) + 5)
    found = costs(schema, *(normalise(x, *fit(schema, x[None])) for x in (query, row)))
    np.testing.assert_allclose(found, [expected], rtol=1e-6)


@pytest.mark.parametrize(("name", "weight"), [("past_direction", 0.5), ("future_direction", 0.75)])
def test_o3de_direction_cost_is_the_published_one(name, weight):
    part = O3DE.slices[name]
    random = np.random.default_rng(3)
    angles = random.uniform(-np.pi, np.pi, (2, (part.stop - part.start) // 2))
    a, b = np.stack([np.sin(angles), np.cos(angles)], -1)
    raw = rows(O3DE, 2)
    raw[0, part], raw[1, part] = a.ravel(), b.ravel()
    values = normalise(raw, *fit(O3DE, raw))
    index = [f.name for f in O3DE.features].index(name)
    expected = weight * np.sum(2 * (1 - np.sum(a * b, axis=-1)) / 2)
    np.testing.assert_allclose(costs(O3DE, values[0], values[1])[index], expected, rtol=1e-5)


def test_fit_refuses_other_shapes():
    for shape in ((0, 27), (5, 26), (27,)):
        with pytest.raises(ValueError, match="expected"):
            fit(LMM, np.zeros(shape, np.float32))
