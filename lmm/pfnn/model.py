"""A trained phase-functioned network with what it was made from."""

from __future__ import annotations

from dataclasses import dataclass

from ..locomotion.model import LocomotionModel
from .layout import Layout
from .network import PhaseNetwork

KIND, VERSION = "phase-functioned network", 1
CONTACTS = ("left_heel", "left_toe", "right_heel", "right_toe")  # of the published network


@dataclass(eq=False, repr=False)
class PhaseModel(LocomotionModel):
    """A phase-functioned network on a description of its data."""

    kind, version, network_type = KIND, VERSION, PhaseNetwork

    network: PhaseNetwork
    contacts: tuple[str, ...] = CONTACTS

    @property
    def layout(self) -> Layout:
        """What the network takes in and puts out."""
        return Layout(len(self.description.skeleton) - 1, len(self.contacts))

    @property
    def parameters(self) -> int:
        """Numbers in the network's four control points."""
        return 4 * self.network.parameters
