"""A mode-adaptive network: experts, and a gate that mixes their weights (REFERENCE 5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import files

from ..locomotion.network import MixedNetwork
from ..network import elu

Array = NDArray[np.float32]

GATE_LAYERS = 3  # two hidden ones


@dataclass(frozen=True, eq=False, repr=False)
class MannNetwork(MixedNetwork):
    """A network of layers x W + b, W and b the sums over K experts of gate x an expert's (`weights`' sets).

    The gate is a plain network with ELU between its layers and a softmax at its end, of some of the inputs,
    in units of their deviation. It is small, and always float32.

    Attributes
    ----------
    gate_columns : int64 [G], the inputs that the gate sees.
    gate_weights : three, float32 [G, H], [H, H'], [H', K].
    gate_biases : three, float32 [H], [H'], [K].
    """

    gate_columns: NDArray[np.int64]
    gate_weights: tuple[Array, ...]
    gate_biases: tuple[Array, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.gate_weights) == len(self.gate_biases) == GATE_LAYERS:
            raise ValueError(
                f"a gate of {len(self.gate_weights)} weights and {len(self.gate_biases)} biases, "
                f"expected {GATE_LAYERS}"
            )
        files.check_shapes(
            {"gate_columns": self.gate_columns},
            {"gate_columns": ("int64", (len(self.gate_columns),))},
        )
        columns = self.gate_columns
        if len(columns) == 0 or columns.min() < 0 or columns.max() >= self.sizes[0]:
            raise ValueError(f"a gate of inputs that are none of {self.sizes[0]}")
        sizes = (len(columns), *(len(bias) for bias in self.gate_biases[:-1]), self.experts)
        for layer, (rows, outputs) in enumerate(pairwise(sizes)):
            files.check_shapes(
                {
                    f"gate weights of layer {layer}": self.gate_weights[layer],
                    f"gate biases of layer {layer}": self.gate_biases[layer],
                },
                {
                    f"gate weights of layer {layer}": ("float32", (rows, outputs)),
                    f"gate biases of layer {layer}": ("float32", (outputs,)),
                },
            )

    @property
    def experts(self) -> int:
        """K."""
        return len(self.weights[0])

    @property
    def gate_sizes(self) -> tuple[int, ...]:
        """The gate's inputs, hidden widths, experts."""
        return (len(self.gate_columns), *(len(bias) for bias in self.gate_biases))

    @property
    def gate_parameters(self) -> int:
        """Numbers in the gate's weights and biases."""
        return sum(array.size for array in (*self.gate_weights, *self.gate_biases))

    @property
    def weight_bytes(self) -> int:
        """Bytes of the experts' weights and biases."""
        return self.experts * self.parameters * self.weights[0].itemsize

    def gate(self, x: ArrayLike) -> Array:
        """What each expert counts, [N, K] of sum 1, for inputs [N, I]."""
        h = ((np.asarray(x, np.float32) - self.input_mean) / self.input_std)[:, self.gate_columns]
        for layer, (weight, bias) in enumerate(zip(self.gate_weights, self.gate_biases, strict=True)):
            h = (elu(h) if layer else h) @ weight + bias
        share = np.exp(h - h.max(axis=1, keepdims=True))
        return share / share.sum(axis=1, keepdims=True)

    def evaluate(self, x: ArrayLike) -> Array:
        """Outputs [N, O] of inputs [N, I]: the obvious twin of `lmm.mann.evaluator`."""
        share = self.gate(x)
        h = (np.asarray(x, np.float32) - self.input_mean) / self.input_std
        for layer, parts in enumerate(zip(self.weights, self.biases, strict=True)):
            w, b = (np.einsum("nk,k...->n...", share, part.astype(np.float32)) for part in parts)
            h = np.einsum("ni,nio->no", elu(h) if layer else h, w) + b
        return h * self.output_std + self.output_mean

    def to_arrays(self, prefix: str) -> dict[str, NDArray]:
        """See `MixedNetwork.to_arrays`; the gate is stored, too."""
        arrays = super().to_arrays(prefix) | {f"{prefix}gate_columns": self.gate_columns}
        for layer in range(GATE_LAYERS):
            arrays[f"{prefix}gate_weight.{layer}"] = self.gate_weights[layer]
            arrays[f"{prefix}gate_bias.{layer}"] = self.gate_biases[layer]
        return arrays

    @classmethod
    def _parts(cls, prefix: str, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        return super()._parts(prefix, arrays) | {
            "gate_columns": arrays[f"{prefix}gate_columns"],
            "gate_weights": tuple(arrays[f"{prefix}gate_weight.{n}"] for n in range(GATE_LAYERS)),
            "gate_biases": tuple(arrays[f"{prefix}gate_bias.{n}"] for n in range(GATE_LAYERS)),
        }
