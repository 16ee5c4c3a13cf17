"""From a database to a model: the three stages in turn."""

from __future__ import annotations

import os

from lmm.model import Model
from mm.database import Database

from .settings import Settings


def train(
    database: Database,
    output: str | os.PathLike[str],
    settings: Settings,
    *,
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> Model:
    """Train a model and write it; beside it stand its log and, until it is written, a checkpoint."""
    raise NotImplementedError
