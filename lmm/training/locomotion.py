"""Training of a network that a trajectory drives: from a frame and its trajectory to the next."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from features.labels import Labels
from lmm.evaluation.phase import free_run, joint_columns, joint_errors, windows
from lmm.locomotion import grounds as uneven
from lmm.locomotion import statistics, trajectory
from lmm.locomotion.grounds import GroundTable
from lmm.locomotion.labelling import kept
from lmm.locomotion.layout import JOINTS
from lmm.locomotion.settings import LocomotionSettings as Runtime
from lmm.locomotion.window import FUTURE, PRESENT, SAMPLES, Blocks, size
from mm.database import Database

from .checkpoint import Errors
from .data import LIBRARIES, PARTS
from .locomotion_settings import LocomotionStageSettings, LocomotionTraining
from .mixed_networks import MixedLayers
from .randomness import generator, sequence
from .settings import StageSettings

JUDGED, RUNS, HORIZONS = 1500, 200, (30, 60)
STATISTICS = 20_000  # frames that means and deviations are of
# Deviation of what is asked: who was trained on one gait, straight on, or on level ground, meets others.
LEAST = 0.1
ASKED = {"path", "facing", "going", "speeds"}  # blocks of inputs that are asked for, if not alone
WORK = 300_000_000  # bytes that statistics, weights and batches take, whatever the data


@dataclass(eq=False)
class LocomotionData:
    """A database's frames as a network sees them.

    Attributes
    ----------
    database, labels : of T frames.
    held_out : names of the clips (with their mirrored copies) that are not trained on.
    grounds : fitted to the motion, on any of which frames are seen; level ground by default.
    """

    database: Database
    labels: Labels
    held_out: tuple[str, ...] = ()
    grounds: GroundTable | None = None

    layout_type: ClassVar[Callable[[int, int], Any]]
    vectors: ClassVar[Callable[[Database, Labels], Any]]  # `frames` of a network

    @cached_property
    def layout(self) -> Any:
        """What the numbers of a vector are."""
        return type(self).layout_type(len(self.database.skeleton) - 1, len(self.labels.names))

    @cached_property
    def frames(self) -> Any:
        """Vectors x [M, I] and y [M, O], on level ground, and the frames [M] that they are of."""
        return type(self).vectors(self.database, self.labels)

    def memory(self) -> int:
        """Bytes that a training takes beside the database's file, which the system may drop: most are
        vectors, of 31 joints 2.6 kB a frame of a phase-functioned network (measured 2.1 to 2.9), 4 kB of
        a mode-adaptive one."""
        numbers = size(self.layout.inputs) + size(self.layout.outputs)
        grounds = 0
        if self.grounds is not None:
            grounds = self.grounds.nbytes + 4 * numbers * len(PARTS) * (JUDGED + RUNS * HORIZONS[-1])
        return 4 * numbers * len(self.database) + grounds + WORK + LIBRARIES

    def bounds(self) -> NDArray[np.float32] | None:
        """The least and the most of outputs that characters follow, [2, O], if they do not follow all."""
        return None

    def lay(self, x: Any, y: Any, rows: NDArray[np.int64], which: NDArray[np.int64], steps: Any = 0) -> None:
        """Put x [N, I] and y [N, O], steps after rows [N] of `frames`, on the rows' grounds which [N]."""
        assert self.grounds is not None
        told: tuple[Any, ...] = self.grounds.along(self.frames.frame[rows], which, steps)
        if isinstance(x, Tensor):
            told = tuple(torch.from_numpy(part).to(x.device) for part in told)
        uneven.lay(x, y, self.layout, *told)

    def seen(self, rows: NDArray[np.int64], steps: int = 1) -> tuple[Any, NDArray[np.int64]]:
        """Frames, and rows of them, at which windows of so many begin: those of `frames` that begin at rows;
        on uneven ground copies of them, window after window, on each of its grounds in turn."""
        if self.grounds is None:
            return self.frames, rows
        first, after = np.repeat(rows, steps), np.tile(np.arange(steps), len(rows))
        some = {f.name: getattr(self.frames, f.name)[first + after] for f in fields(self.frames)}
        which = np.repeat(np.arange(len(rows)) % len(self.grounds), steps)
        self.lay(some["x"], some["y"], first, which, after)
        return replace(self.frames, **some), steps * np.arange(len(rows))

    def count(self) -> int:
        """How many frames are trained on."""
        trained = kept(self.database, self.labels) & ~self._ranges_held
        lengths = (self.database.stops.astype(np.int64) - self.database.starts)[trained]
        return int((lengths - 2).clip(0).sum())

    @cached_property
    def _ranges_held(self) -> NDArray[np.bool_]:
        return np.array([name in self.held_out for name in self.database.names], bool)

    def starts(self, window: int, part: str = "training") -> NDArray[np.int64]:
        """Rows of `frames` of a part at which so many begin that follow each other in one range."""
        rows = windows(self.frames.frame, window)
        held = self._ranges_held[self.database.ranges()[self.frames.frame[rows]]]
        return rows[held == (part == "held_out")]

    def sample(self, count: int, part: str, *, window: int = 1) -> NDArray[np.int64]:
        """At most count of a part's `starts`, evenly spread."""
        starts = self.starts(window, part)
        return starts[np.linspace(0, len(starts) - 1, min(count, len(starts))).astype(np.int64)]


