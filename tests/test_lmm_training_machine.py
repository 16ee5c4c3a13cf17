"""Training on a GPU, as far as it shows without one: what is asked for and said, and where tensors are."""

from __future__ import annotations

import warnings
from dataclasses import replace
from importlib import metadata

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
from torch._subclasses import FakeTensorMode  # noqa: E402

from lmm.training import projector  # noqa: E402
from lmm.training import settings as settings_of  # noqa: E402
from lmm.training.data import Data  # noqa: E402
from lmm.training.decompressor import DecompressorStage  # noqa: E402
from lmm.training.machine import machine, version  # noqa: E402
from lmm.training.networks import Perceptron  # noqa: E402
from lmm.training.projector import ProjectorStage  # noqa: E402
from lmm.training.settings import Settings  # noqa: E402
from lmm.training.stepper import StepperStage  # noqa: E402
from lmm.training.train import train  # noqa: E402
from motion.errors import UserError  # noqa: E402


def test_a_checkout_that_is_not_installed_has_no_version(monkeypatch):
    def none(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    assert version() == metadata.version("motion-matching")
    monkeypatch.setattr(metadata, "version", none)
    assert version() == "unknown"


def test_without_a_gpu_one_line_says_so(tmp_path, monkeypatch):
    def available() -> bool:
        warnings.warn("CUDA initialization: the driver is too old", stacklevel=1)
        return False

    monkeypatch.setattr(torch.cuda, "is_available", available)
    chosen = replace(settings_of.preset("ours", "smoke"), device="cuda", held_out=0.0)
    with pytest.raises(UserError) as caught:
        train(lmm_models.database(), tmp_path / "any.lmm", chosen)
    assert str(caught.value) == "torch finds no CUDA device; train on the processor: --device cpu"
    assert not list(tmp_path.iterdir())


def test_a_full_gpu_is_one_line_and_leaves_torch_as_it_was():
    before = torch.get_num_threads()
    chosen = Settings(threads=before + 1)
    with pytest.raises(UserError, match="the GPU's memory is full; end what"), machine(chosen):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nGPU 0 has ...")
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("recipe", ["ours", "reference"])
def test_all_that_a_loss_takes_is_on_the_gpu(recipe, monkeypatch):
    """Tensors of a device and a shape but without numbers: torch refuses to mix their devices all the same.

    They can neither be read nor trained.
    """

    def to(module: Perceptron, device: str) -> None:
        for part in module.modules():
            for name, weight in list(part._parameters.items()):
                part._parameters[name] = torch.nn.Parameter(weight.detach().to(device))
            for name, buffer in list(part._buffers.items()):
                part._buffers[name] = buffer.to(device)

    monkeypatch.setattr(projector, "FEWEST", 200)
    monkeypatch.setattr(projector, "JUDGED", 200)
    monkeypatch.setattr(Perceptron, "to", to)
    monkeypatch.setattr(
        Perceptron, "evaluate", lambda self, x: np.zeros((len(x), len(self.output_mean)), np.float32)
    )
    chosen = replace(settings_of.preset(recipe, "smoke"), device="cuda", held_out=0.0)
    data = Data(lmm_models.database())
    with FakeTensorMode(allow_non_fake_inputs=True):
        first = DecompressorStage(data, chosen)
        for stage in (first, StepperStage(data, chosen, first), ProjectorStage(data, chosen, first)):
            stage.begin()
            terms = stage.loss(0)
            assert terms and {term.device.type for term in terms.values()} == {"cuda"}
            weights = [p for module in stage.modules().values() for p in module.parameters()]
            assert {weight.device.type for weight in weights} == {"cuda"}
        with pytest.raises(RuntimeError, match="device"):
            first.decompressor(torch.zeros(1, data.features.shape[1] + chosen.latent))
