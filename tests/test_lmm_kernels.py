"""Networks at run time: compiled kernels against their twin, the formula itself, and public outputs."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from lmm import kernels, kernels_numpy, lanes, tiles
from lmm.evaluator import Evaluator
from lmm.interchange import read_network
from lmm.layout import Layout
from lmm.network import Network, to_bfloat16
from motion import quat
from motion.errors import UserError
from motion.pose import Poses

TYPES = ("float32", "float16", "int8")
# Narrow and wide, shallow and deep; panels of 32, 8 at a time, are met exactly and missed both ways.
SIZES = ((5, 7), (27, 64, 32), (59, 96, 338), (3, 300, 33, 257), (40, 17, 31, 65, 129, 2))


def random_network(sizes: tuple[int, ...], *, seed: int = 0, activation: str = "relu") -> Network:
    rng = np.random.default_rng(seed)

    def row(n: int, low: float, high: float) -> np.ndarray:
        return rng.uniform(low, high, n).astype(np.float32)

    weights = [
        rng.normal(size=(i, o)).astype(np.float32) * np.float32((2 / i) ** 0.5) for i, o in pairwise(sizes)
    ]
    return Network(
        row(sizes[0], -1, 1), row(sizes[0], 0.5, 2), row(sizes[-1], -1, 1), row(sizes[-1], 0.5, 2),
        tuple(weights), (None,) * len(weights), tuple(row(o, -0.2, 0.2) for o in sizes[1:]), activation,
    )  # fmt: skip


def inputs(network: Network, count: int) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(count, network.sizes[0])).astype(np.float32)


@pytest.mark.parametrize("weight_type", TYPES)
@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("sizes", SIZES, ids=lambda sizes: "-".join(map(str, sizes)))
def test_kernels_equal_their_twin_and_the_networks_formula(sizes, activation, weight_type):
    network = random_network(sizes, activation=activation).as_type(weight_type)
    evaluators = Evaluator(network), Evaluator(network, compiled=False)
    for count in (1, 2, kernels.FEW + 1, kernels.FEW_COMPACT + 1, 2 * kernels.BLOCK + 5):
        x = inputs(network, count)
        fast, twin = (evaluator.evaluate(x).copy() for evaluator in evaluators)
        expected = network.evaluate(x.astype(np.float64))
        np.testing.assert_allclose(fast, twin, atol=2e-5)
        np.testing.assert_allclose(fast, expected, atol=2e-5)
    assert expected.std() > 0.1


@pytest.mark.parametrize("weight_type", TYPES)
def test_a_row_gives_the_same_alone_and_among_many(weight_type):
    network = random_network((59, 256, 256, 90)).as_type(weight_type)
    evaluator = Evaluator(network, count=1024)
    x = inputs(network, 1024)
    many = evaluator.evaluate(x).copy()
    for row in (0, 500, 1023):
        np.testing.assert_allclose(evaluator.evaluate(x[row : row + 1])[0], many[row], atol=5e-6)
    # A row's neighbours do not matter, nor where it stands among them.
    np.testing.assert_array_equal(evaluator.evaluate(np.ascontiguousarray(x[::-1]))[-1], many[0])


def test_the_activation_is_exp_minus_1():
    x = np.concatenate([-np.logspace(-9, 3, 1000), [0, 3, -np.inf, np.inf]]).astype(np.float32)
    found = x.copy()
    kernels.elu_of(found, len(found))
    with np.errstate(over="ignore"):
        np.testing.assert_allclose(found, np.where(x > 0, x, np.expm1(x.astype(np.float64))), rtol=1e-6)
    nan = np.full(3, np.nan, np.float32)
    kernels.elu_of(nan, 2)
    assert np.isnan(nan).all()


@pytest.mark.parametrize("count", [1, 30])
def test_what_is_not_finite_is_not_hidden(count):
    network = random_network((6, 40, 5))
    x = inputs(network, count)
    x[-1, 2] = np.nan
    y = Evaluator(network).evaluate(x)
    assert np.isnan(y[-1]).all() and np.isfinite(y[:-1]).all()


@pytest.mark.parametrize("weight_type", TYPES)
def test_outputs_that_do_not_vary_cost_nothing(weight_type):
    network = random_network((8, 50, 70))
    std, last = network.output_std.copy(), network.weights[-1].copy()
    std[:30] = 0
    std[40] = 1e-15
    last[:, 50:60] = 0
    network = replace(network, output_std=std, weights=(*network.weights[:-1], last)).as_type(weight_type)
    evaluator = Evaluator(network)
    still = np.r_[0:30, 40, 50:60]
    assert set(evaluator.packed.columns) == set(range(70)) - set(still)
    assert evaluator.packed.layers[-1, 1] == 1
    x = inputs(network, 20)
    y = evaluator.evaluate(x)
    np.testing.assert_allclose(y, network.evaluate(x), atol=1e-5)
    assert (y[:, still] == y[0, still]).all()


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("sizes", [(4, 6), (4, 8, 6)])
def test_a_network_without_anything_that_varies(sizes, compiled):
    network = random_network(sizes)
    network = replace(network, output_std=np.zeros(6, np.float32))
    found = Evaluator(network, compiled=compiled).evaluate(inputs(network, 9))
    np.testing.assert_array_equal(found, [network.output_mean] * 9)


def test_bytes_are_those_of_the_weights_as_they_are_stored():
    network = random_network((64, 512, 512, 64))
    sizes = {name: Evaluator(network.as_type(name)).nbytes for name in TYPES}
    weights = 64 * 512 * 2 + 512 * 512
    others = 4 * (2 * 64 + 64 + 2 * (512 + 512 + 64))
    for name, bytes_each in zip(TYPES, (4, 2, 1), strict=True):
        assert 0 <= sizes[name] - bytes_each * weights - others < 1000


def test_batches_may_grow_and_inputs_must_be_whole():
    network = random_network((5, 9, 4))
    evaluator = Evaluator(network, count=2)
    x = inputs(network, 300)
    np.testing.assert_allclose(evaluator.evaluate(x), network.evaluate(x), atol=1e-5)
    assert evaluator.evaluate(x[:0]).shape == (0, 4)
    with pytest.raises(ValueError, match="5 inputs"):
        evaluator.evaluate(x[:, :4].copy())


@pytest.mark.parametrize("name", ["decompressor", "stepper", "projector"])
@pytest.mark.parametrize("compiled", [True, False])
def test_public_networks_give_the_public_outputs(data, name, compiled):
    network = read_network(data / f"reference/orangeduck/{name}.bin")
    table = np.loadtxt(
        data / f"reference/oracle/network_{name}.csv", delimiter=",", skiprows=1, dtype=np.float32
    )
    x, expected = np.split(table, [network.sizes[0]], axis=1)
    assert expected.shape == (32, network.sizes[-1])
    evaluator = Evaluator(network, compiled=compiled)
    for rows in (slice(None), slice(0, 1)):
        # Outputs are printed to six decimals and range over tens.
        np.testing.assert_allclose(evaluator.evaluate(x[rows]), expected[rows], rtol=1e-5, atol=2e-5)


@pytest.fixture(params=["tiles", "pairs", "twin"])
def bfloat16(request, monkeypatch):
    """Evaluates a network by products of bfloat16 numbers, in every way in which this processor can."""
    if request.param != "twin" and not lanes.MULTIPLIES_PAIRS:
        pytest.skip("this processor does not multiply bfloat16 numbers")
    if request.param == "tiles" and not tiles.permitted():
        pytest.skip("this process may not use matrix tiles")
    monkeypatch.setattr(tiles, "permitted", lambda: request.param == "tiles")
    return lambda network, products="bfloat16": Evaluator(
        network, products=products, compiled=request.param != "twin"
    )


def rounded(x: np.ndarray) -> np.ndarray:
    """To 8 significant bits by what a number is, not by its bits."""
    part, exponent = np.frexp(np.asarray(x, np.float64))
    return np.ldexp(np.rint(256 * part), exponent - 8)


def test_rounding_to_bfloat16_is_to_the_nearest_even_number():
    rng = np.random.default_rng(0)
    x = (rng.normal(size=10**4) * 10.0 ** rng.uniform(-30, 30, 10**4)).astype(np.float32)
    ties = np.arange(-999, 999, dtype=np.float32) + 0.5  # between 128 and 256 halfway
    for values in (x, ties, np.float32([0, -0.0, np.inf, -np.inf, np.nan])):
        found = to_bfloat16(values)
        np.testing.assert_array_equal(found, rounded(values))
        assert found.dtype == np.float32 and not np.any(found.view(np.uint32) & 0xFFFF)
    assert np.signbit(to_bfloat16(np.float32([-0.0]))).all()


def rounded_twice(x: np.ndarray) -> np.ndarray:
    return rounded(x) + rounded(x - rounded(x))


def expected_of_bfloat16(network: Network, x: np.ndarray, of_inputs: Callable) -> np.ndarray:
    """The network's outputs, inputs of its layers and weights rounded, all else as it is."""
    x = ((x - network.input_mean) / network.input_std).astype(np.float32)
    for layer, (weight, scale) in enumerate(zip(network.weights, network.scales, strict=True)):
        if layer:
            x = np.maximum(x, 0) if network.activation == "relu" else np.where(x > 0, x, np.expm1(x))
        x = (of_inputs(x) @ rounded(weight) * (1 if scale is None else scale)).astype(np.float32)
        x += network.biases[layer]
    return x * network.output_std + network.output_mean


