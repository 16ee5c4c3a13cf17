"""Training of the Stepper: from a state to its rate of change, so that it can run on by itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.evaluation.stepper import free_run

from .checkpoint import Errors
from .data import Data, floored, spread
from .decompressor import DecompressorStage
from .networks import Perceptron
from .randomness import generator
from .settings import Settings

Array = NDArray[np.float32]
JUDGED, HORIZONS = 400, (10, 20, 60)
# Weights of features, latents, and the rates of both (REFERENCE 3.2).
WEIGHTS = (2.0, 7.5, 0.2, 0.5)
OF_FEATURES = 0.3  # share of the noise that features get: a Projector's are less wrong than its latents


class StepperStage:
    """The Stepper, trained on windows that it runs through on its own output (REFERENCE 3.1, 3.2)."""

    name = "stepper"

    def __init__(self, data: Data, settings: Settings, before: DecompressorStage) -> None:
        self.settings, self._all, self._data, self._before = settings.stepper, settings, data, before
        state = data.features.shape[1] + settings.latent
        self.stepper = Perceptron(
            (state, *self.settings.hidden, state), "relu", seed=settings.seed, name=self.name
        )

    def modules(self) -> Mapping[str, nn.Module]:
        return {"stepper": self.stepper}

    def begin(self) -> None:
        data, fps = self._data, self._data.database.fps
        self._states = np.hstack([data.features, self._before.latents()])
        train, steps = data.frames["training"], data.starts(2)
        mean, std = spread(self._states[train])
        rates = (self._states[steps + 1] - self._states[steps]) * np.float32(fps)
        rate_mean, rate_std = spread(rates)
        self.stepper.normalise(
            input_mean=mean, input_std=floored(std, data.features.shape[1]), output_mean=rate_mean,
            output_std=rate_std,
        )  # fmt: skip
        self.stepper.to(self._all.device)
        self._tensor = torch.from_numpy(self._states).to(self._all.device)
        most = np.full(len(mean), self._all.stepper_noise, np.float32)
        most[: data.features.shape[1]] *= OF_FEATURES
        self._mean, self._most, self._noise = (
            torch.from_numpy(row).to(self._all.device) for row in (mean, most, most * std)
        )
        self._window = self._all.stepper_window(fps)
        self._starts = data.starts(self._window)
        self._horizons = [h for h in HORIZONS if h < data.longest()] or [1]
        self._last = (data.database.stops - 1)[data.database.ranges()]
        self._samples = {
            part: found
            for part in data.parts()
            if len(found := data.sample(JUDGED, part, window=self._horizons[0] + 1))
        }

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        window, width, fps = self._window, self._data.features.shape[1], self._data.database.fps
        draw = generator(self._all.seed, self.name, iteration)
        first = self._starts[draw.integers(0, len(self._starts), self.settings.batch)]
        rows = torch.from_numpy(first + np.arange(window)[:, None]).to(self._tensor.device)
        truth = self._tensor[rows]
        states = [self._disturbed(truth[0], draw)]
        for _ in range(window - 1):
            states.append(states[-1] + self.stepper(states[-1]) / fps)
        run = torch.stack(states)
        difference = (run[1:] - truth[1:]).abs()
        rates = (run.diff(dim=0) - truth.diff(dim=0)).abs() * fps
        return {
            "features": WEIGHTS[0] * difference[..., :width].mean(),
            "latents": WEIGHTS[1] * difference[..., width:].mean(),
            "feature rates": WEIGHTS[2] * rates[..., :width].mean(),
            "latent rates": WEIGHTS[3] * rates[..., width:].mean(),
        }

    def _disturbed(self, states: Tensor, draw: np.random.Generator) -> Tensor:
        """States [B, F + L], half of them moved at random and towards their mean, each by another amount.

        A Projector's answers are wrong in this way; from those, too, a Stepper must find into the motion.
        """
        if not self._all.stepper_noise:
            return states
        half = len(states) // 2
        numbers = (
            draw.random((half, 1)),
            draw.random((half, 1)),
            draw.standard_normal((half, states.shape[1])),
        )
        moved, shrunk, normal = (torch.from_numpy(n.astype(np.float32)).to(states.device) for n in numbers)
        some = states[:half]
        some = some + moved * normal * self._noise + shrunk * self._most * (self._mean - some)
        return torch.cat([some, states[half:]])

    def evaluate(self) -> Errors:
        """Joint errors after some frames of free run from true states; ``error_cm`` is that after ten."""
        found = {}
        for part, frames in self._samples.items():
            errors = {}
            run = free_run(self.stepper, self._states[frames], self._data.database.fps, self._horizons[-1])
            for frame, states in enumerate(run, 1):
                if frame in self._horizons:
                    on = frames + frame <= self._last[frames]
                    if not on.any():
                        break
                    vectors = self._before.decompressor.evaluate(states[on])
                    error = float(self._before.joint_errors(vectors, frames[on] + frame).mean())
                    errors["error_cm" if frame == self._horizons[0] else f"after_{frame}_cm"] = error
            found[part] = errors
        return found

    @property
    def states(self) -> Array:
        """Features and latents [T, F + L] of all frames."""
        return self._states
