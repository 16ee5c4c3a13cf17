"""Networks whose weights are mixed of weight sets, in torch, and how they become what is stored and run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.mann.network import GATE_LAYERS, MannNetwork
from lmm.network import NORMALISATION
from lmm.pfnn.network import PhaseNetwork
from lmm.pfnn.spline import CONTROLS, coefficients

from .networks import CHUNK, precision
from .randomness import seeded


class MixedLayers(nn.Module):
    """Layers whose weights are mixed of sets.

    A layer is linear in its weights: sum over k of c_k (x W_k + b_k) for shares c of a sample. So a batch
    costs the product of [c_0 x, .., c_K x] with the sets one below the other, K plain layers, and no weights
    are mixed a sample. Normalisation is set by `normalise`.
    """

    input_mean: Tensor
    input_std: Tensor
    output_mean: Tensor
    output_std: Tensor

    def __init__(self, sizes: Sequence[int], *, sets: int, seed: int, name: str) -> None:
        super().__init__()
        with seeded(seed, name):
            layers = [_layer(rows, columns, sets) for rows, columns in pairwise(sizes)]
        self.weights, self.biases = (nn.ParameterList(parts) for parts in zip(*layers, strict=True))
        for end, size in (("input", sizes[0]), ("output", sizes[-1])):
            self.register_buffer(f"{end}_mean", torch.zeros(size))
            self.register_buffer(f"{end}_std", torch.ones(size))

    def normalise(self, **statistics: NDArray[np.float32]) -> None:
        """Set input_mean, input_std, output_mean, output_std (see `lmm.locomotion.statistics`)."""
        for name, values in statistics.items():
            getattr(self, name).copy_(torch.from_numpy(np.ascontiguousarray(values, np.float32)))

    def mixed(self, x: Tensor, shares: Tensor, keep: float, draw: torch.Generator | None) -> Tensor:
        """Normalised outputs [N, O] of normalised inputs [N, I], of which each set counts a share [N, K].

        Of every layer's inputs the share keep is left, by the numbers of draw.
        """
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = _dropped(nn.functional.elu(x) if i else x, keep, draw)
            spread = (shares[:, :, None] * x[:, None]).flatten(1)
            x = torch.addmm(shares @ bias, spread, weight.flatten(0, 1))
        return x

    def inner(
        self, x: Tensor, *more: Tensor, keep: float = 1.0, draw: torch.Generator | None = None
    ) -> Tensor:
        """Normalised outputs [N, O] of normalised inputs [N, I], and what else there is of each sample."""
        raise NotImplementedError

    def forward(self, x: Tensor, *more: Tensor) -> Tensor:
        """Outputs [N, O] of inputs [N, I], in their units."""
        return self.inner((x - self.input_mean) / self.input_std, *more) * self.output_std + self.output_mean

    def _evaluate(self, *inputs: NDArray[np.float32], chunk: int) -> NDArray[np.float32]:
        """Outputs of many inputs, in pieces, as precise as when they run."""
        device = self.input_mean.device
        with torch.no_grad(), precision("highest"):
            found = [
                self(*(torch.from_numpy(part[i : i + chunk]).to(device) for part in inputs))
                for i in range(0, len(inputs[0]), chunk)
            ]
        return torch.cat(found).cpu().numpy()

    def _stored(self) -> dict[str, Any]:
        """What every network of mixed weights is made of."""
        return {
            **{name: _array(getattr(self, name)) for name in NORMALISATION},
            "weights": tuple(map(_array, self.weights)),
            "biases": tuple(map(_array, self.biases)),
        }


class PhaseLayers(MixedLayers):
    """Layers of four control points, mixed by the phase; the twin of `lmm.pfnn.network.PhaseNetwork`."""

    def __init__(self, sizes: Sequence[int], *, seed: int, name: str) -> None:
        super().__init__(sizes, sets=CONTROLS, seed=seed, name=name)

    def inner(
        self, x: Tensor, *more: Tensor, keep: float = 1.0, draw: torch.Generator | None = None
    ) -> Tensor:
        """Of inputs [N, I] and shares [N, 4], the phases' `lmm.pfnn.spline.coefficients`."""
        (shares,) = more
        return self.mixed(x, shares, keep, draw)

    def evaluate(
        self, x: NDArray[np.float32], phases: NDArray[np.floating], chunk: int = CHUNK
    ) -> NDArray[np.float32]:
        """Outputs of many inputs [N, I] at phases [N], in pieces, as precise as when they run."""
        return self._evaluate(x, coefficients(phases).astype(np.float32), chunk=chunk)

    def network(self) -> PhaseNetwork:
        """As it is stored and run."""
        return PhaseNetwork(**self._stored())


