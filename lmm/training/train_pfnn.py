"""From a database to a phase-functioned network."""

from __future__ import annotations

import os
from importlib import metadata

from lmm.pfnn.labelling import labels_of
from lmm.pfnn.model import PhaseModel
from mm.database import Database
from mm.description import Description
from motion import config

from . import checkpoint, loop, split
from .machine import check_memory
from .pfnn import PhaseData, PhaseStage, memory
from .pfnn_settings import PhaseTraining


def train(
    database: Database,
    output: str | os.PathLike[str],
    settings: PhaseTraining,
    *,
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> PhaseModel:
    """Train the network of a database, and write the model to output.

    Beside output stand a log, and a checkpoint until the model is written. Errors: see `loop.run`,
    `split.held_out` and `lmm.pfnn.labelling.labels_of`.
    """
    held_out = split.held_out(database, settings)
    labels = labels_of(database)
    check_memory(memory(database, len(labels.names)))
    stage = PhaseStage(PhaseData(database, labels, held_out), settings)
    outcome = loop.run(
        [stage],
        settings,
        output,
        database=database.fingerprint,
        resume=resume,
        tensorboard=tensorboard,
    )
    trained = PhaseModel(
        description=Description.of(database),
        network=stage.network.network(),
        contacts=labels.names,
        held_out=held_out,
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"settings": config.to_dict(settings), "version": metadata.version("motion-matching")},
        errors=dict(outcome.errors),
    )
    trained.save(output)
    checkpoint.remove(checkpoint.path_of(output))
    return trained
