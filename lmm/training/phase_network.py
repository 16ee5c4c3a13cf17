"""The phase-functioned network in torch, and how it becomes what is stored and run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.pfnn.network import PhaseNetwork
from lmm.pfnn.spline import CONTROLS, coefficients

from .networks import CHUNK, precision
from .randomness import seeded

NORMALISATION = ("input_mean", "input_std", "output_mean", "output_std")


class PhaseLayers(nn.Module):
    """Layers whose weights are blended of four control points; the twin of `lmm.pfnn.network.PhaseNetwork`.

    A layer is linear in its weights: sum over k of c_k (x W_k + b_k) for coefficients c of the phase. So a
    batch costs the product of [c_0 x, .., c_3 x] with the control points one below the other, four plain
    layers, and no weights are blended a sample. Normalisation is set by `normalise`.
    """

    input_mean: Tensor
    input_std: Tensor
    output_mean: Tensor
    output_std: Tensor

    def __init__(self, sizes: Sequence[int], *, seed: int, name: str) -> None:
        super().__init__()
        weights, biases = [], []
        with seeded(seed, name):
            for rows, columns in pairwise(sizes):
                most = math.sqrt(6 / (rows + columns))
                weights.append(nn.Parameter(torch.empty(CONTROLS, rows, columns).uniform_(-most, most)))
                biases.append(nn.Parameter(torch.zeros(CONTROLS, columns)))
        self.weights, self.biases = nn.ParameterList(weights), nn.ParameterList(biases)
        for end, size in (("input", sizes[0]), ("output", sizes[-1])):
            self.register_buffer(f"{end}_mean", torch.zeros(size))
            self.register_buffer(f"{end}_std", torch.ones(size))

    def normalise(self, **statistics: NDArray[np.float32]) -> None:
        """Set input_mean, input_std, output_mean, output_std (see `lmm.pfnn.statistics`)."""
        for name, values in statistics.items():
            getattr(self, name).copy_(torch.from_numpy(np.ascontiguousarray(values, np.float32)))

    def inner(
        self, x: Tensor, shares: Tensor, *, keep: float = 1.0, draw: torch.Generator | None = None
    ) -> Tensor:
        """Normalised outputs [N, O] of normalised inputs [N, I].

        shares [N, 4] are the phases' `lmm.pfnn.spline.coefficients`. Of every layer's inputs the share keep
        is left, by the numbers of draw.
        """
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if i:
                x = nn.functional.elu(x)
            if keep < 1:
                x = x * ((torch.rand(x.shape, generator=draw, device=x.device) < keep) / keep)
            spread = (shares[:, :, None] * x[:, None]).flatten(1)
            x = torch.addmm(shares @ bias, spread, weight.flatten(0, 1))
        return x

    def forward(self, x: Tensor, shares: Tensor) -> Tensor:
        """Outputs [N, O] of inputs [N, I], in their units."""
        found = self.inner((x - self.input_mean) / self.input_std, shares)
        return found * self.output_std + self.output_mean

    def evaluate(
        self, x: NDArray[np.float32], phases: NDArray[np.floating], chunk: int = CHUNK
    ) -> NDArray[np.float32]:
        """Outputs of many inputs [N, I] at phases [N], in pieces, as precise as when they run."""
        device = self.input_mean.device
        shares = coefficients(phases).astype(np.float32)
        with torch.no_grad(), precision("highest"):
            found = [
                self(*(torch.from_numpy(part[i : i + chunk]).to(device) for part in (x, shares)))
                for i in range(0, len(x), chunk)
            ]
        return torch.cat(found).cpu().numpy()

    def network(self) -> PhaseNetwork:
        """As it is stored and run."""
        return PhaseNetwork(
            **{name: _array(getattr(self, name)) for name in NORMALISATION},
            weights=tuple(_array(weight) for weight in self.weights),
            biases=tuple(_array(bias) for bias in self.biases),
        )


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().astype(np.float32, order="C", copy=True)
