"""lmm.locomotion.model and its kinds: files there and back, damaged ones, parts that do not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest
from locomotion_models import MODELS, NETWORKS

from mm.database import Database
from motion.errors import UserError


@pytest.mark.parametrize("weights", ["float32", "float16"])
@pytest.mark.parametrize("kind", MODELS)
def test_there_and_back(tmp_path: Path, kind: str, weights) -> None:
    model = MODELS[kind]().as_type(weights)
    model.save(tmp_path / "unbound")
    assert type(model).load(tmp_path / "unbound").bounds is None
    bounds = np.stack([np.full(model.layout.output_size, most, np.float32) for most in (-2, 3)])
    more = {"held_out": ("a",), "database": "ff", "ranges": 2, "frames": 7, "training": {"seed": 1}}
    model = replace(model, bounds=bounds, **more)
    model.save(tmp_path / "m")
    back = type(model).load(tmp_path / "m")
    np.testing.assert_array_equal(back.bounds, bounds)
    assert back.fingerprint == model.fingerprint != ""
    for name in ("contacts", "held_out", "database", "ranges", "frames", "training", "errors", "layout"):
        assert getattr(back, name) == getattr(model, name)
    expected = model.network.to_arrays("")
    for name, array in back.network.to_arrays("").items():
        np.testing.assert_array_equal(array, expected[name], err_msg=name)
    assert back.network.weight_type == weights and back.parameters == model.parameters
    assert back.description.skeleton.names == model.description.skeleton.names


def test_parameters_are_those_of_all_sets_and_the_gate() -> None:
    plain, gated = MODELS["pfnn"](), MODELS["mann"](experts=8)
    assert plain.parameters == 4 * plain.network.parameters
    assert gated.parameters == 8 * gated.network.parameters + gated.network.gate_parameters


def test_other_kinds_of_files_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    lmm_models.database().save(tmp_path / "db")
    types = {}
    for kind, of_kind in MODELS.items():
        model = of_kind()
        model.save(tmp_path / kind)
        types[kind] = type(model)
        with pytest.raises(UserError, match=f"expected a {model.kind}"):
            types[kind].load(tmp_path / "db")
    with pytest.raises(UserError, match="expected a mode-adaptive network"):
        types["mann"].load(tmp_path / "pfnn")
    with pytest.raises(UserError, match="expected a motion database"):
        Database.load(tmp_path / "pfnn")
    for kind, of_kind in types.items():
        raw = bytearray((tmp_path / kind).read_bytes())
        raw[-5] ^= 1
        (tmp_path / kind).write_bytes(raw)
        with pytest.raises(UserError, match="checksum"):
            of_kind.load(tmp_path / kind)


@pytest.mark.parametrize("kind", MODELS)
def test_a_network_of_another_skeleton_is_refused(kind: str) -> None:
    model = MODELS[kind]()
    layout, others = model.layout, model.description.skeleton.names[1:]
    fewer = model.layout_type(layout.joints - 1, layout.contacts)
    with pytest.raises(ValueError, match=f"expected {layout.input_size} and {layout.output_size}"):
        replace(model, network=NETWORKS[kind](fewer.input_size, 8, fewer.output_size))
    with pytest.raises(ValueError, match="expected"):
        replace(model, contacts=others)


@pytest.mark.parametrize("kind", MODELS)
def test_bounds_that_are_none_are_refused(kind: str) -> None:
    model = MODELS[kind]()
    most = np.ones(model.layout.output_size, np.float32)
    replace(model, bounds=np.stack([most, most]))
    for wrong, what in (
        (np.stack([-most, most])[:, 1:], "bounds"),
        (np.stack([most, -most]), "least"),
        (np.stack([most, np.nan * most]), "least"),
    ):
        with pytest.raises(ValueError, match=what):
            replace(model, bounds=wrong)


def test_a_skeleton_without_a_ground_root_is_refused() -> None:
    model = MODELS["pfnn"]()
    skeleton = model.description.skeleton
    roles = {role: joint for role, joint in skeleton.roles.items() if role != "root"}
    with pytest.raises(ValueError, match="no ground root"):
        replace(model, description=replace(model.description, skeleton=skeleton.with_roles(roles)))
