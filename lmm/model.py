"""A trained model: the networks that run, the one that made the latents, and what they were made from."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from mm.description import Description
from motion import files
from motion.errors import UserError

from . import pretrained
from .frames import compressor_inputs, compressor_size
from .layout import Layout
from .network import Network, WeightType

KIND, VERSION = "learned motion matching model", 1
RUNTIME = ("decompressor", "stepper", "projector")
NEARLY = 1e-4  # relative; what statistics of the same data differ by between machines
CHUNK = 4096


@dataclass(eq=False, repr=False)
class Model:
    """Networks in place of the engine's stages (REFERENCE 3.1), on a description of their data.

    All work on features [F] normalised as in the database, and latents [L].

    Attributes
    ----------
    description : skeleton, rate, schema, normalisation, feet; all that a controller needs.
    decompressor : [features, latent] to a pose's vector (`lmm.layout.Layout`).
    stepper : [features, latent] to the rates of change per second of both.
    projector : [query] to [features, latent]; where the data divides into crouched and upright frames, the
        query is followed by 1 if crouching is asked for, else 0.
    compressor : a frame's vector (`lmm.frames.compressor_inputs`) to its latent; None where it was left out.
    state_low, state_high, state_std : float32 [F + L], over the frames that it was trained on.
    held_out : names of the clips that it was not trained on.
    database, ranges, frames : fingerprint and size of the database that it was trained from.
    training : how: recipe, preset, seed, settings, version.
    errors : as measured after training, by part of the data.
    stored_latents : float32 or float16 [T, L], those of the database's frames, where no compressor makes
        them; None where one does, or where they were left out. Only stages that read the database need them.
    fingerprint : hash of all of it, as stored.
    """

    description: Description
    decompressor: Network
    stepper: Network
    projector: Network
    compressor: Network | None
    state_low: NDArray[np.float32]
    state_high: NDArray[np.float32]
    state_std: NDArray[np.float32]
    held_out: tuple[str, ...] = ()
    database: str = ""
    ranges: int = 0
    frames: int = 0
    training: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, Any] = field(default_factory=dict)
    stored_latents: NDArray[np.float32] | NDArray[np.float16] | None = None
    fingerprint: str = ""

    def __repr__(self) -> str:
        return f"Model({self.F} features, {self.L} latents, {self.parameters:,} parameters)"

    @property
    def F(self) -> int:
        """Features."""
        return self.description.schema.size

    @property
    def L(self) -> int:
        """Latents."""
        return len(self.state_std) - self.F

    @property
    def layout(self) -> Layout:
        """What the decompressor puts out."""
        return Layout(len(self.description.skeleton), len(self.description.contact_roles))

    @property
    def networks(self) -> dict[str, Network]:
        """The three that run."""
        return {name: getattr(self, name) for name in RUNTIME}

    @property
    def parameters(self) -> int:
        """Numbers in the three networks that run."""
        return sum(network.parameters for network in self.networks.values())

    def memory(self) -> dict[str, int]:
        """Bytes of the three networks that run, by name; the normalisation of features."""
        sizes = {name: network.nbytes for name, network in self.networks.items()}
        return sizes | {"statistics": self.description.offset.nbytes + self.description.scale.nbytes}

    def as_type(self, weight_type: WeightType) -> Model:
        """The same model with its weights stored otherwise (`Network.as_type`)."""
        networks: dict[str, Any] = {name: n.as_type(weight_type) for name, n in self.networks.items()}
        compressor = self.compressor and self.compressor.as_type(
            "float16" if weight_type == "int8" else weight_type
        )
        latents = self.stored_latents
        if latents is not None and weight_type != "float32":
            latents = latents.astype(np.float16)
        return replace(self, **networks, compressor=compressor, stored_latents=latents, fingerprint="")

    def without_latents(self) -> Model:
        """The same model without what only knows the latents of a database's frames."""
        return replace(self, compressor=None, stored_latents=None, fingerprint="")

    @property
    def knows_latents(self) -> bool:
        """Whether it has the latents of its database's frames, or can make them."""
        return self.compressor is not None or self.stored_latents is not None

    def training_ranges(self, database: Database) -> NDArray[np.bool_]:
        """Which ranges [R] of its database it was trained on: not held-out clips and their mirrors."""
        return np.array([name not in self.held_out for name in database.names], bool)

    def latents(self, database: Database) -> NDArray[np.float32]:
        """The latents [T, L] of a database's frames: those stored, of its own one, or the compressor's.

        Where there are neither a UserError, and where those stored are of another database.
        """
        if self.stored_latents is not None:
            self.check(database)
            return np.asarray(self.stored_latents, np.float32)
        if self.compressor is None:
            raise UserError(
                "this model was stored without its compressor, which makes the latents of a database",
                remedy="use the model as it was trained",
            )
        out = np.empty((len(database), self.L), np.float32)
        for start in range(0, len(database), CHUNK):
            part = slice(start, min(start + CHUNK, len(database)))
            out[part] = self.compressor.evaluate(compressor_inputs(database, part))
        return out

    def check(self, database: Database, path: str | os.PathLike[str] | None = None) -> None:
        """A UserError unless the model was trained from this database, or from one that equals it.

        Joints, rate, schema, contacts, tags, ranges and frames must be the same, the features' statistics
        nearly so: the same clips give the same database on any machine but for rounding.
        """
        mine, remedy = self.description, "give the database that it was trained from, or train one from this"
        pairs: dict[str, tuple[Any, Any]] = {
            "joints": (mine.skeleton.names, database.skeleton.names),
            "frames per second": (mine.fps, database.fps),
            "schema": (mine.schema.to_dict(), database.schema.to_dict()),
            "contacts": (mine.contact_roles, database.contact_roles),
            "tags": (mine.tag_names, database.tag_names),
            "ranges": (self.ranges, len(database.starts)),
            "frames": (self.frames, len(database)),
        }
        for what, (one, other) in pairs.items():
            if one != other:
                numbers = isinstance(one, int | float)
                how = f"{one:,} {what}, not {other:,}" if numbers else f"other {what}"
                raise UserError(f"the model is not of this database: {how}", path=path, remedy=remedy)
        close = np.allclose(mine.offset, database.offset, rtol=NEARLY, atol=NEARLY * float(mine.scale.min()))
        if not close or not np.allclose(mine.scale, database.scale, rtol=NEARLY):
            how = "features normalised otherwise"
            raise UserError(f"the model is not of this database: {how}", path=path, remedy=remedy)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write atomically; sets and stores the fingerprint."""
        about, arrays = self.description.to_parts()
        arrays = {f"description.{name}": array for name, array in arrays.items()}
        networks = self.networks | ({"compressor": self.compressor} if self.compressor else {})
        for name, network in networks.items():
            arrays |= network.to_arrays(f"{name}.")
        arrays |= {name: getattr(self, name) for name in ("state_low", "state_high", "state_std")}
        if self.stored_latents is not None:
            arrays["stored_latents"] = self.stored_latents
        metadata = {
            "description": about,
            "activations": {name: network.activation for name, network in networks.items()},
            "held_out": list(self.held_out),
            "database": self.database,
            "ranges": self.ranges,
            "frames": self.frames,
            "training": self.training,
            "errors": self.errors,
        }
        self.fingerprint = files.save(path, KIND, VERSION, metadata, arrays)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Model:
        """Read a model: a file, or one that ships, by its name. Errors: see `motion.files.load`."""
        path = pretrained.find(path)
        metadata, arrays, fingerprint = files.load(path, KIND, VERSION)
        with files.content_of(path, KIND):
            prefix = "description."
            of_description = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
            parts: dict[str, Any] = {n: arrays[n] for n in ("state_low", "state_high", "state_std")}
            parts |= {n: metadata[n] for n in ("database", "ranges", "frames", "training", "errors")}
            networks: dict[str, Any] = {"compressor": None} | {
                name: Network.from_arrays(f"{name}.", arrays, activation)
                for name, activation in metadata["activations"].items()
            }
            model = Model(
                description=Description.from_parts(metadata["description"], of_description),
                **networks,
                **parts,
                held_out=tuple(metadata["held_out"]),
                stored_latents=arrays.get("stored_latents"),
                fingerprint=fingerprint,
            )
            model.validate()
        return model

    def validate(self) -> None:
        """A ValueError unless the networks fit each other and the description."""
        state, crouch = self.F + self.L, bool(self.description.crouch_tag)
        expected = {
            "decompressor": (state, self.layout.size),
            "stepper": (state, state),
            "projector": (self.F + crouch, state),
        }
        for name, network in self.networks.items():
            ends = network.sizes[0], network.sizes[-1]
            if ends != expected[name]:
                raise ValueError(
                    f"{name} of {ends[0]} inputs and {ends[1]} outputs, expected {expected[name]}"
                )
        if self.compressor is not None:
            sizes, seen = self.compressor.sizes, compressor_size(self.layout)
            if (sizes[0], sizes[-1]) != (seen, self.L):
                found = f"{sizes[0]} inputs and {sizes[-1]} outputs"
                raise ValueError(f"compressor of {found}, expected {seen, self.L}")
        shapes: dict[str, Any] = dict.fromkeys(
            ("state_low", "state_high", "state_std"), ("float32", (state,))
        )
        latents = self.stored_latents
        if latents is not None:
            kind = "float16" if latents.dtype == np.float16 else "float32"
            shapes["stored_latents"] = kind, (self.frames, self.L)
        files.check_shapes(vars(self), shapes)
