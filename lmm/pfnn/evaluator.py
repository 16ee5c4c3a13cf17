"""Phase-functioned networks at run time: without torch, one row or many, each with its own phase."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..evaluator import Products
from ..locomotion.evaluator import MixedEvaluator
from . import kernels, kernels_numpy
from .network import PhaseNetwork
from .spline import USED, Mode, check_mode, sets


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
        self.variant = mode
        super().__init__(
            network,
            [sets(weight, mode) for weight in network.weights],
            [sets(bias, mode) for bias in network.biases],
            used=USED[mode],
            weight_bytes=network.weight_bytes(mode),
            products=products,
            count=count,
            compiled=compiled,
        )
        self._share = (kernels if compiled else kernels_numpy).share
        self._first = np.zeros(count, np.int64)

    def evaluate(self, x: NDArray[np.float32], phases: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs [N, O] of inputs [N, I] at phases [N], radians; valid until the next call."""
        self._check(x)
        if phases.shape != x.shape[:1]:
            raise ValueError(f"phases {phases.shape}, expected one for each of {len(x)} inputs")
        self._share(phases, self._first, self._shares, self._order, self._ends)
        return self._mix(x)
