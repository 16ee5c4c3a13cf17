"""Training of a phase-functioned network: from a frame, its phase and its trajectory to the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from features.labels import Labels
from lmm.evaluation.phase import free_run, joint_errors, windows
from lmm.locomotion import statistics, trajectory
from lmm.locomotion.window import FUTURE, PRESENT, SAMPLES
from lmm.pfnn.frames import Frames, frames
from lmm.pfnn.layout import Layout
from lmm.pfnn.settings import PhaseSettings as Runtime
from lmm.pfnn.spline import coefficients
from mm.database import Database

from .checkpoint import Errors
from .data import LIBRARIES, PARTS
from .pfnn_settings import PhaseTraining
from .phase_network import PhaseLayers
from .randomness import generator, sequence
from .settings import StageSettings

JUDGED, RUNS, HORIZONS = 1500, 200, (30, 60)
STATISTICS = 20_000  # frames that means and deviations are of
LEAST = 0.1  # deviation of what is asked: who was trained on one gait, or straight on, is asked for others
WORK = 300_000_000  # bytes that statistics, weights and batches take, whatever the data


@dataclass(eq=False)
class PhaseData:
    """A database's frames as a phase-functioned network sees them.

    Attributes
    ----------
    database, labels : of T frames.
    held_out : names of the clips (with their mirrored copies) that are not trained on.
    """

    database: Database
    labels: Labels
    held_out: tuple[str, ...] = ()

    @property
    def layout(self) -> Layout:
        return Layout(len(self.database.skeleton) - 1, len(self.labels.names))

    @cached_property
    def frames(self) -> Frames:
        """On flat ground."""
        return frames(self.database, self.labels)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Which frames [T] are not trained on."""
        return np.array([name in self.held_out for name in self.database.names])[self.database.ranges()]

    def starts(self, window: int, part: str = "training") -> NDArray[np.int64]:
        """Rows of `frames` of a part at which so many begin that follow each other in one range."""
        rows = windows(self.frames.frame, window)
        return rows[self.held[self.frames.frame[rows]] == (part == "held_out")]

    def sample(self, count: int, part: str, *, window: int = 1) -> NDArray[np.int64]:
        """At most count of a part's `starts`, evenly spread."""
        starts = self.starts(window, part)
        return starts[np.linspace(0, len(starts) - 1, min(count, len(starts))).astype(np.int64)]


def memory(database: Database, contacts: int) -> int:
    """Bytes that a training takes beside the database's file, which the system may drop: most are vectors,
    2.6 kB a frame of 31 joints (measured 2.1 to 2.9)."""
    layout = Layout(len(database.skeleton) - 1, contacts)
    return 4 * (layout.input_size + layout.output_size) * len(database) + WORK + LIBRARIES


