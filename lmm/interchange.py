"""The public reference's networks (REFERENCE 2.7): read as a model, written from one.

A network's file holds its normalisation, its weights and its biases as float32, and nothing else. The joints,
the features, their normalisation and the rate come from a database.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mm import interchange
from mm.database import Database
from mm.description import Description
from motion import files
from motion.errors import UserError

from .evaluation import decompressor
from .frames import projector_inputs
from .layout import Layout
from .model import CHUNK, RUNTIME, Model
from .network import NORMALISATION, Array, Network

PathLike = str | os.PathLike[str]
MOST_LAYERS = 100
SAME = 1e-4  # relative; features' normalisation as computed by different programs


def read_network(path: PathLike) -> Network:
    """Read a network; a missing, cut or foreign file, or one whose layers do not fit, is a UserError."""
    cursor = interchange.Cursor(path)
    try:
        normalisation: dict[str, Any] = {
            name: cursor.take(name.replace("_", " "), 1) for name in NORMALISATION
        }
        layers = cursor.number("number of layers")
        if not 1 <= layers <= MOST_LAYERS:
            raise interchange.Misfit(f"it is of {layers} layers, 1 to {MOST_LAYERS} are read")
        weights, biases = [], []
        for layer in range(layers):
            weights.append(cursor.take(f"weights of layer {layer}", 2))
            biases.append(cursor.take(f"biases of layer {layer}", 1))
        cursor.end()
        network = Network(
            **normalisation, weights=tuple(weights), scales=(None,) * layers, biases=tuple(biases)
        )
        if 0 in network.sizes:
            raise interchange.Misfit(f"its layers are {'-'.join(map(str, network.sizes))} wide")
    except (interchange.Misfit, ValueError) as misfit:
        raise interchange.refuse(path, "network", misfit) from misfit
    interchange.check_finite(path, *network.to_arrays("").values())
    return network


def write_network(path: PathLike, network: Network) -> None:
    """Write a network, atomically; weights of float16 and int8 become the float32 that they stand for.

    The format knows no activation but ReLU: another one is a UserError.
    """
    with files.atomic(path) as stream:
        _put_network(stream, network)


def _put_network(stream: IO[bytes], network: Network) -> None:
    if network.activation != "relu":
        raise UserError(
            f"the public reference's networks have ReLU between their layers, this one has "
            f"{network.activation.upper()}",
            remedy="write decompressor, stepper and projector",
        )
    for name in NORMALISATION:
        interchange.put(stream, getattr(network, name), 1)
    stream.write(np.array(len(network.biases), "<i4").tobytes())
    for layer, bias in enumerate(network.biases):
        interchange.put(stream, network.weight(layer), 2)
        interchange.put(stream, bias, 1)
    stream.flush()


def outputs(directory: PathLike, *, with_database: bool) -> list[Path]:
    """The files that `export_directory` writes into a folder."""
    names = [*RUNTIME, *(("latent", "features", "database") if with_database else ())]
    return [Path(directory, f"{name}.bin") for name in names]


def export_directory(model: Model, directory: PathLike, *, database: Database | None = None) -> list[Path]:
    """Write the three networks into a folder; returns the files' paths.

    With the model's database ``latent.bin`` is written too, which takes the model's compressor or the latents
    stored with it, and ``database.bin`` and ``features.bin`` (`mm.interchange.export_directory`). Where one
    file cannot be written, none is.
    """
    paths = outputs(directory, with_database=database is not None)
    if database is not None:
        model.check(database)
    with contextlib.ExitStack() as together:
        streams = {path.stem: together.enter_context(files.atomic(path)) for path in paths[:4]}
        for name, network in model.networks.items():
            _put_network(streams[name], network)
        if database is not None:
            interchange.put(streams["latent"], model.latents(database), 2)
            streams["latent"].flush()
            interchange.export_directory(database, directory)  # where it fails the folder gets none
    return paths


def import_directory(directory: PathLike, database: Database) -> Model:
    """The model of a folder's ``decompressor.bin``, ``stepper.bin`` and ``projector.bin``.

    What the files do not hold is taken from the database that they were trained on; what does not fit it is a
    UserError. The compressor is in no file, so the model has none, but the latents of the database's frames
    themselves. They come from ``latent.bin`` if it is there, else they are what the projector answers to the
    frames: near to them as far as the projector is good.
    """
    folder = Path(directory)
    if files.kind(folder / "decompressor.bin") != "file":
        raise UserError(
            "no decompressor.bin in this folder",
            path=folder,
            remedy="give a folder with decompressor.bin, stepper.bin and projector.bin",
        )
    networks: dict[str, Any] = {name: read_network(folder / f"{name}.bin") for name in RUNTIME}
    description = Description.of(database)
    features, queried = description.schema.size, networks["projector"].sizes[0]
    if queried == features:
        description = replace(description, crouch_tag=0)  # it is not asked whether to crouch
    latents = networks["decompressor"].sizes[0] - features
    state, pose = features + latents, Layout(len(database.skeleton), len(database.contact_roles)).size
    ends = {
        "decompressor": (features + max(latents, 1), pose),
        "stepper": (state, state),
        "projector": (features + bool(description.crouch_tag), state),
    }
    for name, network in networks.items():
        _check_ends(folder / f"{name}.bin", network, *ends[name], database)
    _check_normalisation(folder / "features.bin", database)
    latent = _latents(folder, networks, description, database)
    state_of = np.concatenate([database.features, latent], axis=1)
    model = Model(
        description=description,
        **networks,
        compressor=None,
        state_low=state_of.min(axis=0),
        state_high=state_of.max(axis=0),
        state_std=state_of.std(axis=0, dtype=np.float64).astype(np.float32),
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"recipe": "imported"},
        stored_latents=latent,
    )
    model.errors["decompressor"] = {"all": mean_errors(model, database, latent)}
    return model


def mean_errors(
    model: Model, database: Database, latents: Array, *, ranges: NDArray[np.bool_] | None = None
) -> dict[str, float]:
    """How far the decompressor's poses are off: position_cm and rotation_deg, means over joints and frames.

    latents [T, L] of the database's frames; ranges: a mask [R] of those to look at.
    """
    errors = decompressor.errors(model, database, latents, ranges=ranges)
    return {name: errors[name]["mean"] for name in ("position_cm", "rotation_deg")}


def own_queries(
    description: Description, database: Database, frames: slice | NDArray[np.int64] = slice(None)
) -> Array:
    """Queries [T, F], or [T, F + 1] with crouching, that ask for a database's own frames."""
    return projector_inputs(database.features[frames], description.crouch_tag, database.tags[frames])