@pytest.mark.parametrize("weight_type", TYPES)
@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("sizes", SIZES, ids=lambda sizes: "-".join(map(str, sizes)))
@pytest.mark.parametrize("products", ["bfloat16", "bfloat16x2"])
def test_bfloat16_products_equal_the_formula(bfloat16, products, sizes, activation, weight_type):
    network = random_network(sizes, activation=activation).as_type(weight_type)
    evaluator = bfloat16(network, products)
    for count in (1, 2, 15, 17, kernels.BLOCK + 1, 2 * kernels.BLOCK + 37):
        x = inputs(network, count)
        expected = expected_of_bfloat16(network, x, rounded if products == "bfloat16" else rounded_twice)
        apart = np.abs(evaluator.evaluate(x) - expected)
        # Sums differ by their order, and now and then that decides which way an input is rounded.
        usual, most = (1e-6, 1e-2) if products == "bfloat16" else (2e-5, 2e-4)
        assert np.median(apart) < usual and apart.max() < (2e-5 if len(sizes) == 2 else most)
        if weight_type != "int8":  # which bfloat16 holds exactly
            assert np.median(np.abs(expected - network.evaluate(x))) > 5e-4  # as float32 products would be


@pytest.mark.parametrize("sizes", [(37, 41), (37, 45, 70, 41)])
def test_bfloat16_products_are_exact_where_nothing_is_rounded(bfloat16, sizes):
    """Small multiples of 1/8 need few bits, and their sums are the same in any order."""
    rng = np.random.default_rng(0)
    network = random_network(sizes)
    weights = [rng.integers(-1, 2, w.shape).astype(np.float32) / 2 for w in network.weights]
    ones, noughts = np.ones, np.zeros
    network = Network(
        noughts(37, np.float32), ones(37, np.float32), noughts(41, np.float32), ones(41, np.float32),
        tuple(weights), (None,) * len(weights), tuple(noughts(o, np.float32) for o in sizes[1:]), "relu",
    )  # fmt: skip
    for count in (1, 3, 16, 50, 200):
        x = rng.integers(-4, 5, (count, 37)).astype(np.float32)
        expected = network.evaluate(x.astype(np.float64))
        np.testing.assert_array_equal(bfloat16(network).evaluate(x), expected)


