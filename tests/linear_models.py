"""Learned models fitted in closed form: networks of one layer, and yet poses within millimetres."""

from __future__ import annotations

import numpy as np

from lmm.frames import compressor_inputs
from lmm.layout import Layout
from lmm.model import Model
from lmm.network import Network
from mm.database import Database
from mm.description import Description

LATENTS = 40


def fitted(db: Database, *, latents: int = LATENTS) -> Model:
    """Latents are the main components of the poses' vectors; the rest is least squares."""
    description = Description.of(db)
    vectors = Layout(len(db.skeleton), len(db.contact_roles)).pack(db).astype(np.float64)
    mean, spread = vectors.mean(axis=0), vectors.std(axis=0)
    spread = np.where(spread > 1e-4, spread, 1e6)
    axes = np.linalg.eigh(np.cov((vectors - mean) / spread, rowvar=False))[1].T[::-1]
    seen = compressor_inputs(db, slice(0, 1)).shape[1]
    weight = np.zeros((seen, latents))
    weight[: len(mean)] = axes[:latents].T / spread[:, None]
    compressor = _linear(weight, -(mean / spread) @ axes[:latents].T)
    codes = compressor.evaluate(compressor_inputs(db)).astype(np.float64)
    features = db.features.astype(np.float64)
    states = np.concatenate([features, codes], axis=1)
    inner = np.setdiff1d(np.arange(len(db)), db.stops - 1)
    rates = (states[inner + 1] - states[inner]) * db.fps
    crouch = np.zeros((len(db), 0))
    if description.crouch_tag:
        crouch = ((db.tags & np.uint32(description.crouch_tag)) != 0)[:, None].astype(np.float64)
    return Model(
        description=description,
        decompressor=_least_squares(states, vectors),
        stepper=_least_squares(states[inner], rates),
        projector=_least_squares(np.concatenate([features, crouch], axis=1), states),
        compressor=compressor,
        state_low=states.min(axis=0).astype(np.float32),
        state_high=states.max(axis=0).astype(np.float32),
        state_std=states.std(axis=0).astype(np.float32),
        database=db.fingerprint,
        ranges=len(db.starts),
        frames=len(db),
    )


def _least_squares(x: np.ndarray, y: np.ndarray) -> Network:
    ones = np.ones((len(x), 1))
    square = np.concatenate([x, ones], axis=1)
    solved = np.linalg.solve(square.T @ square + 1e-3 * np.eye(square.shape[1]), square.T @ y)
    return _linear(solved[:-1], solved[-1])


def _linear(weight: np.ndarray, bias: np.ndarray) -> Network:
    inputs, outputs = weight.shape
    zeros, ones = np.zeros(inputs, np.float32), np.ones(inputs, np.float32)
    return Network(
        zeros,
        ones,
        np.zeros(outputs, np.float32),
        np.ones(outputs, np.float32),
        (weight.astype(np.float32),),
        (None,),
        (bias.astype(np.float32),),
    )
