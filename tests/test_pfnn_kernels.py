"""lmm.pfnn.kernels and evaluator: against twin and plain network; a row does the same in any batch."""

from __future__ import annotations

import numpy as np
import pfnn_models
import pytest

from lmm.evaluator import products_here
from lmm.locomotion import layers
from lmm.pfnn import kernels, kernels_numpy, spline
from lmm.pfnn.evaluator import PhaseEvaluator
from motion.errors import UserError

MODES = ["cubic", "linear", "constant"]


def batch(network, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((count, network.sizes[0])).astype(np.float32)
    return x, rng.uniform(0, 2 * np.pi, count).astype(np.float32)


@pytest.mark.parametrize("kind", ["float32", "float16"])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("sizes", [(9, 40, 7), (70, 300, 33, 70)])
def test_it_is_the_network(mode: spline.Mode, kind, sizes: tuple[int, ...]) -> None:
    network = pfnn_models.network(*sizes).as_type(kind)
    x, phases = batch(network, 150)
    phases[:6] = 0, 2 * np.pi, np.pi / 2, 0.97 * 2 * np.pi, np.nextafter(np.float32(2 * np.pi), 0), 1e-9
    expected = network.evaluate(x, phases, mode)
    for compiled in (True, False):
        found = PhaseEvaluator(network, mode=mode, count=150, compiled=compiled).evaluate(x, phases)
        np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize("kind", ["float32", "float16"])
@pytest.mark.parametrize("mode", MODES)
def test_a_row_does_the_same_in_any_batch_bit_for_bit(mode: spline.Mode, kind) -> None:
    network = pfnn_models.network(40, 70, 20).as_type(kind)
    x, phases = batch(network, 256)
    whole = PhaseEvaluator(network, mode=mode, count=256)
    expected = whole.evaluate(x, phases).copy()
    one = PhaseEvaluator(network, mode=mode, count=1)
    for n in range(0, 256, 7):
        np.testing.assert_array_equal(one.evaluate(x[n : n + 1], phases[n : n + 1])[0], expected[n])
    for count in (2, 5, 13, 30, 100):
        np.testing.assert_array_equal(whole.evaluate(x[:count], phases[:count]), expected[:count])
    together = np.full(256, phases[3])  # all of one set, more than a block
    crowd = whole.evaluate(x, together).copy()
    assert len(x) > layers.BLOCK
    np.testing.assert_array_equal(one.evaluate(x[200:201], together[:1])[0], crowd[200])


@pytest.mark.parametrize("mode", MODES)
def test_bfloat16_products_are_those_of_rounded_numbers(mode: spline.Mode) -> None:
    network = pfnn_models.network(70, 300, 33, 70)
    x, phases = batch(network, 150)
    exact = network.evaluate(x, phases, mode)
    twin = PhaseEvaluator(network, mode=mode, products="bfloat16", count=150, compiled=False)
    expected = twin.evaluate(x, phases)
    off = np.abs(expected - exact).max()
    assert 1e-3 < off < 0.1 * np.abs(exact).max()
    if "bfloat16" not in products_here():
        with pytest.raises(UserError, match="does not multiply bfloat16"):
            PhaseEvaluator(network, mode=mode, products="bfloat16")
        return
    evaluator = PhaseEvaluator(network, mode=mode, products="bfloat16", count=150)
    for count in (1, 2, 3, 20, 150):
        found = evaluator.evaluate(x[:count], phases[:count])
        # Sums round otherwise, and then what is rounded to 8 bits may fall to the other side.
        assert np.abs(found - expected[:count]).max() < off / 4
        assert np.abs(found - expected[:count]).mean() < np.abs(expected - exact).mean() / 20
    assert evaluator.memory()["network"] == network.weight_bytes(mode) // 2


@pytest.mark.parametrize("twin", [kernels, kernels_numpy])
def test_rows_are_sorted_by_set(twin) -> None:
    first = np.random.default_rng(1).integers(0, 10, 300)
    order, ends = np.zeros(300, np.int64), np.zeros(10, np.int64)
    twin.sort(first, order, ends)
    np.testing.assert_array_equal(order, np.argsort(first, kind="stable"))
    np.testing.assert_array_equal(ends, np.cumsum(np.bincount(first, minlength=10)))


def test_inputs_that_it_shall_not_see_change_nothing() -> None:
    network = pfnn_models.network(9, 12, 7)
    network.input_std[4] = 9e11
    x, phases = batch(network, 3)
    evaluator = PhaseEvaluator(network, count=3)
    expected = evaluator.evaluate(x, phases).copy()
    x[:, 4] += 100
    np.testing.assert_array_equal(evaluator.evaluate(x, phases), expected)
    np.testing.assert_allclose(expected, network.evaluate(x, phases), rtol=2e-4, atol=2e-4)


def test_memory_is_that_of_the_sets_and_what_pads_them() -> None:
    network = pfnn_models.network(40, 70, 20)
    for mode in MODES:
        evaluator = PhaseEvaluator(network, mode=mode)
        memory = evaluator.memory()
        assert memory["network"] == network.weight_bytes(mode)
        packed = evaluator.packed
        room = memory.pop("workspace")
        assert sum(memory.values()) == packed.weights.nbytes + packed.numbers.nbytes
        assert room > 4 * sum(network.sizes)


def test_other_batches_than_it_has_room_for_are_refused() -> None:
    network = pfnn_models.network(9, 12, 7)
    evaluator = PhaseEvaluator(network, count=2)
    for shape, phases, message in (
        ((3, 9), 3, "expected up to 2 of 9"),
        ((2, 8), 2, "expected up to 2 of 9"),
        ((2, 9), 1, "expected one for each of 2"),
    ):
        with pytest.raises(ValueError, match=message):
            evaluator.evaluate(np.zeros(shape, np.float32), np.zeros(phases, np.float32))
    with pytest.raises(UserError, match="no phase mode"):
        PhaseEvaluator(network, mode="quartic")  # type: ignore[arg-type]
