"""lmm.pfnn.network: blending spelt out for a row; sizes; float16; arrays there and back; faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pfnn_models
import pytest

from lmm.pfnn import spline
from lmm.pfnn.network import PhaseNetwork
from motion.errors import UserError


def by_hand(network: PhaseNetwork, x: np.ndarray, phase: float) -> np.ndarray:
    """REFERENCE 4.1's formula, for one row, in float64."""
    w = 4 * phase / (2 * np.pi)
    k, w = int(w), w - int(w)
    h = (x.astype(np.float64) - network.input_mean) / network.input_std
    for layer in range(len(network.weights)):
        blended = []
        for part in (network.weights[layer], network.biases[layer]):
            a0, a1, a2, a3 = (part[(k + n - 1) % 4].astype(np.float64) for n in range(4))
            blended.append(
                a1 + w * (a2 - a0) / 2 + w**2 * (a0 - 5 / 2 * a1 + 2 * a2 - a3 / 2)
                + w**3 * (3 / 2 * a1 - 3 / 2 * a2 + a3 / 2 - a0 / 2)
            )  # fmt: skip
        h = h @ blended[0] + blended[1]
        if layer < len(network.weights) - 1:
            h = np.where(h > 0, h, np.exp(np.minimum(h, 0)) - 1)
    return h * network.output_std + network.output_mean


@pytest.mark.parametrize("hidden", [1, 2, 3])
def test_it_is_the_network_of_the_blended_weights(hidden: int) -> None:
    network = pfnn_models.network(9, *[12] * hidden, 7)
    rng = np.random.default_rng(1)
    x, phases = rng.standard_normal((20, 9)).astype(np.float32), rng.uniform(0, 2 * np.pi, 20)
    found = network.evaluate(x, phases)
    for row, phase, y in zip(x, phases, found, strict=True):
        np.testing.assert_allclose(y, by_hand(network, row, phase), rtol=2e-4, atol=2e-4)


def test_the_sets_of_a_mode_are_networks_of_their_own_phase() -> None:
    network = pfnn_models.network(9, 12, 7)
    x = np.random.default_rng(2).standard_normal((9, 9)).astype(np.float32)
    for mode, count in (("linear", 10), ("constant", 50)):
        phases = 2 * np.pi / count * np.array([0, 1, 2, 3, 4, 6, 7, 8, 9])
        np.testing.assert_allclose(
            network.evaluate(x, phases, mode), network.evaluate(x, phases), rtol=1e-4, atol=1e-4
        )


def test_bytes_are_those_of_the_reference() -> None:
    """REFERENCE 4.3."""
    sizes = ((342, 512), (512, 512), (512, 311))
    weights = tuple(np.zeros((4, *size), np.float32) for size in sizes)
    biases = tuple(np.zeros((4, size[1]), np.float32) for size in sizes)
    ends = np.zeros(342, np.float32), np.ones(342, np.float32), *np.zeros((2, 311), np.float32)
    network = PhaseNetwork(*ends, weights, biases)
    assert [round(network.weight_bytes(mode) / 1e6, 1) for mode in spline.SETS] == [9.6, 23.9, 119.6]
    assert network.as_type("float16").weight_bytes() * 2 == network.weight_bytes()
    assert network.sizes == (342, 512, 512, 311)


def test_float16_rounds_to_the_nearest_and_refuses_what_does_not_fit() -> None:
    network = pfnn_models.network(9, 12, 7)
    half = network.as_type("float16")
    for whole, rounded in zip(network.weights, half.weights, strict=True):
        np.testing.assert_allclose(rounded, whole, rtol=2**-11, atol=1e-7)
    assert half.input_mean.dtype == np.float32
    large = replace(network, biases=(network.biases[0] + 1e5, network.biases[1]))
    with pytest.raises(UserError, match="float16"):
        large.as_type("float16")


def test_arrays_there_and_back() -> None:
    network = pfnn_models.network(9, 12, 12, 7).as_type("float16")
    back = PhaseNetwork.from_arrays("n.", network.to_arrays("n."))
    x = np.ones((1, 9), np.float32)
    np.testing.assert_array_equal(back.evaluate(x, [1.0]), network.evaluate(x, [1.0]))
    assert back.sizes == network.sizes and back.weight_type == "float16"


def test_parts_that_do_not_fit_are_refused() -> None:
    network = pfnn_models.network(9, 12, 7)
    faults = {
        "weights of layer 1": {"weights": (network.weights[0], network.weights[1][:, :-1])},
        "biases of layer 0": {"biases": (network.biases[0][:3], network.biases[1])},
        "input_mean": {"input_mean": network.input_mean[:-1]},
        "divided by 0": {"input_std": network.input_std * 0},
        "2 weights, 1 biases": {"biases": network.biases[:1]},
        "weights of float64": {"weights": tuple(w.astype(np.float64) for w in network.weights)},
    }
    for message, change in faults.items():
        with pytest.raises(ValueError, match=message):
            replace(network, **change)
