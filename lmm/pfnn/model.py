"""A trained phase-functioned network with what it was made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..locomotion.model import LocomotionModel
from .layout import Layout
from .network import PhaseNetwork
from .spline import SETS

KIND, VERSION = "phase-functioned network", 1
CONTACTS = ("left_heel", "left_toe", "right_heel", "right_toe")  # of the published network


@dataclass(eq=False, repr=False)
class PhaseModel(LocomotionModel):
    """A phase-functioned network on a description of its data."""

    kind, family, version, network_type = KIND, "pfnn", VERSION, PhaseNetwork
    layout_type = Layout

    network: PhaseNetwork
    contacts: tuple[str, ...] = CONTACTS

    @property
    def parameters(self) -> int:
        """Numbers in the network's four control points."""
        return 4 * self.network.parameters

    @property
    def sees_ground(self) -> bool:
        """Whether the heights that it was trained on were other than those of level ground."""
        return bool(np.any(self.network.input_mean[self.layout.inputs["heights"]]))

    def weight_bytes(self) -> dict[str, int]:
        """Bytes of the weight sets that each mode holds."""
        return {mode: self.network.weight_bytes(mode) for mode in SETS}
