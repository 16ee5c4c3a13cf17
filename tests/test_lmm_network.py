"""A network: what it computes, what rounding its weights costs, and what is no network."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmm.network import Network, elu
from motion.errors import UserError


def _inputs(count: int, width: int) -> np.ndarray:
    return np.random.default_rng(count).standard_normal((count, width)).astype(np.float32)


def _by_hand(network: Network, x: np.ndarray) -> list[float]:
    """One row, in Python's numbers, straight from the formula."""
    values = [(float(v) - m) / s for v, m, s in zip(x, network.input_mean, network.input_std, strict=True)]
    for layer, bias in enumerate(network.biases):
        if layer and network.activation == "relu":
            values = [max(v, 0.0) for v in values]
        elif layer:
            values = [v if v > 0 else np.exp(v) - 1 for v in values]
        stored, scale = network.weights[layer].astype(float), network.scales[layer]
        weight = stored if scale is None else stored * scale
        values = [
            float(bias[o]) + sum(v * weight[i, o] for i, v in enumerate(values)) for o in range(len(bias))
        ]
    return [v * s + m for v, m, s in zip(values, network.output_mean, network.output_std, strict=True)]


@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("sizes", [(3, 2), (3, 5, 2), (1, 7, 4, 1)])
def test_it_computes_the_formula(sizes: tuple[int, ...], activation: str, kind: str) -> None:
    network = lmm_models.network(*sizes, activation=activation).as_type(kind)  # type: ignore[arg-type]
    x = _inputs(4, sizes[0])
    found = network.evaluate(x)
    assert found.shape == (4, sizes[-1]) and found.dtype == np.float32
    np.testing.assert_allclose(found, [_by_hand(network, row) for row in x], rtol=1e-4, atol=1e-4)


def test_outputs_that_do_not_vary_are_their_mean() -> None:
    network = lmm_models.network(3, 5, 2)
    network.output_std[1] = 0
    np.testing.assert_array_equal(network.evaluate(_inputs(9, 3))[:, 1], network.output_mean[1])


def test_elu_far_below_zero_is_quiet() -> None:
    x = np.array([-1e30, -200, -1, 0, 2, 1e30], np.float32)
    np.testing.assert_allclose(elu(x), [-1, -1, np.exp(-1) - 1, 0, 2, 1e30], rtol=1e-6)


def test_sizes_are_counted() -> None:
    network = lmm_models.network(3, 5, 2)
    assert network.sizes == (3, 5, 2) and network.parameters == 3 * 5 + 5 + 5 * 2 + 2
    rest = 4 * (2 * 3 + 2 * 2 + 5 + 2)  # normalisation and biases stay float32
    assert network.nbytes == rest + 4 * 25
    assert network.as_type("float16").nbytes == rest + 2 * 25
    assert network.as_type("int8").nbytes == rest + 25 + 4 * (5 + 2)
    assert repr(network.as_type("int8")) == "Network(3-5-2, int8)"


@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
def test_arrays_round_trip(kind: str) -> None:
    network = lmm_models.network(3, 5, 2, activation="elu").as_type(kind)  # type: ignore[arg-type]
    arrays = network.to_arrays("a.") | lmm_models.network(7, 7, 7, 7).to_arrays("b.")
    again = Network.from_arrays("a.", arrays, "elu")
    assert again.weight_type == kind and again.activation == "elu" and again.sizes == network.sizes
    for name, array in again.to_arrays("a.").items():
        np.testing.assert_array_equal(array, arrays[name])
        assert array.dtype == arrays[name].dtype
    x = _inputs(5, 3)
    np.testing.assert_array_equal(again.evaluate(x), network.evaluate(x))
    del arrays["a.output_std"]
    with pytest.raises(KeyError, match=r"a\.output_std"):
        Network.from_arrays("a.", arrays)


# Weights stored otherwise


def test_int8_is_off_by_at_most_half_a_scale() -> None:
    network = lmm_models.network(40, 30, 20)
    network.weights[0][:, 3] *= np.float32(1e6)  # an output's weights tell nothing of its neighbour's scale
    network.weights[0][:, 4] = 0
    small = network.as_type("int8")
    for layer, scale in enumerate(small.scales):
        off = np.abs(small.weight(layer) - network.weight(layer))
        assert scale is not None and np.all(off <= 0.5001 * scale)
        largest = np.abs(network.weight(layer)).max(axis=0)
        some = largest > 0
        np.testing.assert_allclose(scale[some], largest[some] / 127, rtol=1e-6)
        assert np.all(np.abs(small.weights[layer].astype(int)).max(axis=0)[some] == 127)
    assert np.all(small.weight(0)[:, 4] == 0)


