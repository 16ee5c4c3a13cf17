"""Phase-functioned networks at run time: without torch, one row or many, each with its own phase."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import tiles
from ..evaluator import Products
from ..locomotion.evaluator import MixedEvaluator
from . import kernels, kernels_numpy
from .network import PhaseNetwork
from .spline import SETS, USED, Mode, check_mode, sets


class PhaseEvaluator(MixedEvaluator):
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
        self.mode, used = mode, USED[mode]
        super().__init__(
            network,
            [sets(weight, mode) for weight in network.weights],
            [sets(bias, mode) for bias in network.biases],
            used=used,
            weight_bytes=network.weight_bytes(mode),
            products=products,
            count=count,
            compiled=compiled,
        )
        twin: Any = kernels if compiled else kernels_numpy
        self._evaluate: Any = twin.evaluate
        if products == "bfloat16":
            self._evaluate = partial(twin.evaluate_pairs, compiled and tiles.permitted())
        self._ends = np.zeros(SETS[mode], np.int64)
        # First sets, shares, order of the rows.
        self._rows = np.zeros(count, np.int64), np.zeros((count, used), np.float32), np.zeros(count, np.int64)

    def evaluate(self, x: NDArray[np.float32], phases: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I] at phases [N], radians; valid until the next call."""
        count, room = len(x), len(self._y)
        if x.shape != (count, self.inputs) or phases.shape != (count,) or count > room:
            what = f"inputs {x.shape} at phases {phases.shape}"
            raise ValueError(f"{what}, expected up to {room} of {self.inputs} numbers and a phase each")
        packed, y = self.packed, self._y[:count]
        first, shares, order = self._rows
        self._evaluate(
            x, phases, self._sets, self._used, packed.layers, packed.weights, packed.numbers,
            first[:count], shares[:count], order[:count], self._ends, *self._scratch, y,
        )  # fmt: skip
        return y