def test_a_row_of_bfloat16_products_gives_the_same_wherever_it_stands(bfloat16, request):
    network = random_network((59, 256, 256, 90))
    evaluator = bfloat16(network)
    x = inputs(network, 1024)
    many = evaluator.evaluate(x).copy()
    # The twin's products are a library's, whose sums may run otherwise in the last rows.
    off = 1e-5 if "twin" in request.node.callspec.id else 0
    last = evaluator.evaluate(np.ascontiguousarray(x[::-1]))[-1]
    np.testing.assert_allclose(last, many[0], rtol=off, atol=off)
    for row in (0, 500, 1023):
        np.testing.assert_allclose(evaluator.evaluate(x[row : row + 1])[0], many[row], atol=1e-2)


@pytest.mark.parametrize("count", [1, 30])
def test_bfloat16_products_do_not_hide_what_is_not_finite(bfloat16, count):
    network = random_network((6, 40, 5))
    x = inputs(network, count)
    strange = [np.uint32(bits).view(np.float32) for bits in (0x7FFFFFFF, 0xFFFFFFFF)]
    for bad, products in product([np.nan, *strange], ["bfloat16", "bfloat16x2"]):
        x[-1, 2] = bad
        evaluator = bfloat16(network, products)
        evaluator.evaluate(np.full((40, 6), np.nan, np.float32))  # what is left of it does not matter
        y = evaluator.evaluate(x)
        assert np.isnan(y[-1]).all() and np.isfinite(y[:-1]).all()


