"""lmm.mann.model: files there and back, damaged ones, parts that do not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mann_models
import numpy as np
import pfnn_models
import pytest

from lmm.mann.model import KIND, MannModel
from lmm.pfnn.model import PhaseModel
from motion.errors import UserError


@pytest.mark.parametrize("kind", ["float32", "float16"])
def test_there_and_back(tmp_path: Path, kind) -> None:
    model = mann_models.model(experts=8).as_type(kind)
    model = replace(model, held_out=("a",), database="ff", ranges=2, frames=7, training={"seed": 1})
    model.save(tmp_path / "m.mann")
    back = MannModel.load(tmp_path / "m.mann")
    assert back.fingerprint == model.fingerprint != ""
    for name in ("contacts", "held_out", "database", "ranges", "frames", "training", "errors", "layout"):
        assert getattr(back, name) == getattr(model, name)
    x = np.random.default_rng(0).standard_normal((2, model.layout.input_size)).astype(np.float32)
    np.testing.assert_array_equal(back.network.evaluate(x), model.network.evaluate(x))
    assert back.network.weight_type == kind
    assert back.description.skeleton.names == model.description.skeleton.names
    network = model.network
    assert model.parameters == 8 * network.parameters + network.gate_parameters


def test_another_kind_of_file_and_a_damaged_one_are_refused(tmp_path: Path) -> None:
    pfnn_models.model().save(tmp_path / "m.pfnn")
    with pytest.raises(UserError, match=f"expected a {KIND}"):
        MannModel.load(tmp_path / "m.pfnn")
    path = tmp_path / "m.mann"
    mann_models.model().save(path)
    with pytest.raises(UserError, match="expected a phase-functioned network"):
        PhaseModel.load(path)
    raw = bytearray(path.read_bytes())
    raw[-5] ^= 1
    path.write_bytes(raw)
    with pytest.raises(UserError, match="checksum"):
        MannModel.load(path)


def test_a_network_of_another_skeleton_is_refused() -> None:
    model = mann_models.model()
    layout = model.layout
    with pytest.raises(ValueError, match=f"expected {layout.input_size} and {layout.output_size}"):
        replace(model, network=mann_models.network(layout.input_size + 12, 8, layout.output_size + 12))
    with pytest.raises(ValueError, match="expected"):
        replace(model, contacts=("left_toe", "right_toe", "left_heel", "right_heel"))