def test_float16_is_off_by_at_most_half_a_digit() -> None:
    network = lmm_models.network(40, 30, 20)
    for one, other in zip(network.weights, network.as_type("float16").weights, strict=True):
        assert np.all(np.abs(other - one) <= 2.0**-11 * np.abs(one) + 2.0**-25)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["float16", "int8"]))
def test_rounding_the_weights_of_a_layer_moves_outputs_by_no_more_than_it_may(seed: int, kind: str) -> None:
    """The bound of one layer: the sum over inputs of what each weight is off by, times the input."""
    network = lmm_models.network(12, 9, seed=seed)
    small = network.as_type(kind)  # type: ignore[arg-type]
    x = _inputs(6, 12)
    seen = np.abs((x - network.input_mean) / network.input_std)
    most = seen @ np.abs(small.weight(0) - network.weight(0)) * network.output_std
    moved = np.abs(small.evaluate(x) - network.evaluate(x))
    assert np.all(moved <= most + 1e-4 * (1 + np.abs(network.evaluate(x))))
    if kind == "int8":
        assert small.scales[0] is not None
        assert np.all(most <= 0.5001 * seen.sum(axis=1, keepdims=True) * small.scales[0] * network.output_std)


@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
def test_storing_twice_loses_nothing_more(kind: str) -> None:
    once = lmm_models.network(20, 16, 8).as_type(kind)  # type: ignore[arg-type]
    for middle in ("float32", kind):
        twice = once.as_type(middle).as_type(kind)  # type: ignore[arg-type]
        for name, array in once.to_arrays("").items():
            np.testing.assert_allclose(twice.to_arrays("")[name], array, rtol=1e-6)
        assert twice.weight_type == kind


def test_weights_beyond_float16_are_refused() -> None:
    network = lmm_models.network(3, 2)
    network.weights[0][0, 0] = 70_000
    with pytest.raises(UserError, match="up to 70000 do not fit float16; take int8 or float32"):
        network.as_type("float16")
    assert np.isfinite(network.as_type("int8").weight(0)).all()


# What is no network


def _one(**changes: object) -> Network:
    return replace(lmm_models.network(3, 4, 2), **changes)  # type: ignore[arg-type]


def _zeros(*shape: int, dtype: str = "float32") -> np.ndarray:
    return np.zeros(shape, dtype)


WRONG = {
    "no layers": ({"weights": (), "biases": (), "scales": ()}, "0 weights"),
    "a bias missing": ({"biases": (_zeros(4),)}, "2 weights, 1 biases"),
    "layers that do not follow": ({"weights": (_zeros(3, 4), _zeros(5, 2))}, r"weight of layer 1 .*\(4, 2\)"),
    "a bias too long": ({"biases": (_zeros(5), _zeros(2))}, r"bias of layer 0 .*\(4,\)"),
    "a mean too short": ({"input_mean": _zeros(2)}, r"input_mean .*\(3,\)"),
    "a mean of doubles": ({"output_mean": _zeros(2, dtype="float64")}, "output_mean are float64"),
    "weights of doubles": ({"weights": (_zeros(3, 4, dtype="float64"), _zeros(4, 2))}, "weights of float64"),
    "weights of two types": (
        {"weights": (_zeros(3, 4), _zeros(4, 2, dtype="float16"))}, "layer 1 are float16"),
    "int8 without scales": (
        {"weights": (_zeros(3, 4, dtype="int8"), _zeros(4, 2, dtype="int8"))}, "do not go together"),
    "scales without int8": ({"scales": (np.ones(4, np.float32), None)}, "do not go together"),
    "division by 0": ({"input_std": np.array([1, 0, 1], np.float32)}, "input 1 is divided by 0"),
    "division by NaN": ({"input_std": np.array([1, 1, np.nan], np.float32)}, "input 2 is divided by nan"),
    "another activation": ({"activation": "tanh"}, "activation 'tanh'"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_what_does_not_fit_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _one(**changes)
