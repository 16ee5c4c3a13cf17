"""Phase-functioned networks at run time: without torch, one row or many, each with its own phase."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import tiles
from ..evaluator import Products, _aligned, _pairs, check_products
from ..lanes import GROUP, LANES, PANEL, TALL
from . import kernels, kernels_numpy
from .network import PhaseNetwork
from .spline import SETS, USED, Mode, check_mode, sets


@dataclass(frozen=True, eq=False)
class Packed:
    """The weight sets of a mode as the kernels read them.

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


def pack(network: PhaseNetwork, mode: Mode, products: Products = "float32") -> Packed:
    """Lay the sets of a mode out for the kernels."""
    weights, numbers, layers, at = [], [network.input_mean, network.input_std], [], 0
    paired = products == "bfloat16"
    for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        inputs, outputs = weight.shape[1:]
        panels = -(-outputs // PANEL)
        depth = -(-(inputs + 1) // PANEL) * PANEL if paired else inputs + 1
        stacked = np.zeros((SETS[mode], depth, panels * PANEL), np.float32 if paired else weight.dtype)
        stacked[:, :inputs, :outputs] = sets(weight, mode)
        stacked[:, inputs, :outputs] = sets(bias, mode)
        if paired:
            stacked = np.stack([_pairs(one) for one in stacked])
        step = GROUP * PANEL
        weights += [stacked[..., p : p + step].ravel() for p in range(0, panels * PANEL, step)]
        layers.append((inputs, panels, at, sum(map(len, numbers)), stacked.shape[1]))
        at += stacked.size
        last = layer == len(network.weights) - 1
        ends = (network.output_std, network.output_mean) if last else np.array([[1], [0]]).repeat(outputs, 1)
        numbers += [np.pad(row, (0, panels * PANEL - outputs)) for row in ends]
    stored = _aligned(np.concatenate(weights))
    return Packed(
        stored.view(np.uint16) if stored.dtype == np.float16 else stored,
        np.concatenate(numbers).astype(np.float32),
        np.array(layers, np.int64),
    )


class PhaseEvaluator:
    """A phase-functioned network for batches of up to a number of rows; nothing is allocated in a call.

    Parameters
    ----------
    network : what to evaluate, its weights as they are stored.
    mode : how the spline is evaluated, see `lmm.pfnn.spline`: cubic is exact and smallest, constant the
        largest and fastest.
    products : of float32 numbers, or of bfloat16 ones, which a processor without them makes a UserError.
        bfloat16 weights are the network's, rounded, whatever it stores.
    count : rows that there is room for.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """

    def __init__(
        self,
        network: PhaseNetwork,
        *,
        mode: Mode = "cubic",
        products: Products = "float32",
        count: int = 1,
        compiled: bool = True,
    ) -> None:
        check_mode(mode)
        check_products(products, compiled=compiled)
        self.mode, paired = mode, products == "bfloat16"
        self.weight_bytes = network.weight_bytes(mode)
        if paired:
            self.weight_bytes = SETS[mode] * network.parameters * 2
        self.packed = packed = pack(network, mode, products)
        self.inputs, self.outputs = network.sizes[0], network.sizes[-1]
        twin: Any = kernels if compiled else kernels_numpy
        self._evaluate: Any = twin.evaluate
        if paired:
            self._evaluate = partial(twin.evaluate_pairs, compiled and tiles.permitted())
        self._sets, self._used = SETS[mode], USED[mode]
        depth, panels = int(packed.layers[:, 4].max()) * (1 + paired), int(packed.layers[:, 1].max())
        group = tiles.TALL_TILES if paired else TALL
        block = min(kernels.BLOCK, -(-count // group) * group)
        # Rows that begin a cache line further than a power of two, lest they fall into the same few sets.
        width, wide = (
            -(-n // PANEL) * PANEL + LANES for n in (max(depth, panels * PANEL), self._used * depth)
        )
        self._scratch = (
            np.zeros(count, np.int64),
            np.zeros((count, self._used), np.float32),
            np.zeros(count, np.int64),
            np.zeros(self._sets, np.int64),
            np.zeros((block, width), np.float32),
            _aligned(np.zeros((block, wide), np.float32)),
            np.zeros(self._used * depth * PANEL, np.float32),
            np.zeros(self._used * depth + 1, np.int32),
        )
        self._y = np.zeros((count, self.outputs), np.float32)

    def evaluate(self, x: NDArray[np.float32], phases: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I] at phases [N], radians; valid until the next call."""
        count, room = len(x), len(self._y)
        if x.shape != (count, self.inputs) or phases.shape != (count,) or count > room:
            what = f"inputs {x.shape} at phases {phases.shape}"
            raise ValueError(f"{what}, expected up to {room} of {self.inputs} numbers and a phase each")
        packed, y = self.packed, self._y[:count]
        first, shares, order, *rest = self._scratch
        self._evaluate(
            x, phases, self._sets, self._used, packed.layers, packed.weights, packed.numbers,
            first[:count], shares[:count], order[:count], *rest, y,
        )  # fmt: skip
        return y

    def memory(self) -> dict[str, int]:
        """Bytes: of the weight sets (REFERENCE 4.3), what pads them, the normalisation."""
        padding = self.packed.weights.nbytes - self.weight_bytes
        return {
            "network": self.weight_bytes,
            "padding": padding,
            "statistics": self.packed.numbers.nbytes,
        }

    @property
    def scratch_nbytes(self) -> int:
        """Bytes that evaluation works in, outputs included."""
        return sum(array.nbytes for array in (*self._scratch, self._y))
