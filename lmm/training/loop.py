"""Trains stages one after another: steps, averages, log, checkpoints, and going on from one."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from motion import config, console, files
from motion.errors import UserError

from . import checkpoint as checkpoints
from . import log as logs
from .checkpoint import Checkpoint, Errors
from .machine import facts, machine
from .settings import Settings, StageSettings

SMOOTHING = 100  # iterations that a logged loss is averaged over
SHOWN = 4  # terms of the loss


class Stage(Protocol):
    """One training among several: what is trained, on what, towards what.

    modules, all of the same names and sizes, are there from the beginning; what they hold counts from `begin`
    on. What loss, begin and evaluate give must depend on the weights, the settings and their arguments alone
    (`lmm.training.randomness`): then a training that goes on from a checkpoint ends as one never stopped.
    """

    name: str
    settings: StageSettings

    def modules(self) -> Mapping[str, nn.Module]:
        """What is trained, by name."""
        ...

    def begin(self) -> None:
        """Called once before the first iteration, also of a resumed training. Stages before this one are
        done, their modules hold the final weights."""
        ...

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        """Weighted terms, of which the sum is made small, of the batch of an iteration, counted from 0."""
        ...

    def evaluate(self) -> Errors:
        """Errors by part of the data, "training" and "held_out", by name; ``error_cm`` is shown to the user.
        The modules hold what the training would end with now."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What a training came to: errors as last evaluated, by stage; seconds of training."""

    errors: dict[str, Errors]
    seconds: float


