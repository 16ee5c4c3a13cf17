"""Trains stages one after another: when to step, log, save and stop, and how to go on from a checkpoint."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from motion import config, console, files

from . import checkpoint as checkpoints
from . import log as logs
from .checkpoint import Checkpoint, Errors
from .machine import facts, machine
from .optimiser import rate
from .patience import Stop, patience
from .settings import Common
from .stage import Stage
from .state import State, array_of, check_finite, put, weights_of


@dataclass(frozen=True)
class Outcome:
    """What a training came to: errors as last evaluated, by stage; seconds of training."""

    errors: dict[str, Errors]
    seconds: float


def run(
    stages: Sequence[Stage],
    settings: Common,
    output: str | os.PathLike[str],
    *,
    database: str,
    held_out: Sequence[str] = (),
    resume: bool = False,
    tensorboard: str | os.PathLike[str] | None = None,
) -> Outcome:
    """Train the stages in turn; their modules hold the final weights after it.

    Beside output, which is left to the caller, stand a log (`lmm.training.log`) and, until the caller has
    written output and calls `lmm.training.checkpoint.remove`, a checkpoint. Ctrl-C writes one and raises
    KeyboardInterrupt that says how to go on; while a stage begins it stops at once, for nothing is lost then.

    Parameters
    ----------
    database : fingerprint of what the stages are trained on.
    held_out : names of clips of it that they are not trained on.
    resume : go on from the checkpoint, to the very end that a training never stopped comes to. Other
        settings, another database, version or number of threads are a UserError, other clips held out too.
    tensorboard : folder to log into as well.

    Raises
    ------
    UserError : a loss, an error or a weight is not finite: names stage, iteration and term. The last
        checkpoint, which is good, stays. Also where something cannot be written.
    """
    with machine(settings), patience(checkpoints.path_of(output)) as stop:
        trainer = _Trainer(stages, settings, Path(output), database, held_out, stop, tensorboard)
        with contextlib.closing(trainer):
            return trainer.run(resume)


class _Trainer:
    """The training of all stages: what is done, under way and to come."""

    def __init__(
        self,
        stages: Sequence[Stage],
        settings: Common,
        output: Path,
        database: str,
        held_out: Sequence[str],
        stop: Stop,
        tensorboard: str | os.PathLike[str] | None,
    ) -> None:
        self._stages, self._settings = stages, settings
        self._database, self._held_out = database, list(held_out)
        self._stop, self._tensorboard = stop, tensorboard
        self._path, self._log_path = checkpoints.path_of(output), logs.path_of(output)
        self._errors: dict[str, Errors] = {}
        self._done: dict[str, NDArray] = {}  # weights of finished stages
        self._seconds = 0.0
        self._log: logs.Log | None = None
        self._board: logs.Board | None = None

    def close(self) -> None:
        for opened in (self._log, self._board):
            if opened is not None:
                opened.close()

    def run(self, resume: bool) -> Outcome:
        for path in (self._path, self._log_path):
            files.check_output(path)
        logs.check_free(self._log_path)
        if self._tensorboard is not None:
            logs.check_board(self._tensorboard)
        point = self._resumed() if resume else None
        if point is None:
            checkpoints.begin_anew(self._path)
        self._log = logs.Log(self._log_path, keep=None if point is None else _before(point))
        checkpoints.clean(self._path)
        for place, stage in enumerate(self._stages):
            if stage.name not in self._errors:
                self._train(place, stage, point if point and point.stage == stage.name else None)
        return Outcome(self._errors, self._seconds)

    def _resumed(self) -> Checkpoint:
        """The checkpoint to go on from; stages that are done get their weights."""
        point = Checkpoint.load(self._path)
        mine = config.to_dict(self._settings), self._database, facts(self._settings), self._held_out
        point.check(self._path, *mine)
        with files.content_of(self._path, checkpoints.KIND):
            self._errors, self._seconds = dict(point.errors), point.seconds
            for stage in self._stages:
                if stage.name in self._errors:
                    prefix = f"done.{stage.name}."
                    self._done |= {n: a for n, a in point.arrays.items() if n.startswith(prefix)}
                    put(weights_of(stage), point.arrays, prefix)
                    for module in stage.modules().values():
                        module.to(self._settings.device).eval()
        return point

    def _train(self, place: int, stage: Stage, point: Checkpoint | None) -> None:
        begun = time.monotonic()
        stage.begin()
        state = State(stage)
        if point is not None and point.iteration:
            with files.content_of(self._path, checkpoints.KIND):
                state.restore(point)
        if self._tensorboard is not None:
            purge = state.iteration + 1 if point else None
            self._board = logs.Board(self._tensorboard, stage.name, purge=purge)
        self._seconds += time.monotonic() - begun

        self._stop.waits = True
        iterations, saved = stage.settings.iterations, time.monotonic()
        label = f"{stage.name.replace('_', ' ')} ({place + 1} of {len(self._stages)})"
        remaining = range(state.iteration, iterations)
        for _ in console.progress(remaining, label=label, first=state.iteration, note=state.told):
            begun = time.monotonic()
            state.step()
            now = time.monotonic()
            self._seconds += now - begun
            if state.iteration % stage.settings.evaluate == 0 or state.iteration == iterations:
                self._evaluate(state)
            if state.iteration < iterations:
                if self._stop.asked:
                    self._save(state)
                    raise KeyboardInterrupt(
                        f"stopped at iteration {state.iteration:,} of the {stage.name}; "
                        "give --resume to go on from there"
                    )
                if now - saved >= self._settings.checkpoint_seconds:
                    self._save(state)
                    saved = time.monotonic()
        state.finish()
        self._errors[stage.name] = state.errors
        self._done |= {f"done.{stage.name}.{n}": array_of(t) for n, t in state.weights.items()}
        following = self._stages[place + 1].name if place + 1 < len(self._stages) else ""
        self._write(Checkpoint(stage=following, iteration=0, loss={}, arrays=self._done, **self._common()))
        self._stop.waits = False
        if self._board is not None:
            self._board.close()
            self._board = None
        print(f"{label}: {iterations:,} iterations done; {state.told()}", file=sys.stderr, flush=True)
        if self._stop.asked and following:
            raise KeyboardInterrupt(f"stopped after the {stage.name}; give --resume to go on from there")

    def _evaluate(self, state: State) -> None:
        """Find the errors at the averaged weights, and log them."""
        with state.averaged():
            found = state.stage.evaluate()
        for part, errors in found.items():
            for name, value in errors.items():
                check_finite(state, f"{name} ({part})", value)
        record = {
            "stage": state.stage.name,
            "iteration": state.iteration,
            "seconds": round(self._seconds, 3),
            "learning_rate": rate(state.stage.settings, state.iteration - 1),
            "loss": state.loss,
            "errors": found,
        }
        for log in (self._log, self._board):
            if log is not None:
                log.write(record)
        state.errors = found

    def _save(self, state: State) -> None:
        state.check()
        self._write(
            Checkpoint(
                stage=state.stage.name,
                iteration=state.iteration,
                loss=state.loss,
                arrays=self._done | state.arrays(),
                **self._common(),
            )
        )

    def _write(self, point: Checkpoint) -> None:
        if self._log is not None:
            self._log.sync()  # the log must not be behind the checkpoint
        point.save(self._path)

    def _common(self) -> dict[str, Any]:
        return {
            "seconds": self._seconds,
            "errors": dict(self._errors),
            "settings": config.to_dict(self._settings),
            "database": self._database,
            "machine": facts(self._settings),
            "held_out": self._held_out,
        }


def _before(point: Checkpoint) -> Any:
    """Whether a line of the log was written before a checkpoint."""

    def keep(record: logs.Record) -> bool:
        stage = record["stage"]
        return stage in point.errors or (stage == point.stage and record["iteration"] <= point.iteration)

    return keep
