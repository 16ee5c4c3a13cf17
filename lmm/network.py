"""A plain feed-forward network with its normalisation: what is trained, stored, exchanged and run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from motion import files
from motion.errors import UserError

Array = NDArray[np.float32]
Activation = Literal["relu", "elu"]
WeightType = Literal["float32", "float16", "int8"]
WEIGHTS = (*get_args(WeightType), "bfloat16")  # what weights may be held as when networks run
NORMALISATION = ("input_mean", "input_std", "output_mean", "output_std")


@dataclass(frozen=True, eq=False, repr=False)
class Network:
    """y = output_mean + output_std f((x - input_mean) / input_std), f layers of x W + b (REFERENCE 3.1).

    Attributes
    ----------
    input_mean, input_std : float32 [I].
    output_mean, output_std : float32 [O]; output_std is 0 where the output is constant.
    weights : one a layer, [inputs, outputs] of float32, float16, or int8 in units of the layer's scale.
    scales : one a layer, float32 [outputs] for int8 weights, None for others.
    biases : one a layer, float32 [outputs].
    activation : between layers; none follows the last.
    """

    input_mean: Array
    input_std: Array
    output_mean: Array
    output_std: Array
    weights: tuple[NDArray, ...]
    scales: tuple[Array | None, ...]
    biases: tuple[Array, ...]
    activation: Activation = "relu"

    def __post_init__(self) -> None:
        if not len(self.weights) == len(self.biases) == len(self.scales) > 0:
            raise ValueError(f"{len(self.weights)} weights, {len(self.biases)} biases")
        sizes, kind = self.sizes, self.weights[0].dtype
        if self.activation not in ("relu", "elu"):
            raise ValueError(f"activation {self.activation!r}")
        if kind not in ("float32", "float16", "int8"):
            raise ValueError(f"weights of {kind}")
        for layer, (rows, columns) in enumerate(pairwise(sizes)):
            expected = {"weight": (str(kind), (rows, columns)), "bias": ("float32", (columns,))}
            found = {"weight": self.weights[layer], "bias": self.biases[layer]}
            scale = self.scales[layer]
            if kind == np.int8 and scale is not None:
                expected["scale"], found["scale"] = ("float32", (columns,)), scale
            elif kind == np.int8 or scale is not None:
                raise ValueError(f"layer {layer}: {kind} weights and scales do not go together")
            files.check_shapes(
                {f"{name} of layer {layer}": array for name, array in found.items()},
                {f"{name} of layer {layer}": shape for name, shape in expected.items()},
            )
        ends = {n: sizes[0] if n.startswith("input") else sizes[-1] for n in NORMALISATION}
        files.check_shapes(vars(self), {name: ("float32", (ends[name],)) for name in NORMALISATION})
        if not np.all(self.input_std > 0):
            column = int(np.argmin(self.input_std > 0))
            raise ValueError(f"its input {column} is divided by {self.input_std[column]:g}")

    def __repr__(self) -> str:
        return f"Network({'-'.join(map(str, self.sizes))}, {self.weight_type})"

    @property
    def sizes(self) -> tuple[int, ...]:
        """Inputs, hidden widths, outputs."""
        return (self.weights[0].shape[0], *(weight.shape[1] for weight in self.weights))

    @property
    def weight_type(self) -> str:
        return str(self.weights[0].dtype)

    @property
    def parameters(self) -> int:
        """Numbers in weights and biases."""
        return sum(array.size for array in (*self.weights, *self.biases))

    @property
    def nbytes(self) -> int:
        """Bytes of weights, scales, biases and normalisation."""
        return sum(array.nbytes for array in self.to_arrays("").values())

    def weight(self, layer: int) -> Array:
        """A layer's weights as float32 [inputs, outputs]."""
        values, scale = self.weights[layer].astype(np.float32), self.scales[layer]
        return values if scale is None else values * scale

    def evaluate(self, x: Array) -> Array:
        """Outputs [N, O] of inputs [N, I]: the obvious twin of the compiled runtime (`lmm.evaluator`)."""
        x = (np.asarray(x, np.float32) - self.input_mean) / self.input_std
        for layer, bias in enumerate(self.biases):
            if layer:
                x = np.maximum(x, 0) if self.activation == "relu" else elu(x)
            x = x @ self.weight(layer) + bias
        return x * self.output_std + self.output_mean

    def as_type(self, weight_type: WeightType) -> Network:
        """The same network with its weights stored otherwise; biases and normalisation stay float32.

        int8 takes a scale for every output of a layer, its largest weight / 127 (rounding error at most half
        a scale); float16 rounds to the nearest, and a weight beyond its range is a UserError.
        """
        weights = [self.weight(layer) for layer in range(len(self.weights))]
        largest = max(float(np.abs(w).max(initial=0)) for w in weights)
        if weight_type == "float16" and largest > float(np.finfo(np.float16).max):
            raise UserError(f"weights of up to {largest:g} do not fit float16", remedy="take int8 or float32")
        scales: list[Array | None] = [None] * len(weights)
        if weight_type == "int8":
            tops = [np.abs(w).max(axis=0) / np.float32(127) for w in weights]
            steps = [np.where(top > 0, top, np.float32(1)).astype(np.float32) for top in tops]
            stored = [np.rint(w / s).astype(np.int8) for w, s in zip(weights, steps, strict=True)]
            scales = list(steps)
        else:
            stored = [w.astype(weight_type) for w in weights]
        return replace(self, weights=tuple(stored), scales=tuple(scales))

    def to_arrays(self, prefix: str) -> dict[str, NDArray]:
        """Arrays by name, each with the prefix; `from_arrays` reads them back."""
        arrays: dict[str, NDArray] = {prefix + name: getattr(self, name) for name in NORMALISATION}
        for layer, (weight, scale, bias) in enumerate(
            zip(self.weights, self.scales, self.biases, strict=True)
        ):
            arrays |= {f"{prefix}{layer}.weight": weight, f"{prefix}{layer}.bias": bias}
            if scale is not None:
                arrays[f"{prefix}{layer}.scale"] = scale
        return arrays

    @staticmethod
    def from_arrays(prefix: str, arrays: Mapping[str, NDArray], activation: Any = "relu") -> Network:
        """What `to_arrays` gave; a missing array is a KeyError, one that does not fit a ValueError."""
        layers = range(sum(name.startswith(prefix) and name.endswith(".bias") for name in arrays))
        return Network(
            **{name: arrays[prefix + name] for name in NORMALISATION},
            weights=tuple(arrays[f"{prefix}{layer}.weight"] for layer in layers),
            scales=tuple(arrays.get(f"{prefix}{layer}.scale") for layer in layers),
            biases=tuple(arrays[f"{prefix}{layer}.bias"] for layer in layers),
            activation=activation,
        )


def elu(x: Array) -> Array:
    """x where positive, else exp(x) - 1."""
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


def to_bfloat16(x: Array) -> Array:
    """x with 8 significant bits: the nearest such numbers, of two the one whose last bit is 0."""
    bits = np.array(x, np.float32, order="C").view(np.uint32)
    nearest = (bits + np.uint32(0x7FFF) + (bits >> 16 & 1)) & np.uint32(0xFFFF0000)
    return np.where(np.isnan(x), np.float32(np.nan), nearest.view(np.float32))
