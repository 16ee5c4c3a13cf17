"""How weights are moved: the optimiser of a stage, and its learning rate in each iteration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import nn

from .settings import StageSettings


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
    if settings.schedule == "constant":
        return settings.learning_rate * warm
    if settings.schedule == "step":
        return settings.learning_rate * warm * 0.99 ** (iteration // 1000)
    share = max(iteration - rising, 0) / max(settings.iterations - rising, 1)
    return settings.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * share))