def run(
    stages: Sequence[Stage],
    settings: Settings,
    output: str | os.PathLike[str],
    *,
    database: str,
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
    resume : go on from the checkpoint, to the very end that a training never stopped comes to. Other
        settings, another database, version or number of threads are a UserError.
    tensorboard : folder to log into as well.

    Raises
    ------
    UserError : a loss, an error or a weight is not finite: names stage, iteration and term. The last
        checkpoint, which is good, stays. Also where something cannot be written.
    """
    with machine(settings), _patience(checkpoints.path_of(output)) as stop:
        trainer = _Trainer(stages, settings, Path(output), database, stop, tensorboard)
        with contextlib.closing(trainer):
            return trainer.run(resume)


class _Trainer:
    """The training of all stages: what is done, under way and to come."""

    def __init__(
        self,
        stages: Sequence[Stage],
        settings: Settings,
        output: Path,
        database: str,
        stop: _Stop,
        tensorboard: str | os.PathLike[str] | None,
    ) -> None:
        self._stages, self._settings, self._database = stages, settings, database
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
        point.check(self._path, config.to_dict(self._settings), self._database, facts(self._settings))
        with files.content_of(self._path, checkpoints.KIND):
            self._errors, self._seconds = dict(point.errors), point.seconds
            for stage in self._stages:
                if stage.name in self._errors:
                    prefix = f"done.{stage.name}."
                    self._done |= {n: a for n, a in point.arrays.items() if n.startswith(prefix)}
                    _put(_weights(stage), point.arrays, prefix)
                    for module in stage.modules().values():
                        module.to(self._settings.device).eval()
        return point

    def _train(self, place: int, stage: Stage, point: Checkpoint | None) -> None:
        begun = time.monotonic()
        stage.begin()
        state = _State(stage, self._settings.device)
        if point is not None and point.iteration:
            with files.content_of(self._path, checkpoints.KIND):
                state.restore(point)
        if self._tensorboard is not None:
            purge = state.iteration + 1 if point else None
            self._board = logs.Board(self._tensorboard, stage.name, purge=purge)
        self._seconds += time.monotonic() - begun

        self._stop.waits = True
        iterations, saved = stage.settings.iterations, time.monotonic()
        label = f"{stage.name} ({place + 1} of {len(self._stages)})"
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
        self._done |= {f"done.{stage.name}.{n}": _array(t) for n, t in state.weights.items()}
        following = self._stages[place + 1].name if place + 1 < len(self._stages) else ""
        self._write(Checkpoint(stage=following, iteration=0, loss={}, arrays=self._done, **self._common()))
        self._stop.waits = False
        if self._board is not None:
            self._board.close()
            self._board = None
        print(f"{label}: {iterations:,} iterations done; {state.told()}", file=sys.stderr, flush=True)
        if self._stop.asked and following:
            raise KeyboardInterrupt(f"stopped after the {stage.name}; give --resume to go on from there")

    def _evaluate(self, state: _State) -> None:
        """Find the errors at the averaged weights, and log them."""
        with state.averaged():
            found = state.stage.evaluate()
        for part, errors in found.items():
            for name, value in errors.items():
                _check_finite(state, f"{name} ({part})", value)
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

    def _save(self, state: _State) -> None:
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
        }


class _State:
    """A stage under way: its modules, their averages and the optimiser after some iterations."""

    def __init__(self, stage: Stage, device: str) -> None:
        self.stage, self.iteration = stage, 0
        self.loss: dict[str, float] = {}
        self.errors: Errors = {}
        self.weights = _weights(stage)
        self._modules = list(stage.modules().values())
        named = {
            f"{prefix}.{name}": parameter
            for prefix, module in stage.modules().items()
            for name, parameter in module.named_parameters()
            if parameter.requires_grad
        }
        self._names, self._parameters = list(named), list(named.values())
        self._optimiser = optimiser(stage.settings, self._parameters)
        self._averages = [p.detach().clone() for p in self._parameters] if stage.settings.average else []

    def step(self) -> None:
        """One iteration: what is not finite stops before it does harm."""
        settings = self.stage.settings
        for module in self._modules:
            module.train()
        for group in self._optimiser.param_groups:
            group["lr"] = rate(settings, self.iteration)
        terms = self.stage.loss(self.iteration)
        stacked = torch.stack(list(terms.values()))
        values = stacked.detach().tolist()
        for name, value in zip(terms, values, strict=True):
            _check_finite(self, f"the term {name}", value)
        self._optimiser.zero_grad(set_to_none=True)
        stacked.sum().backward()
        if settings.clip:
            length = float(nn.utils.clip_grad_norm_(self._parameters, settings.clip))
            _check_finite(self, "the gradient", length)
        self._optimiser.step()
        self._smooth(dict(zip(terms, values, strict=True)))
        self._average()
        self.iteration += 1

    def _smooth(self, values: dict[str, float]) -> None:
        share = 1 / min(self.iteration + 1, SMOOTHING)
        for name, value in values.items():
            before = self.loss.get(name, value)
            self.loss[name] = before + share * (value - before)

    def _average(self) -> None:
        """Averages follow the weights, faster in the beginning, so that the first weights are forgotten."""
        if self._averages:
            decay = min(self.stage.settings.average, (1 + self.iteration) / (10 + self.iteration))
            with torch.no_grad():
                for average, parameter in zip(self._averages, self._parameters, strict=True):
                    average.lerp_(parameter, 1 - decay)

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """The modules as they are judged: with averaged weights, in evaluation mode, without gradients."""
        for module in self._modules:
            module.eval()
        with torch.no_grad():
            own = [p.clone() for p in self._parameters] if self._averages else []
            self._take(self._averages)
            yield
            self._take(own)

    def finish(self) -> None:
        """The averaged weights become the weights."""
        with torch.no_grad():
            self._take(self._averages)
        for module in self._modules:
            module.eval()
        self.check()

    def _take(self, values: Sequence[Tensor]) -> None:
        for parameter, value in zip(self._parameters, values or self._parameters, strict=True):
            if value is not parameter:
                parameter.copy_(value)

    def check(self) -> None:
        """A UserError unless all weights are finite: no checkpoint is to hold others."""
        for name, parameter in zip(self._names, self._parameters, strict=True):
            _check_finite(self, f"the weights {name}", float(parameter.detach().sum()))

    def told(self) -> str:
        """Loss, its largest terms, and of each part of the data the error that counts most, on one line."""
        largest = sorted(self.loss.items(), key=lambda item: -item[1])[:SHOWN]
        terms = [f"{name} {value:.3g}" for name, value in largest] + ["..."] * (len(self.loss) > SHOWN)
        parts = [f"loss {sum(self.loss.values()):.4g} ({', '.join(terms)})"]
        for part, found in self.errors.items():
            name = "error_cm" if "error_cm" in found else next(iter(found), None)
            if name is not None:
                value, unit = found[name], " cm" if name.endswith("_cm") else ""
                parts.append(f"{part.replace('_', ' ')} {name.removesuffix('_cm')} {value:.3g}{unit}")
        return ", ".join(parts)

    def arrays(self) -> dict[str, NDArray]:
        """All of it, for a checkpoint."""
        found = {f"weights.{name}": _array(tensor) for name, tensor in self.weights.items()}
        for name, average in zip(self._names, self._averages or (), strict=bool(self._averages)):
            found[f"averages.{name}"] = _array(average)
        for i, entries in self._optimiser.state_dict()["state"].items():
            for key, value in entries.items():
                found[f"optimiser.{self._names[i]}.{key}"] = _array(torch.as_tensor(value))
        return found

    def restore(self, point: Checkpoint) -> None:
        """Take over a checkpoint; a LookupError or ValueError where it does not fit."""
        self.iteration, self.loss = point.iteration, dict(point.loss)
        _put(self.weights, point.arrays, "weights.")
        if self._averages:
            _put(dict(zip(self._names, self._averages, strict=True)), point.arrays, "averages.")
        state: dict[int, dict[str, Tensor]] = {}
        for i, (name, parameter) in enumerate(zip(self._names, self._parameters, strict=True)):
            prefix = f"optimiser.{name}."
            state[i] = {}
            for key in [n.removeprefix(prefix) for n in point.arrays if n.startswith(prefix)]:
                array = torch.from_numpy(np.array(point.arrays[prefix + key]))
                state[i][key] = array.reshape(()) if key == "step" else array.reshape(parameter.shape)
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": state, "param_groups": groups})


def optimiser(settings: StageSettings, parameters: Sequence[nn.Parameter]) -> torch.optim.Optimizer:
    """The optimiser of a stage (see `StageSettings`)."""
    start = settings.learning_rate
    if settings.optimiser == "radam":
        return torch.optim.RAdam(parameters, lr=start)
    if settings.optimiser == "adamw":
        return torch.optim.AdamW(parameters, lr=start, weight_decay=1e-3, amsgrad=True, fused=True)
    return torch.optim.Adam(parameters, lr=start, fused=True)


def rate(settings: StageSettings, iteration: int) -> float:
    """The learning rate of an iteration, counted from 0 (see `StageSettings`)."""
    rising = settings.warm_up * settings.iterations
    warm = min(1.0, (iteration + 1) / max(rising, 1))
    if settings.schedule == "step":
        return settings.learning_rate * warm * 0.99 ** (iteration // 1000)
    share = max(iteration - rising, 0) / max(settings.iterations - rising, 1)
    return settings.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * share))


def _weights(stage: Stage) -> dict[str, Tensor]:
    """Parameters and buffers of all modules, by name; what is written into them counts."""
    return {
        f"{prefix}.{name}": tensor
        for prefix, module in stage.modules().items()
        for name, tensor in module.state_dict().items()
    }


def _put(tensors: Mapping[str, Tensor], arrays: Mapping[str, NDArray], prefix: str) -> None:
    """Write arrays into tensors in place: their memory, and how it is aligned, stays."""
    for name, tensor in tensors.items():
        array = torch.from_numpy(np.array(arrays[prefix + name]))
        with torch.no_grad():
            tensor.copy_(array.reshape(tensor.shape))


def _array(tensor: Tensor) -> NDArray:
    # A copy: of weights in memory shared with the processor, numpy would see what becomes of them.
    return tensor.detach().cpu().numpy().copy()


def _check_finite(state: _State, what: str, value: float) -> None:
    if not math.isfinite(value):
        raise UserError(
            f"{state.stage.name}, iteration {state.iteration:,}: {what} is {value}",
            remedy="the last good checkpoint, if any, stays; train with a lower learning_rate, or with clip",
        )


def _before(point: Checkpoint) -> Any:
    """Whether a line of the log was written before a checkpoint."""

    def keep(record: logs.Record) -> bool:
        stage = record["stage"]
        return stage in point.errors or (stage == point.stage and record["iteration"] <= point.iteration)

    return keep


@dataclass
class _Stop:
    """What Ctrl-C asks for: to stop at once or, where it waits, after the iteration."""

    asked: bool = False
    waits: bool = False


@contextlib.contextmanager
def _patience(path: Path) -> Iterator[_Stop]:
    """Ctrl-C is noted where stopping waits; elsewhere, and a second time, it stops at once."""
    stop = _Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: Any) -> None:
        if stop.asked or not stop.waits:
            known = "; give --resume to go on from the last checkpoint" if path.is_file() else ""
            raise KeyboardInterrupt(f"stopped at once{known or ', before the first checkpoint'}")
        stop.asked = True

    signal.signal(signal.SIGINT, note)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
