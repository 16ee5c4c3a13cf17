"""Which models stand for which of the thesis's configurations, and training of those that are missing."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.models import go_on
from lmm import models
from lmm.pfnn.model import PhaseModel
from mm.database import Database
from mm.enlarged import JOINTS, enlarged
from motion import console
from motion.errors import UserError

from .published import CONFIGURATIONS

if TYPE_CHECKING:
    from lmm.training.pfnn_settings import PhaseTraining

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class Row:
    """A configuration's model, and the database that it is judged on: AVA's has the joints of a large rig."""

    name: str
    path: Path
    model: PhaseModel
    database: Database


class Databases:
    """A database, and those of rigs of any size made of it; the last of these is kept, they are large."""

    def __init__(self, database: Database) -> None:
        self.database = database
        self._large: Database | None = None

    def of(self, joints: int) -> Database:
        """The one of so many joints."""
        if joints <= len(self.database.skeleton):
            return self.database
        if self._large is None or len(self._large.skeleton) != joints:
            self._large = enlarged(self.database, joints)
        return self._large


def placed(paths: Sequence[PathLike], databases: Databases) -> dict[str, Row]:
    """Rows of models by configuration, in its order.

    Who has more joints than the database is AVA. Of the others the training tells, or else the number of
    layers. Models of another kind, of other data, and two for one configuration are UserErrors.
    """
    found: dict[str, Row] = {}
    for path in paths:
        model = models.load(path)
        if not isinstance(model, PhaseModel):
            what = f"a model of {models.TITLES[models.kind_of(model)]}"
            raise UserError(what, path=path, remedy="give phase-functioned networks")
        database = databases.of(len(model.description.skeleton))
        model.check(database, path)
        name = configuration(model, large=database is not databases.database)
        if name in found:
            what = f"a second model for {name}"
            raise UserError(what, path=path, remedy=f"leave it or {found[name].path} out")
        found[name] = Row(name, Path(path), model, database)
    return {name: found[name] for name in CONFIGURATIONS if name in found}


def configuration(model: PhaseModel, *, large: bool) -> str:
    """What the thesis calls such a network."""
    if large:
        return "AVA"
    told = str(model.training.get("settings", {}).get("configuration", "")).upper()
    if told in ("HOLDEN-XL", "HOLDEN-XT"):
        return told
    return "HOLDEN-XL" if len(model.network.weights) > 3 else "HOLDEN"


def path_of(folder: PathLike, name: str) -> Path:
    """Where the model of a configuration that was not given is trained to."""
    return Path(folder, f"{name.lower()}.pfnn")


@console.needs("train", "torch")
def train(
    databases: Databases,
    name: str,
    folder: PathLike,
    *,
    preset: str = "quick",
    note: Callable[[str], None] | None = None,
    settings: Callable[[PhaseTraining], PhaseTraining] | None = None,
) -> Path:
    """Train a configuration's model into a folder, or go on with it; one that is there already stays.

    settings changes those of the preset.
    """
    from lmm.training import pfnn_settings

    path = path_of(folder, name)
    if path.is_file():
        return path
    if note:
        note(f"{name} is trained: {path}")
    asked: Any = pfnn_settings.preset("ours", preset, name.lower())
    if settings is not None:
        asked = settings(asked)
    database = _large(databases, folder) if name == "AVA" else databases.database
    go_on(database, path, asked)
    return path


def _large(databases: Databases, folder: PathLike) -> Database:
    """The database of a large rig from a file in a folder, which a training goes on from after a stop."""
    path = Path(folder, "ava.mmdb")
    if not path.is_file():
        databases.of(JOINTS).save(path)
    return Database.load(path)
