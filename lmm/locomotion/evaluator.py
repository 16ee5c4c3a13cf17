"""Networks whose weights are mixed of weight sets, at run time: without torch, one row or many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion.errors import UserError

from .. import tiles
from ..evaluator import Products, bfloat16_pairs, cache_aligned, check_products
from ..lanes import GROUP, LANES, PANEL, TALL
from ..network import NORMALISATION
from . import layers, layers_numpy
from .network import UNSEEN


@dataclass(frozen=True, eq=False)
class Packed:
    """Weight sets as the kernels read them.

    Attributes
    ----------
    weights : float32 or uint16 (half floats), flat: of each layer its groups of up to 256 outputs, each
        [sets, depth, outputs], depth being the inputs and one more, the biases; outputs are padded by 0 to a
        multiple of 32. For bfloat16 products uint32, pairs of two inputs' weights (`lmm.lanes`): inputs are
        padded to a multiple of 32, too, and depth counts pairs.
    numbers : float32, flat: input_mean [I], input_std [I], then what each layer's outputs are multiplied by
        and what is added: 1 and 0, of the last one output_std and output_mean.
    layers : int64 [layers, 5]: inputs, panels of 32 outputs, where weights and where numbers begin, depth.
    """

    weights: NDArray
    numbers: NDArray[np.float32]
    layers: NDArray[np.int64]


def pack(
    weights: Sequence[NDArray], biases: Sequence[NDArray], ends: dict[str, NDArray], products: Products
) -> Packed:
    """Lay sets out for the kernels: of each layer weights [sets, inputs, outputs] and biases [sets, outputs].

    ends holds the normalisation, by `lmm.network.NORMALISATION`. Inputs that shall not be seen have an
    infinite deviation here, and are exactly 0 in units of it: a row that goes by itself passes over them.
    """
    deviations = np.where(ends["input_std"] > UNSEEN, np.inf, ends["input_std"])
    packed, numbers, layers, at = [], [ends["input_mean"], deviations], [], 0
    paired = products == "bfloat16"
    for layer, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        sets, inputs, outputs = weight.shape
        panels = -(-outputs // PANEL)
        depth = -(-(inputs + 1) // PANEL) * PANEL if paired else inputs + 1
        stacked = np.zeros((sets, depth, panels * PANEL), np.float32 if paired else weight.dtype)
        stacked[:, :inputs, :outputs], stacked[:, inputs, :outputs] = weight, bias
        if paired:
            stacked = np.stack([bfloat16_pairs(one) for one in stacked])
        step = GROUP * PANEL
        packed += [stacked[..., p : p + step].ravel() for p in range(0, panels * PANEL, step)]
        layers.append((inputs, panels, at, sum(map(len, numbers)), stacked.shape[1]))
        at += stacked.size
        last = layer == len(weights) - 1
        rows = (ends["output_std"], ends["output_mean"]) if last else np.array([[1], [0]]).repeat(outputs, 1)
        numbers += [np.pad(row, (0, panels * PANEL - outputs)) for row in rows]
    stored = cache_aligned(np.concatenate(packed))
    return Packed(
        stored.view(np.uint16) if stored.dtype == np.float16 else stored,
        np.concatenate(numbers).astype(np.float32),
        np.array(layers, np.int64),
    )


class MixedEvaluator:
    """What evaluators of mixed weights have in common: packed sets, and room for so many rows.

    A network's own is what sets count for each row: its `evaluate` writes that, and the order of the rows;
    and what tells it from others of its kind, `variant`.

    Parameters
    ----------
    network : what holds the normalisation.
    weights, biases : of each layer the sets, see `pack`.
    used : how many sets a row needs.
    weight_bytes : of the sets as they are stored, without padding, for float32 products.
    products, count, compiled : see the evaluators.
    """

    variant: str

    def __init__(
        self,
        network: Any,
        weights: Sequence[NDArray],
        biases: Sequence[NDArray],
        *,
        used: int,
        weight_bytes: int,
        products: Products,
        count: int,
        compiled: bool,
    ) -> None:
        check_products(products, compiled=compiled)
        if products == "bfloat16x2":
            raise UserError("products of type bfloat16x2 are not for mixed weights", remedy="take bfloat16")
        paired = products == "bfloat16"
        twin = layers if compiled else layers_numpy
        self._mixed: Any = twin.evaluate
        if paired:
            self._mixed = partial(twin.evaluate_pairs, compiled and tiles.permitted())
        self.inputs, self.outputs = weights[0].shape[1], weights[-1].shape[2]
        self.packed = packed = pack(
            weights, biases, {name: getattr(network, name) for name in NORMALISATION}, products
        )
        self.weight_bytes = weight_bytes
        if paired:
            self.weight_bytes = 2 * sum(array.size for array in (*weights, *biases))
        self._sets, self._used = len(weights[0]), used
        # What the sets that it needs count for a row; rows by their first set, and where each set's rows end.
        self._shares = np.zeros((count, used), np.float32)
        self._order, self._ends = np.arange(count), np.zeros(self._sets, np.int64)
        depth, panels = int(packed.layers[:, 4].max()) * (1 + paired), int(packed.layers[:, 1].max())
        group = tiles.TALL_TILES if paired else TALL
        block = min(layers.BLOCK, -(-count // group) * group)
        # Rows that begin a cache line further than a power of two, lest they fall into the same few sets.
        width, wide = (-(-n // PANEL) * PANEL + LANES for n in (max(depth, panels * PANEL), used * depth))
        self._scratch = (
            np.zeros((block, width), np.float32),
            cache_aligned(np.zeros((block, wide), np.float32)),
            np.zeros(used * depth * PANEL, np.float32),
            np.zeros(used * depth + 1, np.int32),
        )
        self._y = np.zeros((count, self.outputs), np.float32)

    def _check(self, x: NDArray[np.float32]) -> None:
        """A ValueError unless there is room for inputs."""
        if x.ndim != 2 or x.shape[1] != self.inputs or len(x) > len(self._y):
            raise ValueError(f"inputs {x.shape}, expected up to {len(self._y)} of {self.inputs} numbers")

    def _mix(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I], by the shares and the order; valid until the next call."""
        packed, y = self.packed, self._y[: len(x)]
        self._mixed(
            x, self._sets, self._used, packed.layers, packed.weights, packed.numbers, self._shares[: len(x)],
            self._order[: len(x)], self._ends, *self._scratch, y,
        )  # fmt: skip
        return y

    def memory(self) -> dict[str, int]:
        """Bytes: of the weight sets (REFERENCE 4.3), what pads them, the normalisation, what it works in."""
        padding = self.packed.weights.nbytes - self.weight_bytes
        return {
            "network": self.weight_bytes,
            "padding": padding,
            "statistics": self.packed.numbers.nbytes,
            "workspace": sum(array.nbytes for array in (self._shares, self._order, *self._scratch, self._y)),
        }
