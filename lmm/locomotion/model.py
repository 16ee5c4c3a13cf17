"""A trained network with what it was made from, on file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from mm.description import Description
from motion import files
from motion.errors import UserError

from .. import pretrained
from .layout import BlockLayout
from .network import MixedNetwork, WeightType

BONE = 1e-3  # metres that bones of one skeleton may differ by from file to file


@dataclass(eq=False, repr=False)
class LocomotionModel:
    """A network on a description of its data; all that its controller needs.

    Attributes
    ----------
    description : skeleton, rate, feet of the data.
    network : inputs and outputs as `layout` has them, in metres and seconds.
    contacts : what the contacts that are put out are of (`features.labels.Labels.names`).
    bounds : float32 [2, O], the least and the most of each output that characters follow; None follows all.
    held_out, database, ranges, frames, training, errors, fingerprint : as `lmm.model.Model` has them.
    """

    kind: ClassVar[str]  # of its files
    family: ClassVar[str]  # of its systems
    version: ClassVar[int]
    network_type: ClassVar[type[MixedNetwork]]
    layout_type: ClassVar[type[BlockLayout]]

    description: Description
    network: Any
    contacts: tuple[str, ...]
    bounds: NDArray[np.float32] | None = None
    held_out: tuple[str, ...] = ()
    database: str = ""
    ranges: int = 0
    frames: int = 0
    training: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, Any] = field(default_factory=dict)
    fingerprint: str = ""

    def __post_init__(self) -> None:
        self.validate()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.network!r}, {self.layout.joints} joints)"

    @property
    def layout(self) -> Any:
        """What the network takes in and puts out."""
        return self.layout_type(len(self.description.skeleton) - 1, len(self.contacts))

    @property
    def networks(self) -> dict[str, Any]:
        """What runs, by name."""
        return {self.family: self.network}

    @property
    def parameters(self) -> int:
        """Numbers in all weights and biases."""
        raise NotImplementedError

    @property
    def sees_ground(self) -> bool:
        """Whether the network knows ground that is not level."""
        return False

    def weight_bytes(self) -> dict[str, int]:
        """Bytes of weights and biases at run time, by part or by mode."""
        raise NotImplementedError

    def check(self, database: Database, path: str | os.PathLike[str] | None = None) -> None:
        """A UserError unless the network moves the skeleton of a database, at its rate."""
        mine, its = self.description.skeleton, database.skeleton
        remedy = "give the database that it was trained from, or one of the same skeleton and rate"
        what = None
        if mine.names != its.names or not np.array_equal(mine.parents, its.parents):
            what = "other joints"
        elif not np.allclose(mine.offsets[its.parents > 0], its.offsets[its.parents > 0], atol=BONE):
            what = "bones of other lengths"
        elif self.description.contact_roles != database.contact_roles:
            what = "other contacts"
        elif self.description.fps != database.fps:
            what = f"{self.description.fps:g} frames per second, not {database.fps:g}"
        if what is not None:
            raise UserError(f"the model is not of this database: {what}", path=path, remedy=remedy)

    def as_type(self, weight_type: WeightType) -> Self:
        """The same model with its weights stored otherwise (`MixedNetwork.as_type`)."""
        return replace(self, network=self.network.as_type(weight_type), fingerprint="")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write atomically; sets and stores the fingerprint."""
        about, arrays = self.description.to_parts()
        arrays = {f"description.{name}": array for name, array in arrays.items()}
        arrays |= self.network.to_arrays("network.")
        if self.bounds is not None:
            arrays["bounds"] = self.bounds
        metadata = {
            "description": about,
            "contacts": list(self.contacts),
            "held_out": list(self.held_out),
            "database": self.database,
            "ranges": self.ranges,
            "frames": self.frames,
            "training": self.training,
            "errors": self.errors,
        }
        self.fingerprint = files.save(path, self.kind, self.version, metadata, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a model: a file, or one that ships, by its name. Errors: see `motion.files.load`."""
        path = pretrained.find(path)
        metadata, arrays, fingerprint = files.load(path, cls.kind, cls.version)
        with files.content_of(path, cls.kind):
            prefix = "description."
            of_description = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
            parts = {n: metadata[n] for n in ("database", "ranges", "frames", "training", "errors")}
            return cls(
                description=Description.from_parts(metadata["description"], of_description),
                network=cls.network_type.from_arrays("network.", arrays),
                contacts=tuple(metadata["contacts"]),
                bounds=arrays.get("bounds"),
                held_out=tuple(metadata["held_out"]),
                **parts,
                fingerprint=fingerprint,
            )

    def validate(self) -> None:
        """A ValueError unless the network fits the skeleton."""
        skeleton, sizes = self.description.skeleton, self.network.sizes
        if skeleton.roles.get("root") != 0:
            raise ValueError("its skeleton has no ground root as joint 0")
        expected = self.layout.input_size, self.layout.output_size
        if (sizes[0], sizes[-1]) != expected:
            raise ValueError(
                f"a network of {sizes[0]} inputs and {sizes[-1]} outputs, expected {expected[0]} and "
                f"{expected[1]} for {self.layout.joints} joints and {self.layout.contacts} contacts"
            )
        if self.bounds is not None:
            files.check_shapes({"bounds": self.bounds}, {"bounds": ("float32", (2, expected[1]))})
            if not (self.bounds[0] <= self.bounds[1]).all():
                raise ValueError("bounds whose least is above their most")
