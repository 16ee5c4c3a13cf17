"""The networks in torch, and how they become what is stored and run."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.network import Activation, Network

from .randomness import seeded

CHUNK = 8192  # inputs at a time where there are many


class Perceptron(nn.Module):
    """Linear layers with an activation between, on normalised inputs and to outputs that are scaled back.

    The twin of `lmm.network.Network`. Normalisation is set by `normalise` before training begins.
    """

    input_mean: Tensor
    input_std: Tensor
    output_mean: Tensor
    output_std: Tensor

    def __init__(self, sizes: Sequence[int], activation: Activation, *, seed: int, name: str) -> None:
        super().__init__()
        self.activation = activation
        with seeded(seed, name):
            layers = [nn.Linear(i, o) for i, o in pairwise(sizes)]
        self.layers = nn.ModuleList(layers)
        for end, size in (("input", sizes[0]), ("output", sizes[-1])):
            self.register_buffer(f"{end}_mean", torch.zeros(size))
            self.register_buffer(f"{end}_std", torch.ones(size))

    def normalise(self, **statistics: NDArray[np.float32]) -> None:
        """Set input_mean, input_std, output_mean, output_std; an input that never varies is only shifted."""
        for name, values in statistics.items():
            values = np.where(values > 0, values, 1) if name == "input_std" else values
            getattr(self, name).copy_(torch.from_numpy(np.ascontiguousarray(values, np.float32)))

    def inner(self, x: Tensor) -> Tensor:
        """Outputs as they are before they are scaled back."""
        x = (x - self.input_mean) / self.input_std
        for i, layer in enumerate(self.layers):
            if i:
                x = torch.relu(x) if self.activation == "relu" else nn.functional.elu(x)
            x = layer(x)
        return x

    def forward(self, x: Tensor) -> Tensor:
        return self.inner(x) * self.output_std + self.output_mean

    def evaluate(self, x: NDArray[np.float32], chunk: int = CHUNK) -> NDArray[np.float32]:
        """Outputs of many inputs [N, ..], in pieces, as precise as when they run."""
        device = self.input_mean.device
        with torch.no_grad(), precision("highest"):
            found = [self(torch.from_numpy(x[i : i + chunk]).to(device)) for i in range(0, len(x), chunk)]
        return torch.cat(found).cpu().numpy()

    def network(self) -> Network:
        """As it is stored and run."""
        arrays = {name: _array(tensor) for name, tensor in self.named_buffers()}
        layers: list[Any] = list(self.layers)
        return Network(
            **arrays,
            weights=tuple(_array(layer.weight.T) for layer in layers),
            scales=(None,) * len(layers),
            biases=tuple(_array(layer.bias) for layer in layers),
            activation=self.activation,
        )


@contextlib.contextmanager
def precision(name: str) -> Iterator[None]:
    """Torch's precision of float32 products, put back after."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision(name)
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), np.float32)