def test_bfloat16_products_of_a_network_without_anything_that_varies(bfloat16):
    network = replace(random_network((4, 8, 6)), output_std=np.zeros(6, np.float32))
    found = bfloat16(network).evaluate(inputs(network, 9))
    np.testing.assert_array_equal(found, [network.output_mean] * 9)
    assert bfloat16(network).evaluate(np.zeros((0, 4), np.float32)).shape == (0, 6)


def test_bfloat16_products_read_two_bytes_a_weight(bfloat16):
    network = random_network((64, 512, 512, 64))
    assert Evaluator(network).nbytes - bfloat16(network).nbytes == 2 * (64 * 512 * 2 + 512 * 512)
    assert Evaluator(network).nbytes == bfloat16(network, "bfloat16x2").nbytes


def test_inputs_of_two_bfloat16_numbers_hardly_tremble(bfloat16):
    """Where weights are short only inputs are rounded: to 8 bits, or to 16."""
    network = random_network((40, 96, 96, 33))
    network = replace(network, weights=tuple(to_bfloat16(weight) for weight in network.weights))
    x = inputs(network, 60)
    expected = network.evaluate(x.astype(np.float64))
    rough, fine = (
        np.abs(bfloat16(network, products).evaluate(x) - expected).mean()
        for products in ("bfloat16", "bfloat16x2")
    )
    assert fine < 2e-5 < 1e-3 < rough


def test_products_that_do_not_exist_or_that_the_processor_lacks_are_refused(monkeypatch):
    network = random_network((3, 4))
    with pytest.raises(UserError, match=r"no products of type 'int4'.*float32, bfloat16"):
        Evaluator(network, products="int4")
    monkeypatch.setattr(lanes, "MULTIPLIES_PAIRS", False)
    with pytest.raises(UserError, match=r"does not multiply bfloat16 numbers.*float32"):
        Evaluator(network, products="bfloat16")
    Evaluator(network, products="bfloat16", compiled=False)


