"""From a database to a network that a trajectory drives."""

from __future__ import annotations

import os
from importlib import metadata
from typing import Any

from numpy.typing import NDArray

from lmm.locomotion import given_labels
from lmm.locomotion.labelling import DatabaseLabels, labels_of
from lmm.locomotion.model import LocomotionModel
from lmm.mann.model import MannModel
from lmm.pfnn.model import PhaseModel
from mm.database import Database
from mm.description import Description
from motion import config, files

from . import checkpoint, loop, split
from .locomotion_settings import LocomotionTraining
from .machine import check_memory
from .mann import MannData, MannStage
from .mann_settings import MannTraining
from .pfnn import PhaseData, PhaseStage
from .pfnn_settings import PhaseTraining

_KINDS: dict[type[LocomotionTraining], tuple[Any, Any, Any]] = {
    PhaseTraining: (PhaseData, PhaseStage, PhaseModel),
    MannTraining: (MannData, MannStage, MannModel),
}


def train(
    database: Database,
    output: str | os.PathLike[str],
    settings: LocomotionTraining,
    *,
    labels: str | os.PathLike[str] | None = None,
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> LocomotionModel:
    """Train the network of a database that settings are of, and write the model to output.

    labels is a folder of labels to take in place of those found (`lmm.locomotion.given_labels`). Beside
    output stand a log, and a checkpoint until the model is written. Errors: see `loop.run`,
    `split.held_out`, `lmm.locomotion.labelling.labels_of` and `given_labels.read`.
    """
    data_type, stage_type, model_type = _KINDS[type(settings)]
    split.held_out(database, settings)  # what is too small says so before the work
    given = None if labels is None else given_labels.read(labels, database)
    found = labels_of(database, phase=isinstance(settings, PhaseTraining), given=given)
    held_out = split.held_out(database, settings, left_out=found.left_out)
    data = data_type(database, found, held_out)
    check_memory(data.memory())
    stage = stage_type(data, settings)
    told = {"labels": len(given or {}), "left_out": list(found.left_out)}
    outcome = loop.run(
        [stage],
        settings,
        output,
        database=_fingerprint(database, found) if given else database.fingerprint,
        resume=resume,
        tensorboard=tensorboard,
    )
    trained: LocomotionModel = model_type(
        description=Description.of(database),
        network=stage.network.network(),
        contacts=found.names,
        held_out=held_out,
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"settings": config.to_dict(settings), "version": metadata.version("motion-matching")}
        | {name: value for name, value in told.items() if value},
        errors=dict(outcome.errors),
    )
    trained.save(output)
    checkpoint.remove(checkpoint.path_of(output))
    return trained


def _fingerprint(database: Database, labels: DatabaseLabels) -> str:
    """Of a database with labels that were given: another one where they differ."""
    arrays: dict[str, NDArray] = {"contacts": labels.contacts, "gait": labels.gait}
    if labels.phase is not None:
        arrays["phase"] = labels.phase
    return files.fingerprint(arrays, {"database": database.fingerprint, "names": list(labels.names)})
