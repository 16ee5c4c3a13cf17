"""Networks at run time: without torch, straight from float32, float16 or int8 weights, one row or many.

Products are of float32 numbers, or of bfloat16 ones where the processor has instructions for them: inputs of
every layer and weights are then rounded to 8 significant bits; sums, scales, biases and outputs stay float32.
What is rounded of inputs changes with them from frame to frame. bfloat16x2 takes inputs as sums of two such
numbers, 16 bits, for twice the products: only weights, whose error does not change, are rounded noticeably.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from motion.errors import UserError

from . import kernels, kernels_numpy, lanes, tiles
from .lanes import GROUP, LANES, PANEL, TALL
from .network import Network, to_bfloat16

Products = Literal["float32", "bfloat16", "bfloat16x2"]
LINE = 64  # bytes of a cache line
CONSTANT = 1e-7  # a column that varies by less than this part of the most varying one is left at its mean


@dataclass(frozen=True, eq=False)
class Packed:
    """A network as the kernels read it: groups of 256 outputs, without the outputs that never change.

    The last layer's scales and biases give outputs in their own units: scale * output_std and
    bias * output_std + output_mean, computed in float64.

    Attributes
    ----------
    weights : float32, uint16 (half floats) or int8, flat: of each layer its groups [inputs, 256], the last
        one narrower: outputs are padded by 0 to a multiple of 32. For bfloat16 products uint32, pairs of
        two inputs' weights (`lmm.lanes`): inputs are padded to a multiple of 32, too. For bfloat16x2 each 16
        pairs of an output stand there twice.
    numbers : float32, flat: input_mean [I], input_std [I], then of each layer scales and biases, padded.
    layers : int64 [layers, 4]: inputs (or pairs), panels, where its weights begin, where its scales begin.
    columns : int64 [V], the outputs that vary.
    constants : float32 [O], the others' values.
    elu : whether the activation is elu, not relu.
    products : which these are for.
    """

    weights: NDArray
    numbers: NDArray[np.float32]
    layers: NDArray[np.int64]
    columns: NDArray[np.int64]
    constants: NDArray[np.float32]
    elu: bool
    products: Products = "float32"

    @property
    def paired(self) -> bool:
        """Whether products are of bfloat16 pairs."""
        return self.products != "float32"

    @property
    def split(self) -> bool:
        """Whether inputs are sums of two bfloat16 numbers."""
        return self.products == "bfloat16x2"

    @property
    def nbytes(self) -> int:
        arrays = self.weights, self.numbers, self.layers, self.columns, self.constants
        return sum(array.nbytes for array in arrays)

    def scratch(self, count: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
        """What `kernels.evaluate` works in for count rows: two blocks of rows, a panel, indices of inputs."""
        deepest = int(self.layers[:, 0].max()) * (2 if self.products == "bfloat16" else 1)
        width = max(deepest, int(self.layers[:, 1].max()) * PANEL)
        # Rows that begin a cache line further than a power of two, lest they fall into the same few sets.
        width = -(-width // PANEL) * PANEL + LANES
        group = tiles.TALL_TILES if self.paired else TALL
        block = min(kernels.BLOCK, -(-count // group) * group)
        between = cache_aligned(np.zeros((2, block, width), np.float32))
        return between, np.zeros(deepest * PANEL, np.float32), np.zeros(deepest + 1, np.int32)


def cache_aligned(array: NDArray) -> NDArray:
    """A copy that begins with a cache line: tiles of it are read twice as fast."""
    room = np.empty(array.nbytes + LINE, np.uint8)
    start = -room.ctypes.data % LINE
    copy = room[start : start + array.nbytes].view(array.dtype).reshape(array.shape)
    copy[...] = array
    return copy


def varying(network: Network) -> NDArray[np.int64]:
    """Outputs [V] that depend on the input: not those of a standard deviation, or weights, of nothing."""
    spread = network.output_std * np.abs(network.weight(-1)).max(axis=0, initial=0)
    return np.flatnonzero(spread > CONSTANT * spread.max(initial=0))


def pack(network: Network, products: Products = "float32") -> Packed:
    """Lay a network out for the kernels of these products."""
    columns = varying(network)
    std, mean = network.output_std.astype(np.float64), network.output_mean.astype(np.float64)
    paired = products != "float32"
    weights, layers, at = [np.zeros(0, np.uint32 if paired else network.weights[0].dtype)], [], 0
    numbers = [network.input_mean, network.input_std]
    last = len(network.weights) - 1
    for layer, weight in enumerate(network.weights):
        bias = network.biases[layer].astype(np.float64)
        given = network.scales[layer]
        scale = np.ones(len(bias)) if given is None else given.astype(np.float64)
        if layer == last:
            weight, scale, bias = weight[:, columns], (scale * std)[columns], (bias * std + mean)[columns]
        inputs, outputs = weight.shape
        panels = -(-outputs // PANEL)
        depth = -(-inputs // PANEL) * PANEL if paired else inputs
        padded = np.zeros((depth, panels * PANEL), np.float32 if paired else weight.dtype)
        padded[:inputs, :outputs] = weight
        if paired:
            padded = bfloat16_pairs(padded)
        if products == "bfloat16x2":
            padded = np.repeat(padded.reshape(-1, LANES, panels * PANEL), 2, axis=0)
            padded = padded.reshape(-1, panels * PANEL)
        weights += [padded[:, p : p + GROUP * PANEL].ravel() for p in range(0, panels * PANEL, GROUP * PANEL)]
        layers.append((len(padded), panels, at, sum(map(len, numbers))))
        at += padded.size
        numbers += [np.pad(row, (0, panels * PANEL - outputs)) for row in (scale, bias)]
    stored = cache_aligned(np.concatenate(weights))
    return Packed(
        stored.view(np.uint16) if stored.dtype == np.float16 else stored,
        np.concatenate(numbers).astype(np.float32),
        np.array(layers, np.int64),
        columns.astype(np.int64),
        (network.biases[-1] * std + mean).astype(np.float32),
        network.activation == "elu",
        products,
    )


def bfloat16_pairs(weights: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Weights [2 I, O] as bfloat16 pairs [I, O]."""
    bits = to_bfloat16(weights).view(np.uint32)
    return bits[0::2] >> np.uint32(16) | bits[1::2]