def test_processors_without_wide_vectors_or_half_floats_give_the_same(tmp_path):
    """As numba compiles for any processor of this kind: it may use neither instruction."""
    script = """
import numpy as np, sys
sys.path.insert(0, sys.argv[1])
import test_lmm_kernels as t
from lmm import lanes
from lmm.evaluator import Evaluator
assert lanes.TALL == 2 and not lanes._CONVERTS_HALVES, lanes.features()
network = t.random_network((20, 40, 33)).as_type("float16")
tiny = network.weights[0].copy()
tiny[0, 0], tiny[1, 0], tiny[2, 0] = 6e-8, -1e-6, 0  # the least half floats are spaced otherwise
network = t.replace(network, weights=(tiny, *network.weights[1:]))
for count in (1, 40):
    x = t.inputs(network, count)
    np.testing.assert_allclose(Evaluator(network).evaluate(x), network.evaluate(x), atol=2e-5)
try:
    Evaluator(network, products="bfloat16")
except t.UserError as error:
    assert "does not multiply bfloat16" in str(error)
    assert not t.tiles.permitted()
    print("same")
"""
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        pytest.skip("half floats are converted by every processor of this kind")
    environment = os.environ | {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run(
        [sys.executable, "-c", script, str(Path(__file__).parent)],
        env=environment, cwd=Path(__file__).parents[1], capture_output=True, text=True,
    )  # fmt: skip
    assert ran.stdout.strip() == "same", ran.stderr


def test_poses_of_vectors_equal_their_twins():
    rng = np.random.default_rng(3)
    layout, count = Layout(9, 3), 200
    vectors = rng.normal(size=(count, layout.size)).astype(np.float32)
    # Rotations about any axis by any angle, as two columns that are neither of length 1 nor at right angles.
    turns = quat.normalize(rng.normal(size=(count, 8, 4)))
    turns[:20], turns[20:40, :, 0] = [0, 1, 0, 0], 1e-4
    turns[40], turns[41] = [0, 0, 1, 0], [0, 0, 0, 1]
    xy = quat.to_matrix(quat.normalize(turns))[..., :2] + 0.1 * rng.normal(size=(count, 8, 3, 2))
    vectors[:, layout.slices["rotations"]] = xy.reshape(count, -1)
    expected, feet = layout.unpack(vectors, 30.0)
    for module in (kernels, kernels_numpy):
        poses, contacts = Poses.empty(count, 9), np.full((count, 3), 9, np.uint8)
        poses.positions[:, 0, 1] = 5  # what was there before does not stay
        module.unpack(vectors, 30.0, *poses.arrays().values(), contacts)
        np.testing.assert_array_equal(contacts, feet)
        for name, array in poses.arrays().items():
            if name == "rotations":
                angles = quat.angle_between(array.astype(float), expected.rotations.astype(float))
                assert angles.max() < 2e-3 and np.median(angles) < 1e-3
                np.testing.assert_allclose(np.linalg.norm(array, axis=-1), 1, atol=1e-5)
            else:
                np.testing.assert_allclose(array, expected.arrays()[name], atol=1e-6, err_msg=name)


def test_columns_without_direction_are_no_rotation_and_no_numbers_stay_none():
    """Nothing, one column alone, two along each other; NaN in either column."""
    layout, one = Layout(7, 2), [0, 1, 0]
    vectors = np.zeros((1, layout.size), np.float32)
    pairs = np.float32(
        [[[0, 0, 0]] * 2, [one, [0, 0, 0]], [[0, 0, 0], one], [one, one], [one] * 2, [one] * 2]
    )
    pairs[4, 0, 1] = pairs[5, 1, 2] = np.nan
    vectors[:, layout.slices["rotations"]] = pairs.transpose(0, 2, 1).reshape(1, -1)
    for module in (kernels, kernels_numpy):
        poses, contacts = Poses.empty(1, 7), np.zeros((1, 2), np.uint8)
        module.unpack(vectors, 60.0, *poses.arrays().values(), contacts)
        np.testing.assert_allclose(poses.rotations[0, :5], [[1, 0, 0, 0]] * 5, atol=1e-6)
        assert np.isnan(poses.rotations[0, 5:]).any(axis=-1).all()


def test_rows_of_frames_are_their_features_and_latents():
    rng = np.random.default_rng(0)
    features, latents = rng.normal(size=(9, 4)).astype(np.float32), rng.normal(size=(9, 3)).astype(np.float16)
    frames, found = np.array([3, 0, 8, 3], np.int32), np.zeros((2, 4, 7), np.float32)
    kernels.rows_of(frames, features, latents.view(np.uint16), found[0])
    kernels_numpy.rows_of(frames, features, latents.view(np.uint16), found[1])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0][2], [*features[8], *latents[8]])


def test_how_far_apart_rows_are():
    a, b = np.float32([[1, 2], [0, 0], [np.nan, 1]]), np.float32([[1, 0], [3, 4], [0, 0]])
    for module in (kernels, kernels_numpy):
        out = np.zeros(3)
        module.root_mean_square(a, b, np.array([1.0, 0.5]), out)
        np.testing.assert_allclose(out, [np.sqrt(0.5), np.sqrt((9 + 4) / 2), np.nan])


def test_frames_near_a_state_go_on_with_it():
    last, tags = np.array([2, 2, 2, 4, 4], np.int32), np.array([1, 2, 4, 8, 16], np.uint32)
    for module in (kernels, kernels_numpy):
        near, borne = np.array([0, -1, 2, 3], np.int32), np.full(4, 7, np.uint32)
        module.follow(near, last, tags, borne)
        assert near.tolist() == [1, -1, 2, 4] and borne.tolist() == [2, 7, 4, 16]
        module.follow(near, last, None, borne)
        assert near.tolist() == [2, -1, 2, 4] and borne.tolist() == [2, 7, 4, 16]


def test_a_state_advances_by_a_frame():
    rng = np.random.default_rng(0)
    values, rates = rng.normal(size=(2, 5, 7)).astype(np.float32)
    fast, twin = values.copy(), values.copy()
    kernels.advance(fast, rates, 60.0)
    kernels_numpy.advance(twin, rates, 60.0)
    np.testing.assert_allclose(fast, twin, atol=1e-6)
    np.testing.assert_allclose(fast, values + rates / 60, atol=1e-6)
