"""Small learned models as training makes them, but of random numbers, on a database of synthetic walking."""

from __future__ import annotations

import functools
import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import synthetic

from lmm.frames import compressor_inputs
from lmm.layout import Layout
from lmm.model import Model
from lmm.network import Network
from mm.build import build
from mm.database import Database
from mm.description import Description
from motion import bvh

LATENTS = 5


@functools.cache
def database(*, crouch: bool = False, fps: float = 60.0, schema: str = "mm27") -> Database:
    """Two seconds each of straight walking, which may be tagged as crouched, and of running in a curve."""
    with tempfile.TemporaryDirectory() as folder:
        for clip in (clip for clip in synthetic.clips(seconds=2.0) if clip.name in ("straight", "run")):
            bvh.write(Path(folder, f"{clip.name}.bvh"), clip)
        tags = Path(folder, "tags.csv")
        tags.write_text("tag,clips,start,stop\n" + "crouch,straight,,\n" * crouch)
        db = build(folder, jobs=1, tags=tags if crouch else None, fps=fps, schema=schema)
        db.save(Path(folder, "db"))
    return db


def thrown(db: Database, name: str) -> Database:
    """A database in a clip of which somebody is thrown about in the air."""
    found = replace(db, poses=db.poses[slice(0, len(db))].copy())
    hips = db.skeleton.roles["hips"]
    for r in np.flatnonzero(np.array(db.names) == name):
        part = slice(int(db.starts[r]), int(db.stops[r]))
        time = np.arange(part.stop - part.start)
        found.poses.positions[part, hips, 1] += 3 * np.abs(np.sin(0.3 * time))
        found.poses.positions[part, hips, 0] += time
    return found


def network(*sizes: int, seed: int = 0, activation: str = "relu") -> Network:
    """A network whose outputs are about as spread as its normalisation says."""
    rng = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    return Network(
        numbers(sizes[0]),
        np.exp(numbers(sizes[0]) / 4),
        numbers(sizes[-1]),
        np.exp(numbers(sizes[-1]) / 4),
        tuple(numbers(rows, columns) / np.float32(np.sqrt(rows)) for rows, columns in pairwise(sizes)),
        (None,) * (len(sizes) - 1),
        tuple(numbers(columns) / 10 for columns in sizes[1:]),
        activation,  # type: ignore[arg-type]
    )


def model(db: Database, *, latents: int = LATENTS, hidden: int = 16) -> Model:
    """A model of a database. Its decompressor puts out the database's mean pose, and a little beside it."""
    description = Description.of(db)
    layout, features = Layout(len(db.skeleton), len(db.contact_roles)), db.schema.size
    state, crouch = features + latents, bool(description.crouch_tag)
    vectors = layout.pack(db)
    compressor = network(compressor_inputs(db, slice(0, 1)).shape[1], hidden, latents, activation="elu")
    decompressor = network(state, hidden, layout.size, seed=1)
    decompressor.output_mean[:] = vectors.mean(axis=0)
    decompressor.output_std[:] = vectors.std(axis=0) / 10
    made = Model(
        description=description,
        decompressor=decompressor,
        stepper=network(state, hidden, hidden, state, seed=2),
        projector=network(features + crouch, hidden, hidden, state, seed=3),
        compressor=compressor,
        state_low=np.zeros(state, np.float32),
        state_high=np.zeros(state, np.float32),
        state_std=np.ones(state, np.float32),
        held_out=("run",),
        database=db.fingerprint,
        ranges=len(db.starts),
        frames=len(db),
        training={"settings": {"recipe": "ours", "preset": "smoke", "seed": 0}},
        errors={"held_out": {"position_cm": 2.0}},
    )
    table = np.concatenate([db.features, made.latents(db)], axis=1)
    made.state_low, made.state_high = table.min(axis=0), table.max(axis=0)
    made.state_std = table.std(axis=0)
    return made


def layer(weight: np.ndarray, bias: np.ndarray) -> Network:
    """A network of one layer, y = x W + b."""
    inputs, outputs = weight.shape
    ends = [np.full(n, v, np.float32) for n in (inputs, outputs) for v in (0, 1)]
    return Network(
        *ends, (np.asarray(weight, np.float32),), (None,), (np.asarray(bias, np.float32),)
    )  # fmt: skip


def linear_model(db: Database, *, latents: int | None = None) -> Model:
    """A model of a database whose networks are one layer each, so that their errors are known.

    Latents are the first principal components of the decompressor's vectors (all that vary when None), which
    the decompressor turns back; the stepper all but stands still; the projector answers with the query itself
    and latents of 0, the mean.
    """
    base = model(db, latents=latents or 1)
    vectors = base.layout.pack(db).astype(np.float64)
    mean = vectors.mean(axis=0)
    _, sizes, axes = np.linalg.svd(vectors - mean, full_matrices=False)
    count = latents or int(np.sum(sizes > 1e-5 * sizes[0]))
    axes, features = axes[:count], db.schema.size
    rest = compressor_inputs(db, slice(0, 1)).shape[1] - len(mean)
    state = features + count
    echo = np.eye(base.projector.sizes[0], state) * (np.arange(state) < features)
    table = np.concatenate([db.features, (vectors - mean) @ axes.T], axis=1).astype(np.float32)
    return replace(
        base,
        compressor=layer(np.concatenate([axes.T, np.zeros((rest, count))]), -mean @ axes.T),
        decompressor=layer(np.concatenate([np.zeros((features, len(mean))), axes]), mean),
        stepper=layer(-1e-6 * np.eye(state), np.zeros(state)),
        projector=layer(echo, np.zeros(state)),
        state_low=table.min(axis=0),
        state_high=table.max(axis=0),
        state_std=table.std(axis=0),
    )
