"""What all stages are trained on: how much memory it takes, and what is said where there is too little."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm.frames import compressor_inputs  # noqa: E402
from lmm.training import machine  # noqa: E402
from lmm.training import settings as settings_of  # noqa: E402
from lmm.training.data import LIBRARIES, Data, spread  # noqa: E402
from lmm.training.decompressor import DecompressorStage  # noqa: E402
from lmm.training.train import train  # noqa: E402
from mm.database import Database  # noqa: E402
from motion.errors import UserError  # noqa: E402
from motion.pose import Poses  # noqa: E402


@pytest.fixture(scope="module")
def large() -> Database:
    """So many frames that what a frame takes is more than what is there once."""
    database, copies = lmm_models.database(), 40
    repeated = {name: np.concatenate([getattr(database, name)] * copies)
                for name in ("contacts", "features", "tags", "mirrored")}  # fmt: skip
    first = np.repeat(np.arange(copies, dtype=np.int32), len(database.starts)) * np.int32(len(database))
    edges = {name: np.tile(getattr(database, name), copies) + first for name in ("starts", "stops")}
    poses = Poses(*(np.concatenate([array] * copies) for array in database.poses.arrays().values()))
    return replace(database, poses=poses, names=database.names * copies, **repeated, **edges)


def test_a_training_takes_the_memory_that_it_says(large):
    settings = settings_of.preset("ours", "smoke")
    data = Data(large)
    told = data.memory() - LIBRARIES
    stage = DecompressorStage(data, settings)
    tracemalloc.start()
    try:
        stage.begin()
        stage.loss(0)
        most = tracemalloc.get_traced_memory()[1]
        stage.latents()
        after = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert 0.7 * told < most < 1.3 * told
    assert after < 0.3 * told


def test_inputs_and_spread_are_what_they_are_all_at_once(large):
    data = Data(large)
    inputs = data.inputs()
    np.testing.assert_array_equal(inputs, compressor_inputs(large))
    np.testing.assert_array_equal(inputs[:, : data.layout.size], data.layout.pack(large))
    rows = np.flatnonzero(np.arange(len(large)) % 3)
    mean, std = spread(inputs, rows)
    np.testing.assert_array_equal(mean, inputs[rows].mean(axis=0, dtype=np.float64).astype(np.float32))
    wide = std > 0
    expected = inputs[rows].std(axis=0, dtype=np.float64).astype(np.float32)
    np.testing.assert_array_equal(std[wide], expected[wide])
    assert 0 < wide.sum() < len(wide) and expected[~wide].max() < 1e-4


def test_a_training_that_does_not_fit_says_so_at_once(large, tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "memory", lambda: 1e8)
    with pytest.raises(
        UserError, match=r"takes about 0\.\d GB of memory, this machine has 0\.1 GB"
    ) as caught:
        train(large, tmp_path / "large.lmm", settings_of.preset("ours", "smoke"))
    assert "\n" not in str(caught.value) and caught.value.remedy and not list(tmp_path.iterdir())
    monkeypatch.undo()
    assert machine.memory() > 1e8
