"""What the training loop asks of what it trains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from torch import Tensor, nn

from .checkpoint import Errors
from .settings import StageSettings


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