class ExpertLayers(MixedLayers):
    """Layers of experts, mixed by a gate; the twin of `lmm.mann.network.MannNetwork`.

    columns [G] are the inputs that the gate sees, hidden the width of its two hidden layers.
    """

    gate_columns: Tensor

    def __init__(
        self,
        sizes: Sequence[int],
        columns: NDArray[np.int64],
        *,
        experts: int,
        hidden: int,
        seed: int,
        name: str,
    ) -> None:
        super().__init__(sizes, sets=experts, seed=seed, name=name)
        widths = (len(columns), *(hidden,) * (GATE_LAYERS - 1), experts)
        with seeded(seed, f"{name}'s gate"):
            layers = [_layer(rows, columns) for rows, columns in pairwise(widths)]
        self.gate_weights, self.gate_biases = (nn.ParameterList(p) for p in zip(*layers, strict=True))
        self.register_buffer("gate_columns", torch.from_numpy(columns), persistent=False)

    def heed(self, scale: NDArray[np.float32]) -> None:
        """Multiply the first weights of the gate's inputs by scale [G]: those that count little elsewhere."""
        with torch.no_grad():
            self.gate_weights[0].mul_(torch.from_numpy(scale)[:, None])

    def gate(self, x: Tensor, keep: float = 1.0, draw: torch.Generator | None = None) -> Tensor:
        """What each expert counts [N, K] for normalised inputs [N, I]."""
        h = x[:, self.gate_columns]
        for i, (weight, bias) in enumerate(zip(self.gate_weights, self.gate_biases, strict=True)):
            h = torch.addmm(bias, _dropped(nn.functional.elu(h) if i else h, keep, draw), weight)
        return torch.softmax(h, dim=1)

    def inner(
        self, x: Tensor, *more: Tensor, keep: float = 1.0, draw: torch.Generator | None = None
    ) -> Tensor:
        """Of inputs [N, I] alone."""
        return self.mixed(x, self.gate(x, keep, draw), keep, draw)

    def evaluate(self, x: NDArray[np.float32], chunk: int = CHUNK) -> NDArray[np.float32]:
        """Outputs of many inputs [N, I], in pieces, as precise as when they run."""
        return self._evaluate(x, chunk=chunk)

    def network(self) -> MannNetwork:
        """As it is stored and run."""
        return MannNetwork(
            **self._stored(),
            gate_columns=self.gate_columns.cpu().numpy(),
            gate_weights=tuple(map(_array, self.gate_weights)),
            gate_biases=tuple(map(_array, self.gate_biases)),
        )


def _layer(rows: int, columns: int, *sets: int) -> tuple[nn.Parameter, nn.Parameter]:
    """First weights and biases of a layer, of one set or several."""
    most = math.sqrt(6 / (rows + columns))
    weights = torch.empty(*sets, rows, columns).uniform_(-most, most)
    return nn.Parameter(weights), nn.Parameter(torch.zeros(*sets, columns))


def _dropped(x: Tensor, keep: float, draw: torch.Generator | None) -> Tensor:
    """Dropout that leaves the share keep, by the numbers of draw."""
    if keep == 1:
        return x
    return x * ((torch.rand(x.shape, generator=draw, device=x.device) < keep) / keep)


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy().astype(np.float32, order="C", copy=True)
