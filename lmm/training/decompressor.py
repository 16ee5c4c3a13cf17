"""Training of Compressor and Decompressor: a latent that, with the features, says the whole pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.frames import compressor_inputs, compressor_size

from .checkpoint import Errors
from .data import Data, floored, spread
from .networks import CHUNK, Perceptron
from .pose_loss import PoseLoss, joints
from .randomness import generator
from .settings import Settings

Array = NDArray[np.float32]
JUDGED = 1500  # frames of each part that an evaluation during training takes
# Weights of the latent's absolute values, squares, and rates. Rates slow down to what a stepper can follow
# cost the pose nothing, if anything they help it to generalise.
LATENT = {"reference": (0.1, 0.1, 0.01), "ours": (0.1, 0.1, 0.1)}


@dataclass(frozen=True)
class _Held:
    """What only this stage needs, and what takes the most memory of a training.

    inputs [T, ..] and features [T, F] where networks are; loss of vectors; of each part the frames and the
    inputs that it is judged by.
    """

    inputs: Tensor
    features: Tensor
    loss: PoseLoss
    judged: Mapping[str, tuple[NDArray[np.int64], Array]]


class DecompressorStage:
    """Compressor and Decompressor, trained together on windows of frames (REFERENCE 3.1, 3.2)."""

    name = "decompressor"

    def __init__(self, data: Data, settings: Settings) -> None:
        self.settings, self._all, self._data = settings.decompressor, settings, data
        self._held: _Held | None = None
        self._latents: Array | None = None
        features, vectors = data.features.shape[1], data.layout.size
        inputs, seed = compressor_size(data.layout), settings.seed
        state = features + settings.latent
        self.compressor = Perceptron(
            (inputs, *settings.compressor, settings.latent), "elu", seed=seed, name="compressor"
        )
        self.decompressor = Perceptron(
            (state, *self.settings.hidden, vectors), "relu", seed=seed, name=self.name
        )

    def modules(self) -> Mapping[str, nn.Module]:
        return {"compressor": self.compressor, "decompressor": self.decompressor}

    def begin(self) -> None:
        data, device = self._data, self._all.device
        train, inputs = data.frames["training"], data.inputs()
        vectors = inputs[:, : data.layout.size]
        mean, std = spread(inputs, train)
        self.compressor.normalise(input_mean=mean, input_std=self._by_block(std))
        mean, std = spread(data.features, train)
        latent = np.zeros(self._all.latent, np.float32), np.ones(self._all.latent, np.float32)
        self.decompressor.normalise(
            input_mean=np.concatenate([mean, latent[0]]), input_std=np.concatenate([floored(std), latent[1]])
        )
        mean, std = spread(vectors, train)
        self.decompressor.normalise(output_mean=mean, output_std=std)
        for module in self.modules().values():
            module.to(device)
        self._starts = data.starts(self.settings.window)
        samples = {part: data.sample(JUDGED, part) for part in data.parts()}
        database = data.database
        self._held = _Held(
            inputs=torch.from_numpy(inputs).to(device),
            features=torch.from_numpy(data.features).to(device),
            loss=PoseLoss(
                database.skeleton, len(database.contact_roles), database.fps, vectors,
                threads=torch.get_num_threads(), device=device,
            ),
            judged={part: (frames, inputs[frames]) for part, frames in samples.items()},
        )  # fmt: skip

    def _by_block(self, std: Array) -> Array:
        """One deviation for a block: what hardly moves is not blown up to the size of the rest."""
        layout, n = self._data.layout, self._data.layout.joints - 1
        sizes = [part.stop - part.start for part in layout.slices.values()] + [3 * n, 6 * n, 3 * n, 3 * n]
        out, start = np.zeros_like(std), 0
        for size in sizes:
            block = std[start : start + size]
            if (block > 0).any():
                out[start : start + size] = np.where(block > 0, block[block > 0].mean(), 0)
            start += size
        return out

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        held = self._held
        assert held is not None, "not begun, or done already"
        window, batch = self.settings.window, self.settings.batch
        draw = generator(self._all.seed, self.name, iteration)
        first = self._starts[draw.integers(0, len(self._starts), batch)]
        rows = torch.from_numpy((first[:, None] + np.arange(window)).reshape(-1)).to(held.features.device)
        latents = self.compressor(held.inputs[rows])
        vectors = self.decompressor(torch.cat([held.features[rows], latents], dim=1))
        # The published recipe by autograd, as published; a GPU needs it too.
        compiled = self._all.recipe != "reference" and vectors.device.type == "cpu"
        terms = (held.loss.compiled if compiled else held.loss.plain)(vectors, first, window)
        absolute, squared, rate = LATENT[self._all.recipe]
        steps = latents.unflatten(0, (batch, window)).diff(dim=1) * self._data.database.fps
        return terms | {
            "latent": absolute * latents.abs().mean(),
            "latent squared": squared * latents.square().mean(),
            "latent rate": rate * steps.abs().mean(),
        }

    def evaluate(self) -> Errors:
        found = {}
        assert self._held is not None
        for part, (frames, inputs) in self._held.judged.items():
            latents = self.compressor.evaluate(inputs)
            vectors = self.decompressor.evaluate(np.hstack([self._data.features[frames], latents]))
            found[part] = {"error_cm": float(self.joint_errors(vectors, frames).mean())}
        return found

    def joint_errors(self, vectors: Array, frames: NDArray[np.int64]) -> Array:
        """Distances [N, J-1] of joints from the true ones in the root's space, cm."""
        database = self._data.database
        parents = np.ascontiguousarray(database.skeleton.parents, np.int32)
        truth = self._data.layout.pack(database, frames)
        apart = joints(parents, vectors)[0] - joints(parents, truth)[0]
        return 100 * np.linalg.norm(apart, axis=-1)[:, 1:]

    def latents(self) -> Array:
        """Latents [T, L] of all frames, when it is done; what it was trained on is let go."""
        if self._latents is None:
            self._held = None
            database, parts = self._data.database, self._data.chunks(CHUNK)
            found = [self.compressor.evaluate(compressor_inputs(database, part)) for part in parts]
            self._latents = np.concatenate(found)
        return self._latents
