"""A stage under way: steps, averages of the weights, and all of it as a checkpoint holds it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from motion.errors import UserError

from .checkpoint import Checkpoint, Errors
from .optimiser import groups, optimiser
from .stage import Stage

SMOOTHING = 100  # iterations that a logged loss is averaged over
SHOWN = 4  # terms of the loss
LARGEST = 1e12  # loss, error, gradient or sum of weights


class State:
    """A stage under way: its modules, their averages and the optimiser after some iterations."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.iteration = stage, 0
        self.loss: dict[str, float] = {}
        self.errors: Errors = {}
        self.weights = weights_of(stage)
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
            group.update(groups(settings, self.iteration))
        terms = self.stage.loss(self.iteration)
        stacked = torch.stack(list(terms.values()))
        values = stacked.detach().tolist()
        for name, value in zip(terms, values, strict=True):
            check_finite(self, f"the term {name}", value)
        self._optimiser.zero_grad(set_to_none=True)
        stacked.sum().backward()
        if settings.clip:
            length = float(nn.utils.clip_grad_norm_(self._parameters, settings.clip))
            check_finite(self, "the gradient", length)
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
            check_finite(self, f"the weights {name}", float(parameter.detach().sum()))

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
        found = {f"weights.{name}": array_of(tensor) for name, tensor in self.weights.items()}
        for name, average in zip(self._names, self._averages or (), strict=bool(self._averages)):
            found[f"averages.{name}"] = array_of(average)
        for i, entries in self._optimiser.state_dict()["state"].items():
            for key, value in entries.items():
                found[f"optimiser.{self._names[i]}.{key}"] = array_of(torch.as_tensor(value))
        return found

    def restore(self, point: Checkpoint) -> None:
        """Take over a checkpoint; a LookupError or ValueError where it does not fit."""
        self.iteration, self.loss = point.iteration, dict(point.loss)
        put(self.weights, point.arrays, "weights.")
        if self._averages:
            put(dict(zip(self._names, self._averages, strict=True)), point.arrays, "averages.")
        state: dict[int, dict[str, Tensor]] = {}
        for i, (name, parameter) in enumerate(zip(self._names, self._parameters, strict=True)):
            prefix = f"optimiser.{name}."
            state[i] = {}
            for key in [n.removeprefix(prefix) for n in point.arrays if n.startswith(prefix)]:
                array = torch.from_numpy(np.array(point.arrays[prefix + key]))
                state[i][key] = array.reshape(()) if key == "step" else array.reshape(parameter.shape)
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": state, "param_groups": groups})


def weights_of(stage: Stage) -> dict[str, Tensor]:
    """Parameters and buffers of all modules, by name; what is written into them counts."""
    return {
        f"{prefix}.{name}": tensor
        for prefix, module in stage.modules().items()
        for name, tensor in module.state_dict().items()
    }


def put(tensors: Mapping[str, Tensor], arrays: Mapping[str, NDArray], prefix: str) -> None:
    """Write arrays into tensors in place: their memory, and how it is aligned, stays."""
    for name, tensor in tensors.items():
        array = torch.from_numpy(np.array(arrays[prefix + name]))
        with torch.no_grad():
            tensor.copy_(array.reshape(tensor.shape))


def array_of(tensor: Tensor) -> NDArray:
    # A copy: of weights in memory shared with the processor, numpy would see what becomes of them.
    return tensor.detach().cpu().numpy().copy()


def check_finite(state: State, what: str, value: float) -> None:
    """A UserError for what is no number, or one so large that the training has lost all it learned."""
    if not abs(value) <= LARGEST:
        raise UserError(
            f"{state.stage.name}, iteration {state.iteration:,}: {what} is {value:.3g}",
            remedy="the last good checkpoint, if any, stays; train with a lower learning_rate, or with clip",
        )
