"""From a database to a network that a trajectory drives."""

from __future__ import annotations

import os
import warnings
from typing import Any

from numpy.typing import NDArray

from lmm.locomotion import given_labels, grounds
from lmm.locomotion.grounds import GroundTable, Terrain
from lmm.locomotion.labelling import DatabaseLabels, labels_of
from lmm.locomotion.model import LocomotionModel
from lmm.mann.model import MannModel
from lmm.pfnn.model import PhaseModel
from mm.database import Database
from mm.description import Description
from motion import config, console, files
from motion.errors import Note

from . import checkpoint, loop, split
from .locomotion import HORIZONS
from .locomotion_settings import LocomotionTraining
from .machine import check_memory, version
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
    terrain: Terrain | None = None,
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> LocomotionModel:
    """Train the network of a database that settings are of, and write the model to output.

    labels is a folder of labels to take in place of those found (`lmm.locomotion.given_labels`). terrain is
    what the grounds are of that a phase-functioned network is trained on (`lmm.locomotion.grounds`), level
    ground by default; they are fitted anew, and the same, when a training goes on. Beside output stand a log,
    and a checkpoint until the model is written. Errors: see `loop.run`, `split.held_out`,
    `lmm.locomotion.labelling.labels_of` and `given_labels.read`.
    """
    data_type, stage_type, model_type = _KINDS[type(settings)]
    split.held_out(database, settings)  # what is too small says so before the work
    given = None if labels is None else given_labels.read(labels, database)
    found = labels_of(database, phase=isinstance(settings, PhaseTraining), given=given)
    held_out = split.held_out(database, settings, left_out=found.left_out)
    data = data_type(database, found, held_out)
    told: dict[str, Any] = {"labels": len(given or {}), "left_out": list(found.left_out)}
    if terrain is None:
        check_memory(data.memory())
    else:
        steps = max(settings.stage.window, HORIZONS[-1])
        room = grounds.nbytes(database, found, count=terrain.count, steps=steps)
        check_memory(data.memory() + room)
        fitted = grounds.fit(
            database,
            found,
            terrain,
            steps=steps,
            seed=settings.seed,
            jobs=settings.threads or None,
            progress=console.progress,
        )
        data = data_type(database, found, held_out, fitted)
        told["terrain"] = _about(terrain, fitted)
    stage = stage_type(data, settings)
    outcome = loop.run(
        [stage],
        settings,
        output,
        database=_fingerprint(database, found if given else None, terrain),
        held_out=held_out,
        resume=resume,
        tensorboard=tensorboard,
    )
    trained: LocomotionModel = model_type(
        description=Description.of(database),
        network=stage.network.network(),
        contacts=found.names,
        bounds=data.bounds(),
        held_out=held_out,
        database=database.fingerprint,
        ranges=len(database.starts),
        frames=len(database),
        training={"settings": config.to_dict(settings), "version": version()}
        | {name: value for name, value in told.items() if value},
        errors=dict(outcome.errors),
    )
    trained.save(output)
    checkpoint.remove(checkpoint.path_of(output))
    return trained


def _about(terrain: Terrain, fitted: GroundTable) -> dict[str, Any]:
    """What a model tells of the grounds that it was trained on; who learns little of them is told that."""
    if fitted.level:
        line = (
            "feet rest on level ground only: the network learns that ground may be uneven around them, not "
            "how to go up and down; for that train on motion over hills or steps"
        )
        warnings.warn(line, Note, stacklevel=3)
    names = {"maps": list(terrain.names), "grounds": terrain.count, "level_motion": fitted.level}
    return names | dict(fitted.misfits)


def _fingerprint(database: Database, labels: DatabaseLabels | None, terrain: Terrain | None) -> str:
    """Of a database, with labels that were given and with terrain: another one where they differ."""
    arrays: dict[str, NDArray] = {}
    about: dict[str, Any] = {"database": database.fingerprint}
    if labels is not None:
        arrays |= {"contacts": labels.contacts, "gait": labels.gait}
        about["names"] = list(labels.names)
        if labels.phase is not None:
            arrays["phase"] = labels.phase
    if terrain is not None:
        arrays |= {f"map.{i}": one.heights for i, one in enumerate(terrain.maps)}
        about |= {"spacings": [one.spacing for one in terrain.maps], "grounds": terrain.count}
    return files.fingerprint(arrays, about) if arrays else database.fingerprint
