"""Where a training stands, in one file, so that one that was stopped can go on as if it had not been."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import files
from motion.errors import UserError

from .settings import BEGUN_AS

KIND, VERSION = "training checkpoint", 1
FREE = ("checkpoint_seconds",)  # settings that change nothing in what comes out
SHOWN = 3

Errors = dict[str, dict[str, float]]


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A training between two iterations.

    Attributes
    ----------
    stage : under way; empty when all are done.
    iteration : how many of it are done.
    seconds : of training so far.
    loss : terms of the stage's loss, averaged as the log has them.
    errors : of the stages that are done, as last evaluated.
    settings : of the training, as plain data.
    database : fingerprint of the database.
    machine : versions, threads and device: what results depend on.
    held_out : names of the clips that are not trained on, which another version may choose otherwise; None
        where it did not say.
    arrays : weights of finished stages; of the stage under way weights, averages and the optimiser's state.
    """

    stage: str
    iteration: int
    seconds: float
    loss: dict[str, float]
    errors: dict[str, Errors]
    settings: dict[str, Any]
    database: str
    machine: dict[str, Any]
    held_out: list[str] | None = None
    arrays: dict[str, NDArray] = field(repr=False)

    def save(self, path: Path) -> None:
        """Write atomically; where that fails, as on a full disk, the one before stays."""
        metadata = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "arrays"}
        try:
            files.save(path, KIND, VERSION, metadata, self.arrays)
        except UserError as error:
            before = "the last checkpoint stays; make room and give --resume"
            remedy = before if path.is_file() else "make room and begin anew"
            raise UserError(error.what, path=error.path, remedy=remedy) from error

    @staticmethod
    def load(path: Path) -> Checkpoint:
        """Read one. Errors: see `motion.files.load`."""
        if files.kind(path) is None:
            done = files.kind(path.with_suffix("")) == "file"
            what = "there is no checkpoint to go on from" + ", the model is there already" * done
            raise UserError(what, path=path, remedy=f"begin{' anew' * done} without --resume")
        try:
            metadata, arrays, _ = files.load(path, KIND, VERSION)
        except UserError as error:
            raise UserError(error.what, path=path, remedy="remove the file to begin anew") from error
        with files.content_of(path, KIND):
            for key in ("format", "version"):
                metadata.pop(key)
            # Copies: a mapped file would keep its room on the disk when the next checkpoint takes its place.
            return Checkpoint(**metadata, arrays={name: np.array(array) for name, array in arrays.items()})

    def check(
        self,
        path: Path,
        settings: dict[str, Any],
        database: str,
        machine: dict[str, Any],
        held_out: Sequence[str] = (),
    ) -> None:
        """A UserError that names what differs from how the training was begun."""
        anew = "or remove the file to begin anew"
        if self.database != database:
            what = f"a training of another database ({self.database[:8]}, this is {database[:8]})"
            remedy = f"give the one it was begun with, its --labels and --terrain if it had any, {anew}"
            raise UserError(what, path=path, remedy=remedy)
        told = differences(self.settings, settings)
        told = {name: both for name, both in told.items() if name not in FREE}
        if told:
            what = f"a training of other settings: {_listed(told)}"
            raise UserError(what, path=path, remedy=f"give those it was begun with, {anew}")
        told = differences(self.machine, machine)
        if told:
            what = f"a training of another machine or version: {_listed(told)}"
            raise UserError(what, path=path, remedy=f"go on as it was begun, {anew}")
        if self.held_out is not None and sorted(self.held_out) != sorted(held_out):
            what = "a training of other clips held out, which this version of the program chooses otherwise"
            raise UserError(what, path=path, remedy=f"go on as it was begun, {anew}")


def differences(one: dict[str, Any], other: dict[str, Any], prefix: str = "") -> dict[str, tuple[Any, Any]]:
    """Dotted names of the keys in which plain data differ, with both values."""
    found: dict[str, tuple[Any, Any]] = {}
    for key in one | other:
        here, there = one.get(key), other.get(key)
        if isinstance(here, dict) and isinstance(there, dict):
            found |= differences(here, there, f"{prefix}{key}.")
        elif here != there:
            found[prefix + key] = here, there
    return found


def _listed(told: dict[str, tuple[Any, Any]]) -> str:
    """The first differences, and before all those that others follow from."""
    names = sorted(told, key=lambda name: name not in BEGUN_AS)
    first = [f"{name} was {_brief(told[name][0])}, is {_brief(told[name][1])}" for name in names[:SHOWN]]
    return ", ".join(first) + f" and {len(told) - SHOWN} more" * (len(told) > SHOWN)


def _brief(value: Any) -> str:
    return "given" if isinstance(value, dict) else "none" if value is None else str(value)


def path_of(output: str | os.PathLike[str]) -> Path:
    """Where the checkpoint of a model's training stands."""
    return Path(f"{os.fspath(output)}.checkpoint")


def begin_anew(path: Path) -> None:
    """A UserError where a training that was stopped could go on instead."""
    if files.kind(path) is not None:
        what = "a training of this model was stopped here"
        raise UserError(what, path=path, remedy="go on with --resume, or remove the file to begin anew")


def remove(path: Path) -> None:
    """Remove the checkpoint of a training that is done, and what a killed one left half-written."""
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
    clean(path)


def clean(path: Path) -> None:
    """Remove half-written checkpoints beside path, which a killed training leaves."""
    with contextlib.suppress(OSError):
        for found in path.parent.iterdir():
            if found.name.startswith(files.half_written(path)):
                found.unlink(missing_ok=True)
