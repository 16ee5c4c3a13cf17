"""lmm.pfnn.model: files there and back, damaged ones, parts that do not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pfnn_models
import pytest

from lmm.pfnn.model import KIND, PhaseModel
from mm.database import Database
from motion.errors import UserError


@pytest.mark.parametrize("kind", ["float32", "float16"])
def test_there_and_back(tmp_path: Path, kind) -> None:
    model = pfnn_models.model().as_type(kind)
    model = replace(model, held_out=("a",), database="ff", ranges=2, frames=7, training={"seed": 1})
    model.save(tmp_path / "m.pfnn")
    back = PhaseModel.load(tmp_path / "m.pfnn")
    assert back.fingerprint == model.fingerprint != ""
    for name in ("contacts", "held_out", "database", "ranges", "frames", "training", "errors", "layout"):
        assert getattr(back, name) == getattr(model, name)
    x = np.random.default_rng(0).standard_normal((2, model.layout.input_size)).astype(np.float32)
    np.testing.assert_array_equal(back.network.evaluate(x, [0, 2]), model.network.evaluate(x, [0, 2]))
    assert back.network.weight_type == kind
    assert back.description.skeleton.names == model.description.skeleton.names


def test_another_kind_of_file_and_a_damaged_one_are_refused(tmp_path: Path) -> None:
    import lmm_models

    lmm_models.database().save(tmp_path / "db")
    with pytest.raises(UserError, match=f"expected a {KIND}"):
        PhaseModel.load(tmp_path / "db")
    path = tmp_path / "m.pfnn"
    pfnn_models.model().save(path)
    with pytest.raises(UserError, match="expected a motion database"):
        Database.load(path)
    raw = bytearray(path.read_bytes())
    raw[-5] ^= 1
    path.write_bytes(raw)
    with pytest.raises(UserError, match="checksum"):
        PhaseModel.load(path)


def test_a_network_of_another_skeleton_is_refused() -> None:
    model = pfnn_models.model()
    layout = model.layout
    with pytest.raises(ValueError, match=f"expected {layout.input_size} and {layout.output_size}"):
        replace(model, network=pfnn_models.network(layout.input_size + 6, 8, layout.output_size + 9))
    with pytest.raises(ValueError, match="expected"):
        replace(model, contacts=("left_toe", "right_toe"))


def test_a_skeleton_without_a_ground_root_is_refused() -> None:
    model = pfnn_models.model()
    skeleton = model.description.skeleton
    roles = {role: joint for role, joint in skeleton.roles.items() if role != "root"}
    with pytest.raises(ValueError, match="no ground root"):
        replace(model, description=replace(model.description, skeleton=skeleton.with_roles(roles)))
