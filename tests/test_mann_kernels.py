"""lmm.mann.network, kernels and evaluator: a gate spelt out; experts that are plain networks; batches."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mann_models
import numpy as np
import pytest

from lmm.evaluator import products_here
from lmm.locomotion import layers
from lmm.mann import kernels, kernels_numpy
from lmm.mann.evaluator import MannEvaluator
from lmm.mann.network import MannNetwork
from lmm.network import Network
from motion.errors import UserError

SIZES = (70, 300, 33, 70)


def batch(network: MannNetwork, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, network.sizes[0])).astype(np.float32)


def expert(network: MannNetwork, k: int) -> Network:
    """An expert by itself."""
    return Network(
        network.input_mean, network.input_std, network.output_mean, network.output_std,
        tuple(weight[k].copy() for weight in network.weights), (None,) * len(network.weights),
        tuple(bias[k].astype(np.float32) for bias in network.biases), "elu",
    )  # fmt: skip


def gated(network: MannNetwork, scores: np.ndarray) -> MannNetwork:
    """The network with a gate that says these scores [K], whatever it sees."""
    *weights, last = network.gate_weights
    *biases, _ = network.gate_biases
    return replace(
        network, gate_weights=(*weights, last * 0), gate_biases=(*biases, scores.astype(np.float32))
    )


def by_hand(network: MannNetwork, x: np.ndarray) -> np.ndarray:
    """REFERENCE 5, for one row, in float64: the gate, then a network of mixed weights."""
    normal = (x.astype(np.float64) - network.input_mean) / network.input_std
    h = normal[network.gate_columns]
    for layer, (weight, bias) in enumerate(zip(network.gate_weights, network.gate_biases, strict=True)):
        if layer:
            h = np.where(h > 0, h, np.exp(np.minimum(h, 0)) - 1)
        h = h @ weight + bias
    share = np.exp(h) / np.exp(h).sum()
    h = normal
    for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        if layer:
            h = np.where(h > 0, h, np.exp(np.minimum(h, 0)) - 1)
        h = h @ sum(s * w for s, w in zip(share, weight, strict=True)) + share @ bias
    return h * network.output_std + network.output_mean


@pytest.mark.parametrize("kind", ["float32", "float16"])
@pytest.mark.parametrize("experts", [1, 4, 8])
@pytest.mark.parametrize("sizes", [(9, 40, 7), SIZES])
def test_it_is_the_network_of_mixed_weights(kind, experts: int, sizes: tuple[int, ...]) -> None:
    network = mann_models.network(*sizes, experts=experts).as_type(kind)
    x = batch(network, 150)
    expected = network.evaluate(x)
    for row in range(0, 150, 30):
        np.testing.assert_allclose(expected[row], by_hand(network, x[row]), rtol=5e-4, atol=5e-4)
    for compiled in (True, False):
        evaluator = MannEvaluator(network, count=150, compiled=compiled)
        np.testing.assert_allclose(evaluator.evaluate(x), expected, rtol=5e-4, atol=5e-4)
        np.testing.assert_allclose(evaluator.shares, network.gate(x), atol=1e-5)


def test_the_gate_depends_on_what_it_sees_alone() -> None:
    network = mann_models.network(9, 12, 7)
    x = batch(network, 20)
    shares = network.gate(x)
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-6)
    assert shares.std(axis=0).min() > 0.01
    unseen = np.setdiff1d(np.arange(9), network.gate_columns)
    x[:, unseen] += 1
    np.testing.assert_array_equal(network.gate(x), shares)


def test_compiled_gate_is_its_twin() -> None:
    network = mann_models.network(9, 12, 7)
    x, found = batch(network, 20), np.zeros((2, 20, 4), np.float32)
    numbers = np.concatenate([network.input_mean, network.input_std])
    for twin, shares in zip((kernels, kernels_numpy), found, strict=True):
        parts = zip(network.gate_weights, network.gate_biases, strict=True)
        between = np.zeros((2, mann_models.GATE), np.float32)
        twin.gate(x, numbers, network.gate_columns, *(p for pair in parts for p in pair), *between, shares)
    np.testing.assert_allclose(*found, atol=1e-6)
    assert found[0].std(axis=0).min() > 0.01


@pytest.mark.parametrize("count", [1, 40])
def test_one_expert_is_a_plain_network(count: int) -> None:
    network = mann_models.network(*SIZES, experts=1)
    x = batch(network, count)
    found = MannEvaluator(network, count=count).evaluate(x)
    np.testing.assert_allclose(found, expert(network, 0).evaluate(x), rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize("count", [1, 40])
def test_a_gate_that_chooses_gives_that_expert(count: int) -> None:
    network = mann_models.network(*SIZES)
    x = batch(network, count)
    for k in range(4):
        one = gated(network, np.where(np.arange(4) == k, 0, -200))
        found = MannEvaluator(one, count=count).evaluate(x)
        np.testing.assert_allclose(found, expert(network, k).evaluate(x), rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize("count", [1, 40])
def test_equal_experts_are_a_plain_network_whatever_the_gate(count: int) -> None:
    network = mann_models.network(*SIZES)
    equal = replace(
        network,
        weights=tuple(np.repeat(weight[:1], 4, axis=0) for weight in network.weights),
        biases=tuple(np.repeat(bias[:1], 4, axis=0) for bias in network.biases),
    )
    x = batch(network, count)
    found = MannEvaluator(equal, count=count).evaluate(x)
    np.testing.assert_allclose(found, expert(network, 0).evaluate(x), rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize("kind", ["float32", "float16"])
@pytest.mark.parametrize("experts", [4, 8])
def test_a_row_does_the_same_in_any_batch_bit_for_bit(kind, experts: int) -> None:
    network = mann_models.network(40, 70, 20, experts=experts).as_type(kind)
    x = batch(network, 256)
    assert len(x) > layers.BLOCK
    whole, one = MannEvaluator(network, count=256), MannEvaluator(network)
    expected = whole.evaluate(x).copy()
    for n in range(0, 256, 7):
        np.testing.assert_array_equal(one.evaluate(x[n : n + 1])[0], expected[n])
    for count in (2, 5, 13, 30, 100):
        np.testing.assert_array_equal(whole.evaluate(x[:count]), expected[:count])


def test_bfloat16_products_are_those_of_rounded_numbers() -> None:
    network = mann_models.network(*SIZES)
    x = batch(network, 150)
    exact = network.evaluate(x)
    expected = MannEvaluator(network, products="bfloat16", count=150, compiled=False).evaluate(x)
    off = np.abs(expected - exact).max()
    assert 1e-3 < off < 0.1 * np.abs(exact).max()
    if "bfloat16" not in products_here():
        with pytest.raises(UserError, match="does not multiply bfloat16"):
            MannEvaluator(network, products="bfloat16")
        return
    evaluator = MannEvaluator(network, products="bfloat16", count=150)
    for count in (1, 2, 3, 20, 150):
        found = evaluator.evaluate(x[:count])
        # Sums round otherwise, and then what is rounded to 8 bits may fall to the other side.
        assert np.abs(found - expected[:count]).max() < off / 4
        assert np.abs(found - expected[:count]).mean() < np.abs(expected - exact).mean() / 10
    assert evaluator.memory()["network"] == network.weight_bytes // 2


def test_memory_and_parameters_are_those_of_the_arrays() -> None:
    network = mann_models.network(40, 70, 20, experts=8)
    sizes = [(8, *size) for size in pairwise(network.sizes)]
    assert network.weight_bytes == 4 * sum(k * i * o + k * o for k, i, o in sizes)
    assert network.as_type("float16").weight_bytes * 2 == network.weight_bytes
    assert network.gate_sizes == (20, 12, 12, 8)
    evaluator = MannEvaluator(network)
    memory, packed = evaluator.memory(), evaluator.packed
    assert memory["network"] == network.weight_bytes
    stored = sum(memory.values()) - memory["gate"] - memory["workspace"]
    assert stored == packed.weights.nbytes + packed.numbers.nbytes
    assert memory["gate"] > 4 * network.gate_parameters


@pytest.mark.parametrize("kind", ["float32", "float16"])
def test_arrays_there_and_back(kind) -> None:
    network = mann_models.network(9, 12, 12, 7).as_type(kind)
    back = MannNetwork.from_arrays("n.", network.to_arrays("n."))
    x = batch(network, 3)
    np.testing.assert_array_equal(back.evaluate(x), network.evaluate(x))
    assert back.sizes == network.sizes and back.weight_type == kind
    assert back.gate_weights[0].dtype == np.float32
    assert repr(back) == f"MannNetwork(9-12-12-7, {kind})"


def test_parts_that_do_not_fit_are_refused() -> None:
    network = mann_models.network(9, 12, 7)
    weights, biases = network.gate_weights, network.gate_biases
    faults = {
        "weights of layer 1": {"weights": (network.weights[0], network.weights[1][:, :-1])},
        "divided by 0": {"input_std": network.input_std * 0},
        "none of 9": {"gate_columns": network.gate_columns + 5},
        "gate_columns": {"gate_columns": network.gate_columns.astype(np.int32)},
        "gate weights of layer 0": {"gate_columns": network.gate_columns[:-1]},
        "gate biases of layer 2": {"gate_biases": (*biases[:2], biases[2][:-1])},
        "gate weights of layer 1": {"gate_weights": (weights[0], weights[1][:-1], weights[2])},
        "a gate of 2 weights": {"gate_weights": weights[:2]},
    }
    for message, change in faults.items():
        with pytest.raises(ValueError, match=message):
            replace(network, **change)


def test_other_batches_than_it_has_room_for_are_refused() -> None:
    evaluator = MannEvaluator(mann_models.network(9, 12, 7), count=2)
    for shape in ((3, 9), (2, 8)):
        with pytest.raises(ValueError, match="expected up to 2 of 9"):
            evaluator.evaluate(np.zeros(shape, np.float32))
    with pytest.raises(UserError, match="bfloat16x2"):
        MannEvaluator(mann_models.network(9, 12, 7), products="bfloat16x2", compiled=False)
