"""A phase-functioned network: four plain networks and what blends them (REFERENCE 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..locomotion.network import MixedNetwork, WeightType
from ..network import elu
from .spline import CONTROLS, SETS, Mode, check_mode, sets, shares

__all__ = ["PhaseNetwork", "WeightType"]

Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False, repr=False)
class PhaseNetwork(MixedNetwork):
    """A network of layers x W(phase) + b(phase); the sets of `weights` are the spline's control points."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.weights[0]) != CONTROLS:
            raise ValueError(f"weights of {len(self.weights[0])} control points, expected {CONTROLS}")

    def weight_bytes(self, mode: Mode = "cubic") -> int:
        """Bytes of the weight sets that a mode holds (REFERENCE 4.3)."""
        check_mode(mode)
        return SETS[mode] * self.parameters * self.weights[0].itemsize

    def evaluate(self, x: ArrayLike, phases: ArrayLike, mode: Mode = "cubic") -> Array:
        """Outputs [N, O] of inputs [N, I] at phases [N]: the obvious twin of `lmm.pfnn.evaluator`."""
        check_mode(mode)
        first, share = shares(phases, mode)
        which = (first[:, None] + np.arange(share.shape[1])) % SETS[mode]
        h = (np.asarray(x, np.float32) - self.input_mean) / self.input_std
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            held = sets(weight, mode).astype(np.float32), sets(bias, mode).astype(np.float32)
            w, b = (np.einsum("nu,nu...->n...", share.astype(np.float32), part[which]) for part in held)
            h = np.einsum("ni,nio->no", elu(h) if layer else h, w) + b
        return h * self.output_std + self.output_mean