def products_here() -> tuple[str, ...]:
    """Types of numbers that this processor multiplies."""
    return get_args(Products) if lanes.MULTIPLIES_PAIRS else ("float32",)


def check_products(products: str, *, compiled: bool = True) -> None:
    """A UserError unless numbers of this type can be multiplied here."""
    if products not in get_args(Products):
        remedy = f"choose from {', '.join(get_args(Products))}"
        raise UserError(f"no products of type {products!r}", remedy=remedy)
    if compiled and products not in products_here():
        raise UserError("this processor does not multiply bfloat16 numbers", remedy="take float32 products")


class Evaluator:
    """A network for batches of up to any number of rows; nothing is allocated while batches do not grow.

    Parameters
    ----------
    network : what to evaluate, its weights as they are stored.
    products : float32, or bfloat16 or bfloat16x2, which a processor without them makes a UserError.
    count : rows to make room for; more are made room for when they come.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """

    def __init__(
        self, network: Network, *, products: Products = "float32", count: int = 1, compiled: bool = True
    ) -> None:
        check_products(products, compiled=compiled)
        self.packed = pack(network, products)
        self.inputs = network.sizes[0]
        twin: Any = kernels if compiled else kernels_numpy
        if self.packed.paired:
            self._evaluate = partial(twin.evaluate_pairs, compiled and tiles.permitted(), self.packed.split)
        else:
            self._evaluate = twin.evaluate
        self._grow(count)

    def _grow(self, count: int) -> None:
        self._scratch = self.packed.scratch(count)
        self._outputs = np.tile(self.packed.constants, (count, 1))

    def evaluate(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I]; valid until the next call."""
        x = np.ascontiguousarray(x, np.float32)
        count, packed = len(x), self.packed
        if x.shape != (count, self.inputs):
            raise ValueError(f"a batch of shape {x.shape} for a network of {self.inputs} inputs")
        if count > len(self._outputs):
            self._grow(count)
        y = self._outputs[:count]
        self._evaluate(
            x, packed.layers, packed.weights, packed.numbers, packed.columns, packed.elu, *self._scratch, y
        )
        return y

    @property
    def nbytes(self) -> int:
        """Bytes of weights, scales, biases and normalisation, as they stand in memory."""
        return self.packed.nbytes

    @property
    def workspace(self) -> int:
        """Bytes of what it works in, for as many rows as there is room for."""
        return sum(array.nbytes for array in (*self._scratch, self._outputs))