class LocomotionStage:
    """A network, trained on windows that it runs through on its own output.

    What is a network's own: what it takes beside its inputs, how far its joints' inputs count, and what else
    is in its loss.

    Parameters
    ----------
    data, network : what is trained, on what.
    name : of the network and of its part in the settings.
    settings, how : of the training, and of its one stage.
    joint_scale : what an input's joint counts, against the trajectory.
    """

    def __init__(
        self,
        data: LocomotionData,
        network: MixedLayers,
        *,
        name: str,
        settings: LocomotionTraining,
        how: LocomotionStageSettings,
        joint_scale: float,
    ) -> None:
        self.name, self.network, self._data, self._all = name, network, data, settings
        self.settings: StageSettings = how
        self._how = how
        self._joint_weights = statistics.joint_weights(data.database.skeleton)
        counting = np.count_nonzero(self._joint_weights)
        share = min(1.0, how.ordinary / counting) ** 0.5 if how.ordinary else 1.0
        self._joint_scale, self._joint_noise = share * joint_scale, how.noise * joint_scale

    def modules(self) -> Mapping[str, nn.Module]:
        return {self.name: self.network}

    def begin(self) -> None:
        data, layout, device = self._data, self._data.layout, self._all.device
        found, weights = data.frames, self._joint_weights
        laid, some = data.seen(data.sample(STATISTICS, "training"))
        known = statistics.statistics(
            laid.x[some], laid.y[some], layout, weights, joint_scale=self._joint_scale
        )
        for block in ("path", "facing", "gaits", "going", "speeds", "heights"):
            if block in layout.inputs:
                std = known["input_std"][layout.inputs[block]]
                np.maximum(std, LEAST, out=std)
        self.network.normalise(**known)
        self.network.to(device)
        self._x, self._y = (torch.from_numpy(array).to(device) for array in (found.x, found.y))
        self._starts = data.starts(self.settings.window)
        judged = {p: rows for p in PARTS if len(rows := data.sample(JUDGED, p))}
        runs = {p: rows for p in judged if len(rows := data.sample(RUNS, p, window=HORIZONS[-1]))}
        self._judged = {p: data.seen(rows) for p, rows in judged.items()}
        self._runs = {p: data.seen(rows, HORIZONS[-1]) for p, rows in runs.items()}

        # In normalised inputs a deviation of a block is 1, of joints what the statistics make of it.
        noise = np.full(layout.input_size, self._how.noise, np.float32)
        for block in layout.inputs.keys() & set(JOINTS):
            joints = noise[layout.inputs[block]].reshape(len(weights), -1)
            joints[:] = self._joint_noise * weights[:, None]
        for block in layout.inputs.keys() & ASKED:
            noise[layout.inputs[block]] = self._how.asked_noise
        noise[layout.inputs["gaits"]] = 0
        self._noise, self._noisy = torch.from_numpy(noise).to(device), bool(noise.any())
        self._joints = joint_columns(layout)
        ahead, future, asked = _future(layout, data.database.fps)
        self._ahead, self._asked = torch.from_numpy(ahead).to(device), torch.from_numpy(asked).to(device)
        self._own_future = future

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        settings, network = self._how, self.network
        draw = generator(self._all.seed, self.name, iteration)
        rows = torch.from_numpy(self._starts[draw.integers(0, len(self._starts), settings.batch)])
        masks = torch.Generator(self._x.device)
        masks.manual_seed(int(sequence(self._all.seed, self.name, iteration).generate_state(1, np.uint64)[0]))
        more, told = self._more(draw), self._told(draw)
        grounds = self._data.grounds
        which = None if grounds is None else draw.integers(0, len(grounds), settings.batch)
        terms: list[Tensor] = []
        found: Tensor | None = None
        alone = iteration < settings.alone * settings.iterations
        for step in range(1 if alone else settings.window):
            at = (rows + step).to(self._x.device)
            x, y = told(self._x[at], at), self._y[at]
            if which is not None:
                self._data.lay(x, y, rows.numpy(), which, step)
            if found is not None:
                x = self._fed_back(x, found * network.output_std + network.output_mean)
            x = (x - network.input_mean) / network.input_std
            if found is None and self._noisy:
                amounts = draw.random((len(rows), 1)) * draw.standard_normal((len(rows), x.shape[1]))
                x = x + torch.from_numpy(amounts.astype(np.float32)).to(x.device) * self._noise
            found = network.inner(x, *more(rows + step), keep=settings.keep, draw=masks)
            truth = (y - network.output_mean) / network.output_std
            terms.append((found - truth).square().mean())
        return {"frames": torch.stack(terms).mean(), **self._besides()}

    def _more(self, draw: np.random.Generator) -> Callable[[Tensor], tuple[Tensor, ...]]:
        """What the network takes beside its inputs, of rows [N]; draw is for what is random in a batch."""
        return lambda rows: ()

    def _told(self, draw: np.random.Generator) -> Callable[[Tensor, Tensor], Tensor]:
        """What a network is told, of true inputs [N, I] of rows [N]; draw as for `_more`."""
        return lambda x, rows: x

    def _besides(self) -> Mapping[str, Tensor]:
        """What else is made small."""
        return {}

    def _fed_back(self, x: Tensor, y: Tensor) -> Tensor:
        """True inputs [N, I] with the joints that the network put out for the frame before, and with a
        future between what it foresaw and the true one.

        Characters mix the increments of what is asked and foreseen, here it is positions; far samples then
        lie nearer to the truth, by less than what noise adds to them.
        """
        x = x.clone()
        into, out = self._joints
        x[:, into] = y[:, out]
        x[:, self._ahead] = torch.lerp(y[:, self._own_future], x[:, self._ahead], self._asked)
        return x

    def evaluate(self) -> Errors:
        """Joint errors of one step, ``error_cm``, and after some frames of free run under the true
        trajectory, of those windows that are as long; on the grounds that were trained on."""
        data, layout, errors = self._data, self._data.layout, {}
        network: Any = self.network
        for part, (frames, rows) in self._judged.items():
            (found,) = free_run(network, frames, rows, layout, fps=data.database.fps, steps=1)
            errors[part] = {"error_cm": float(joint_errors(found, frames.y[rows], layout).mean())}
        for part, (frames, rows) in self._runs.items():
            run = free_run(network, frames, rows, layout, fps=data.database.fps, steps=HORIZONS[-1])
            for step, y in enumerate(run, 1):
                if step in HORIZONS:
                    truth = frames.y[rows + step - 1]
                    errors[part][f"after_{step}_cm"] = float(joint_errors(y, truth, layout).mean())
        return errors


def _future(layout: Blocks, fps: float) -> tuple[NDArray[np.int64], slice, NDArray[np.float32]]:
    """Where the future stands in the inputs, and in the outputs, and how much of it is what is asked [F].

    Of the way, the directions and, where there are any, the velocities, x and z, all samples each.
    """
    spacing, runtime = trajectory.interval(fps), Runtime()
    sums, turns = trajectory.blend(spacing, runtime.position_bias, runtime.direction_bias)
    shares = {
        "path": sums / spacing,
        "facing": turns,
        "going": trajectory.blend(spacing, 0, runtime.position_bias)[1],
    }
    blocks = [block for block in shares if block in layout.inputs]
    ahead = [
        layout.inputs[block].start + SAMPLES * axis + PRESENT + np.arange(FUTURE)
        for block in blocks
        for axis in range(2)
    ]
    asked = [np.concatenate([[1], shares[block]]) for block in blocks for _ in range(2)]
    own = slice(layout.outputs[blocks[0]].start, layout.outputs[blocks[-1]].stop)
    return np.concatenate(ahead), own, np.concatenate(asked).astype(np.float32)
