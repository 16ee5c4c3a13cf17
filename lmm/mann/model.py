"""A trained mode-adaptive network with what it was made from."""

from __future__ import annotations

from dataclasses import dataclass

from mm.database import Database
from mm.description import Description

from ..locomotion.model import LocomotionModel
from .layout import Layout
from .network import MannNetwork

KIND, VERSION = "mode-adaptive network", 1


@dataclass(eq=False, repr=False)
class MannModel(LocomotionModel):
    """A mode-adaptive network on a description of its data; without contacts put out no foot is locked."""

    kind, family, version, network_type = KIND, "mann", VERSION, MannNetwork
    layout_type = Layout

    network: MannNetwork

    @property
    def parameters(self) -> int:
        """Numbers in the experts and the gate."""
        return self.network.experts * self.network.parameters + self.network.gate_parameters

    def weight_bytes(self) -> dict[str, int]:
        """Bytes of the experts' weights, and of the gate's."""
        return {"experts": self.network.weight_bytes, "gate": 4 * self.network.gate_parameters}


def end_effectors(description: Description | Database) -> list[int]:
    """The joints whose velocities the gate sees, the ground root not counted: those of the contacts."""
    return [description.skeleton.role(role) - 1 for role in description.contact_roles]
