"""Models for a comparison: those of a folder that are of its database, and training of those that lack."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from lmm.models import FORMATS, TITLES, TYPES, kind_of
from lmm.training import checkpoint, log
from mm.database import Database
from motion import console, files
from motion.errors import UserError

PathLike = str | os.PathLike[str]
PRESETS = {  # of training, and how long each takes on two cores
    "smoke": "seconds",
    "quick": "up to half an hour",
    "full": "hours",
}


def within(folder: PathLike, database: Database, *, note: Callable[[str], None]) -> list[str]:
    """Files of models in a folder that are of a database, sorted; others are noted. No folder has none."""
    if files.kind(folder) is None:
        return []
    if files.kind(folder) != "folder":
        raise UserError("a file, expected a folder of models", path=folder, remedy="give it with --model")
    out = []
    for path in sorted(Path(folder).iterdir()):
        kind = FORMATS.get(files.format_of(path) or "") if path.is_file() else None
        if kind is None:
            continue
        try:
            TYPES[kind].load(path).check(database, str(path))
        except UserError as error:
            note(f"{path.name} is left out: {error.what}")
        else:
            out.append(str(path))
    return out


def lacking(systems: Sequence[str] | None, models: Iterable[PathLike]) -> list[str]:
    """Kinds of models that systems are asked for of, and that no model is of; of all kinds when None."""
    there = {kind_of(path) for path in models}
    asked = [k for k in TYPES if systems is None or any(name.startswith(k) for name in systems)]
    return [kind for kind in asked if kind not in there]


@console.needs("train", "torch")
def train(database: Database, kind: str, path: PathLike, preset: str, *, note: Callable[[str], None]) -> str:
    """Train a model of a kind with a preset, or go on with it; says beforehand how long that takes."""
    from lmm.training import mann_settings, pfnn_settings, settings

    presets: dict[str, Callable[..., Any]] = {
        "lmm": settings.preset,
        "pfnn": pfnn_settings.preset,
        "mann": mann_settings.preset,
    }
    resume = checkpoint.path_of(path).is_file()
    note(
        f"{TITLES[kind]}: training {'goes on' if resume else 'begins'}, preset {preset}, "
        f"which takes {PRESETS[preset]} on two cores: {path}"
    )
    go_on(database, path, presets[kind]("ours", preset))
    return str(path)


def go_on(database: Database, path: PathLike, asked: Any) -> None:
    """Train by settings, from the checkpoint beside path where there is one."""
    from lmm.training import train, train_locomotion
    from lmm.training.settings import Settings

    module: Any = train if isinstance(asked, Settings) else train_locomotion
    module.train(database, path, asked, resume=checkpoint.path_of(path).is_file())


def training_hours(path: PathLike) -> float | None:
    """As the log beside a model has it."""
    beside = log.path_of(path)
    records = log.read(beside) if beside.is_file() else []
    return float(records[-1]["seconds"]) / 3600 if records else None
