"""From a database to a model: all stages, one after another."""

from __future__ import annotations

import os
from importlib import metadata

import numpy as np

from lmm.model import Model
from mm.database import Database
from mm.description import Description
from motion import config

from . import checkpoint, loop, split
from .data import Data
from .decompressor import DecompressorStage
from .machine import check_memory
from .projector import ProjectorStage
from .settings import Settings
from .stepper import StepperStage


def train(
    database: Database,
    output: str | os.PathLike[str],
    settings: Settings,
    *,
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> Model:
    """Train the networks of a database, and write the model to output.

    Compressor with Decompressor, then Stepper, then Projector. Beside output stand a log, and a checkpoint
    until the model is written. Errors: see `loop.run` and `split.held_out`.
    """
    data = Data(database, split.held_out(database, settings))
    check_memory(data.memory())
    first = DecompressorStage(data, settings)
    second, third = StepperStage(data, settings, first), ProjectorStage(data, settings, first)
    outcome = loop.run(
        [first, second, third],
        settings,
        output,
        database=database.fingerprint,
        resume=resume,
        tensorboard=tensorboard,
    )
    model = _model(data, settings, first, second, third, outcome)
    model.save(output)
    checkpoint.remove(checkpoint.path_of(output))
    return model


def _model(
    data: Data,
    settings: Settings,
    first: DecompressorStage,
    second: StepperStage,
    third: ProjectorStage,
    outcome: loop.Outcome,
) -> Model:
    database = data.database
    states = np.hstack([data.features, first.latents()])[data.frames["training"]]
    return Model(
        description=Description.of(database),
        decompressor=first.decompressor.network(),
        stepper=second.stepper.network(),
        projector=third.projector.network(),
        compressor=first.compressor.network(),
        state_low=states.min(axis=0),
        state_high=states.max(axis=0),
        state_std=states.std(axis=0),
        held_out=data.held_out,
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"settings": config.to_dict(settings), "version": metadata.version("motion-matching")},
        errors=outcome.errors,
    )
