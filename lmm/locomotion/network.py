"""Networks whose weights are mixed of weight sets: what they have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from motion import files
from motion.errors import UserError

from ..network import NORMALISATION

Array = NDArray[np.float32]
UNSEEN = 1e6  # inputs of a larger deviation, whose units are metres and seconds, are not to be seen
WeightType = Literal["float32", "float16"]


@dataclass(frozen=True, eq=False, repr=False)
class MixedNetwork:
    """y = output_mean + output_std f((x - input_mean) / input_std), layers of x W + b of mixed W and b.

    ELU stands between layers. Inputs that a network shall not see have a very large standard deviation, above
    `UNSEEN`.

    Attributes
    ----------
    input_mean, input_std : float32 [I].
    output_mean, output_std : float32 [O].
    weights : one a layer, [sets, inputs, outputs] of float32 or float16.
    biases : one a layer, [sets, outputs] of the weights' type.
    """

    input_mean: Array
    input_std: Array
    output_mean: Array
    output_std: Array
    weights: tuple[NDArray, ...]
    biases: tuple[NDArray, ...]

    def __post_init__(self) -> None:
        if not len(self.weights) == len(self.biases) > 0:
            raise ValueError(f"{len(self.weights)} weights, {len(self.biases)} biases")
        kind = str(self.weights[0].dtype)
        if kind not in ("float32", "float16"):
            raise ValueError(f"weights of {kind}")
        count, rows = self.weights[0].shape[:2]
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            columns = weight.shape[-1]
            files.check_shapes(
                {f"weights of layer {layer}": weight, f"biases of layer {layer}": bias},
                {
                    f"weights of layer {layer}": (kind, (count, rows, columns)),
                    f"biases of layer {layer}": (kind, (count, columns)),
                },
            )
            rows = columns
        ends = {n: self.sizes[0] if n.startswith("input") else self.sizes[-1] for n in NORMALISATION}
        files.check_shapes(vars(self), {name: ("float32", (ends[name],)) for name in NORMALISATION})
        if not np.all(self.input_std > 0):
            column = int(np.argmin(self.input_std > 0))
            raise ValueError(f"its input {column} is divided by {self.input_std[column]:g}")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({'-'.join(map(str, self.sizes))}, {self.weight_type})"

    @property
    def sizes(self) -> tuple[int, ...]:
        """Inputs, hidden widths, outputs."""
        return (self.weights[0].shape[1], *(weight.shape[2] for weight in self.weights))

    @property
    def weight_type(self) -> str:
        return str(self.weights[0].dtype)

    @property
    def parameters(self) -> int:
        """Numbers in the weights and biases of one set."""
        return sum(array[0].size for array in (*self.weights, *self.biases))

    def as_type(self, weight_type: WeightType) -> Self:
        """The same network with its weights and biases stored otherwise; the normalisation stays float32.

        float16 rounds to the nearest; a weight beyond its range is a UserError.
        """
        largest = max(float(np.abs(array).max(initial=0)) for array in (*self.weights, *self.biases))
        if weight_type == "float16" and largest > float(np.finfo(np.float16).max):
            raise UserError(f"weights of up to {largest:g} do not fit float16", remedy="take float32")
        parts = (
            tuple(array.astype(weight_type) for array in arrays) for arrays in (self.weights, self.biases)
        )
        weights, biases = parts
        return replace(self, weights=weights, biases=biases)

    def to_arrays(self, prefix: str) -> dict[str, NDArray]:
        """Arrays by name, each with the prefix; `from_arrays` reads them back."""
        arrays: dict[str, NDArray] = {prefix + name: getattr(self, name) for name in NORMALISATION}
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"{prefix}{layer}.weight": weight, f"{prefix}{layer}.bias": bias}
        return arrays

    @classmethod
    def from_arrays(cls, prefix: str, arrays: Mapping[str, NDArray]) -> Self:
        """What `to_arrays` gave; a missing array is a KeyError, one that does not fit a ValueError."""
        return cls(**cls._parts(prefix, arrays))

    @classmethod
    def _parts(cls, prefix: str, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        """The constructor's arguments."""
        layers = range(sum(name.startswith(prefix) and name.endswith(".bias") for name in arrays))
        return {
            **{name: arrays[prefix + name] for name in NORMALISATION},
            "weights": tuple(arrays[f"{prefix}{layer}.weight"] for layer in layers),
            "biases": tuple(arrays[f"{prefix}{layer}.bias"] for layer in layers),
        }
