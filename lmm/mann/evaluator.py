"""Mode-adaptive networks at run time: without torch, one row or many, each with its own gate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion.plain import plain

from ..evaluator import Products
from ..locomotion.evaluator import MixedEvaluator
from . import kernels, kernels_numpy
from .network import MannNetwork


class MannEvaluator(MixedEvaluator):
    """A mode-adaptive network for batches of up to a number of rows; nothing is allocated in a call.

    Parameters
    ----------
    network : what to evaluate, its weights as they are stored.
    products : of float32 numbers, or of bfloat16 ones, which a processor without them makes a UserError.
        bfloat16 weights are the experts', rounded, whatever the network stores; the gate stays float32.
    count : rows that there is room for.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """

    def __init__(
        self,
        network: MannNetwork,
        *,
        products: Products = "float32",
        count: int = 1,
        compiled: bool = True,
    ) -> None:
        self.variant = str(network.experts)
        super().__init__(
            network,
            network.weights,
            network.biases,
            used=network.experts,
            weight_bytes=network.weight_bytes,
            products=products,
            count=count,
            compiled=compiled,
        )
        self._gate = (kernels if compiled else kernels_numpy).gate
        layers = zip(network.gate_weights, network.gate_biases, strict=True)
        parts = [plain(np.array(part)) for layer in layers for part in layer]
        between = (np.zeros(width, np.float32) for width in network.gate_sizes[1:-1])
        self._of_gate: tuple[NDArray, ...] = (plain(np.array(network.gate_columns)), *parts, *between)

    def evaluate(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I]; valid until the next call."""
        self._check(x)
        self._gate(x, self.packed.numbers, *self._of_gate, self._shares[: len(x)])
        self._ends[:] = len(x)  # all rows begin with the first expert
        return self._mix(x)

    @property
    def shares(self) -> NDArray[np.float32]:
        """What each expert counted in the last call [room, K], valid until the next."""
        return self._shares

    def memory(self) -> dict[str, int]:
        """Bytes: of the experts, what pads them, the normalisation, the gate."""
        return super().memory() | {"gate": sum(array.nbytes for array in self._of_gate)}