def projected_latents(projector: Network, description: Description, database: Database) -> Array:
    """The latents [T, L] that a projector answers to a database's own frames."""
    queries, features = own_queries(description, database), description.schema.size
    parts = range(0, len(queries), CHUNK)
    return np.concatenate([projector.evaluate(queries[at : at + CHUNK])[:, features:] for at in parts])


def _check_ends(path: Path, network: Network, inputs: int, outputs: int, database: Database) -> None:
    if (network.sizes[0], network.sizes[-1]) != (inputs, outputs):
        raise UserError(
            f"a network of {network.sizes[0]} inputs and {network.sizes[-1]} outputs; for a database of "
            f"{database.schema.size} features, {len(database.skeleton)} joints and "
            f"{len(database.contact_roles)} contacts it would have {inputs} and {outputs}",
            path=path,
            remedy="give the database that it was trained on, and networks that were trained together",
        )


def _check_normalisation(path: Path, database: Database) -> None:
    """A UserError if the folder has features and the database's are normalised otherwise."""
    if files.kind(path) is None:
        return
    _, offset, scale = interchange.read_features(path)
    same = offset.shape == database.offset.shape and np.allclose(scale, database.scale, rtol=SAME, atol=0)
    if not same or np.any(np.abs(offset - database.offset) > SAME * database.scale):
        raise UserError(
            "these features are normalised otherwise than the database's",
            path=path,
            remedy="give the database that the networks were trained on: python -m mm import FOLDER",
        )


def _latents(
    folder: Path, networks: dict[str, Network], description: Description, database: Database
) -> Array:
    """Latents [T, L] of a database's frames."""
    expected = networks["stepper"].sizes[0] - description.schema.size
    if files.kind(folder / "latent.bin") is None:
        return projected_latents(networks["projector"], description, database)
    latents = interchange.read_latent(folder / "latent.bin")
    if latents.shape != (len(database), expected):
        raise UserError(
            f"latents of {latents.shape[0]} frames x {latents.shape[1]}; the database has {len(database)} "
            f"frames and the networks take {expected} latents",
            path=folder / "latent.bin",
            remedy="give the database that the networks were trained on",
        )
    return latents
