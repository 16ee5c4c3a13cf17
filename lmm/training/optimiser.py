"""How weights are moved: the optimiser of a stage, and its learning rate and decay in each iteration."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

import torch
from torch import nn

from .settings import StageSettings

PERIODS = (1, 2, 4, 8)  # between restarts: 10, 20, 40 and 80 of the published 150 epochs (REFERENCE 5)
NORMALISED_DECAY = 2.5e-3  # of all iterations from one restart to the next, over the root of their number


def optimiser(settings: StageSettings, parameters: Sequence[nn.Parameter]) -> torch.optim.Optimizer:
    """The optimiser of a stage (see `StageSettings`)."""
    start = settings.learning_rate
    if settings.optimiser == "radam":
        return torch.optim.RAdam(parameters, lr=start)
    if settings.optimiser == "adamw":
        return torch.optim.AdamW(parameters, lr=start, weight_decay=1e-3, amsgrad=True, fused=True)
    if settings.optimiser == "adamwr":
        return torch.optim.AdamW(parameters, lr=start, weight_decay=0.0, fused=True)
    return torch.optim.Adam(parameters, lr=start, fused=True)


def rate(settings: StageSettings, iteration: int) -> float:
    """The learning rate of an iteration, counted from 0 (see `StageSettings`)."""
    rising = settings.warm_up * settings.iterations
    warm = min(1.0, (iteration + 1) / max(rising, 1))
    if settings.schedule == "constant":
        return settings.learning_rate * warm
    if settings.schedule == "step":
        return settings.learning_rate * warm * 0.99 ** (iteration // 1000)
    if settings.schedule == "restarts":
        start, stop = period(settings, iteration)
        share = (iteration - start) / (stop - start)
    else:
        share = max(iteration - rising, 0) / max(settings.iterations - rising, 1)
    return settings.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * share))


def period(settings: StageSettings, iteration: int) -> tuple[float, float]:
    """The iterations from the last restart to the next one."""
    stops = [settings.iterations * done / sum(PERIODS) for done in accumulate(PERIODS)]
    which = min(bisect_right(stops, iteration), len(stops) - 1)
    return (0.0, *stops)[which], stops[which]


def groups(settings: StageSettings, iteration: int) -> dict[str, float]:
    """What an iteration changes in the optimiser's groups: the rate, and of "adamwr" the decay.

    Weights decay by the share of the rate's height that is left times 2.5e-3 / sqrt(iterations between two
    restarts), whatever the rate (Loshchilov and Hutter 2019, decoupled and normalised); torch multiplies by
    the rate.
    """
    found = {"lr": rate(settings, iteration)}
    if settings.optimiser == "adamwr":
        whole = (0.0, float(settings.iterations))
        start, stop = period(settings, iteration) if settings.schedule == "restarts" else whole
        found["weight_decay"] = NORMALISED_DECAY / math.sqrt(stop - start) / settings.learning_rate
    return found
