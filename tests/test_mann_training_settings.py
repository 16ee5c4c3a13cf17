"""Settings of the training of mode-adaptive networks: recipes, sizes, epochs, faults."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from lmm.training.mann_settings import MannStageSettings, MannTraining, preset
from lmm.training.settings import PRESETS, RECIPES, load
from motion import config
from motion.config import ConfigError
from motion.errors import UserError


@pytest.mark.parametrize("recipe", RECIPES)
def test_presets_differ_in_length_only_by_order(recipe: str) -> None:
    stages = [preset(recipe, name).mann for name in PRESETS]
    assert stages[0].iterations < 100 < stages[1].iterations < stages[2].iterations
    assert all(stage.evaluate <= stage.iterations for stage in stages)
    same = {"iterations": 1, "evaluate": 1, "epochs": 0}
    assert len({dataclasses.replace(stage, **same) for stage in stages}) == 1


def test_the_reference_is_as_published() -> None:
    stage = preset("reference", "full").mann
    assert (stage.optimiser, stage.schedule, stage.learning_rate) == ("adamwr", "restarts", 1e-4)
    assert (stage.batch, stage.keep, stage.epochs, stage.hidden) == (32, 0.7, 150, (512, 512))
    assert (stage.experts, stage.gate, stage.window, stage.noise) == (4, 32, 1, 0)


def test_settings_go_through_plain_data_and_files(tmp_path: Path) -> None:
    one = preset("ours", "quick")
    assert config.from_dict(MannTraining, config.to_dict(one)) == one
    path = tmp_path / "own.toml"
    config.dump(one, path)
    assert load(path, MannTraining(preset="quick")) == one
    path.write_text("seed = 3\n[mann]\nexperts = 8\n")
    expected = dataclasses.replace(one, seed=3, mann=dataclasses.replace(one.mann, experts=8))
    assert load(path, one) == expected
    path.write_text("[pfnn]\nbatch = 3\n")
    with pytest.raises(UserError, match="pfnn"):
        load(path, one)


@pytest.mark.parametrize(
    "name, value", [("epochs", -1), ("experts", 0), ("gate", 0), ("joint_scale", 0.0), ("keep", 1.5)]
)
def test_what_is_out_of_range_is_named(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"{name}: .* is out of range"):
        MannStageSettings(**{name: value})