class PhaseStage:
    """The network, trained on windows that it runs through on its own output."""

    name = "pfnn"

    def __init__(self, data: PhaseData, settings: PhaseTraining) -> None:
        self.settings: StageSettings = settings.pfnn
        self._how, self._all, self._data = settings.pfnn, settings, data
        layout = data.layout
        sizes = (layout.input_size, *self.settings.hidden, layout.output_size)
        self.network = PhaseLayers(sizes, seed=settings.seed, name=self.name)

    def modules(self) -> Mapping[str, nn.Module]:
        return {"pfnn": self.network}

    def begin(self) -> None:
        data, layout, device = self._data, self._data.layout, self._all.device
        found, weights = data.frames, statistics.joint_weights(data.database.skeleton)
        some = data.sample(STATISTICS, "training")
        known = statistics.statistics(found.x[some], found.y[some], layout, weights)
        for block in ("path", "facing", "gaits"):
            std = known["input_std"][layout.inputs[block]]
            np.maximum(std, LEAST, out=std)
        self.network.normalise(**known)
        self.network.to(device)
        self._x, self._y = (torch.from_numpy(array).to(device) for array in (found.x, found.y))
        self._shares = torch.from_numpy(coefficients(found.phase).astype(np.float32)).to(device)
        self._starts = data.starts(self.settings.window)
        self._judged = {p: rows for p in PARTS if len(rows := data.sample(JUDGED, p))}
        self._runs = {p: rows for p in self._judged if len(rows := data.sample(RUNS, p, window=HORIZONS[-1]))}

        # In normalised inputs a deviation of a block is 1, of joints what the statistics make of it.
        noise = np.ones(layout.input_size, np.float32)
        for block in ("positions", "velocities"):
            noise[layout.inputs[block]] = np.repeat(weights * statistics.JOINT_SCALE, 3)
        noise[layout.inputs["gaits"]] = 0
        self._noise = torch.from_numpy(self._how.noise * noise).to(device)
        self._joints = slice(layout.inputs["positions"].start, layout.inputs["velocities"].stop)
        self._own_joints = slice(layout.outputs["positions"].start, layout.outputs["velocities"].stop)
        self._own_future = slice(layout.outputs["path"].start, layout.outputs["facing"].stop)
        ahead = [
            layout.inputs[block].start + SAMPLES * axis + PRESENT + np.arange(FUTURE)
            for block in ("path", "facing")
            for axis in range(2)
        ]
        self._ahead = torch.from_numpy(np.concatenate(ahead)).to(device)
        self._asked = torch.from_numpy(_asked(data.database.fps)).to(device)

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        settings, network = self._how, self.network
        draw = generator(self._all.seed, self.name, iteration)
        rows = torch.from_numpy(self._starts[draw.integers(0, len(self._starts), settings.batch)])
        masks = torch.Generator(self._x.device)
        masks.manual_seed(int(sequence(self._all.seed, self.name, iteration).generate_state(1, np.uint64)[0]))
        off = self._phase_noise(draw)
        terms: list[Tensor] = []
        found: Tensor | None = None
        alone = iteration < settings.alone * settings.iterations
        for step in range(1 if alone else settings.window):
            at = (rows + step).to(self._x.device)
            x = self._x[at]
            if found is not None:
                x = self._fed_back(x, found * network.output_std + network.output_mean)
            x = (x - network.input_mean) / network.input_std
            if found is None and settings.noise:
                amounts = draw.random((len(rows), 1)) * draw.standard_normal((len(rows), x.shape[1]))
                x = x + torch.from_numpy(amounts.astype(np.float32)).to(x.device) * self._noise
            shares = self._shares[at]
            if off is not None:
                phases = self._data.frames.phase[(rows + step).numpy()] + off
                shares = torch.from_numpy(coefficients(phases).astype(np.float32)).to(x.device)
            found = network.inner(x, shares, keep=settings.keep, draw=masks)
            truth = (self._y[at] - network.output_mean) / network.output_std
            terms.append((found - truth).square().mean())
        losses = {"frames": torch.stack(terms).mean()}
        if settings.shrink:
            squares = [parameter.square().mean() for parameter in network.parameters()]
            losses["weights"] = settings.shrink * torch.stack(squares).mean()
        return losses

    def _phase_noise(self, draw: np.random.Generator) -> NDArray[np.float64] | None:
        if not self._how.phase_noise:
            return None
        return self._how.phase_noise * draw.standard_normal(self.settings.batch)

    def _fed_back(self, x: Tensor, y: Tensor) -> Tensor:
        """True inputs [N, I] with the joints that the network put out for the frame before, and with a
        future between what it foresaw and the true one, as characters mix it with what is asked."""
        x = x.clone()
        x[:, self._joints] = y[:, self._own_joints]
        x[:, self._ahead] = torch.lerp(y[:, self._own_future], x[:, self._ahead], self._asked)
        return x

    def evaluate(self) -> Errors:
        """Joint errors of one step, ``error_cm``, and after some frames of free run under the true
        trajectory, of those windows that are as long."""
        data, layout, errors = self._data, self._data.layout, {}
        for part, rows in self._judged.items():
            found = self.network.evaluate(data.frames.x[rows], data.frames.phase[rows])
            errors[part] = {"error_cm": float(joint_errors(found, data.frames.y[rows], layout).mean())}
        for part, rows in self._runs.items():
            run = free_run(self.network, data.frames, rows, layout, fps=data.database.fps, steps=HORIZONS[-1])
            for step, y in enumerate(run, 1):
                if step in HORIZONS:
                    truth = data.frames.y[rows + step - 1]
                    errors[part][f"after_{step}_cm"] = float(joint_errors(y, truth, layout).mean())
        return errors


def _asked(fps: float) -> NDArray[np.float32]:
    """How much of the future is what is asked [24]: x and z of the way, then of the directions, by sample."""
    spacing, runtime = trajectory.interval(fps), Runtime()
    sums, turns = trajectory.blend(spacing, runtime.position_bias, runtime.direction_bias)
    way, facing = (np.concatenate([[1], share]) for share in (sums / spacing, turns))
    return np.concatenate([way, way, facing, facing]).astype(np.float32)
