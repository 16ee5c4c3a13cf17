"""From a database to a model: all stages, one after another."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from lmm.model import Model
from mm.database import Database
from mm.description import Description
from mm.queries import SETTINGS
from motion import config
from motion.errors import UserError

from . import checkpoint, loop, split
from .checkpoint import Errors
from .closed_loop import ClosedLoopStage
from .data import Data, spread
from .decompressor import DecompressorStage
from .machine import check_memory, version
from .projector import KINDS, ProjectorStage, kinds
from .settings import Settings
from .stage import Stage
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

    Compressor with Decompressor, then Stepper, then Projector, and that once more in the closed loop where
    the settings say so. Beside output stand a log, and a checkpoint until the model is written. Errors: see
    `loop.run` and `split.held_out`.
    """
    data = Data(database, _held_out(database, settings))
    check_memory(data.memory())
    first = DecompressorStage(data, settings)
    second, third = StepperStage(data, settings, first), ProjectorStage(data, settings, first)
    stages: list[Stage] = [first, second, third]

    def model(errors: Mapping[str, Errors]) -> Model:
        return _model(data, settings, first, second, third, errors)

    if settings.closed_loop is not None:
        stages.append(ClosedLoopStage(data, settings, settings.closed_loop, third, lambda: model({})))
    outcome = loop.run(
        stages,
        settings,
        output,
        database=database.fingerprint,
        held_out=data.held_out,
        resume=resume,
        tensorboard=tensorboard,
    )
    trained = model(outcome.errors)
    trained.save(output)
    checkpoint.remove(checkpoint.path_of(output))
    return trained


def _held_out(database: Database, settings: Settings) -> tuple[str, ...]:
    """Clips to hold out; searches among the others find crouched frames and upright ones, where there are."""
    found = kinds(database)
    names = split.held_out(database, settings, kinds=found)
    missing = set(KINDS.values()).difference(*found.values())
    if len(missing) == len(KINDS) or (missing and Description.of(database, rigs=False).crouch_tag):
        ends = f"not searched, {round(SETTINGS.ignore_end * database.fps)} frames"
        what = f"all {missing.pop()} lie in ends of clips that are {ends}"
        if missing:
            what = f"no clip is longer than its end that is {ends}"
        raise UserError(f"too small a database: {what}", remedy="build one of longer clips")
    return names


def _model(
    data: Data,
    settings: Settings,
    first: DecompressorStage,
    second: StepperStage,
    third: ProjectorStage,
    errors: Mapping[str, Errors],
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
        state_std=spread(states)[1],
        held_out=data.held_out,
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"settings": config.to_dict(settings), "version": version()},
        errors=dict(errors),
    )
