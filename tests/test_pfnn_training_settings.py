"""Settings of the training of phase-functioned networks: recipes, sizes, configurations, faults."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from lmm.training.optimiser import rate
from lmm.training.pfnn_settings import CONFIGURATIONS, PhaseStageSettings, PhaseTraining, preset
from lmm.training.settings import PRESETS, RECIPES, load
from motion import config
from motion.config import ConfigError
from motion.errors import UserError


@pytest.mark.parametrize("recipe", RECIPES)
def test_presets_differ_in_length_only_by_order(recipe: str) -> None:
    stages = [preset(recipe, name).pfnn for name in PRESETS]
    assert stages[0].iterations < 100 < stages[1].iterations < stages[2].iterations
    assert all(stage.evaluate <= stage.iterations for stage in stages)
    same = {"iterations": 1, "evaluate": 1}
    assert len({dataclasses.replace(stage, **same) for stage in stages}) == 1


def test_the_reference_is_as_published() -> None:
    stage = preset("reference", "full").pfnn
    assert (stage.optimiser, stage.learning_rate, stage.batch, stage.keep) == ("adam", 1e-4, 32, 0.7)
    assert (stage.shrink, stage.hidden, stage.window, stage.noise) == (0.01, (512, 512), 1, 0)
    assert stage.iterations * stage.batch == 20 * 4_000_000
    assert rate(stage, 0) == rate(stage, stage.iterations - 1) == 1e-4


def test_configurations_are_a_layer_more_or_twice_as_long() -> None:
    holden, deep, long, large = (preset("ours", "quick", name) for name in CONFIGURATIONS)
    assert (holden.pfnn.hidden, deep.pfnn.hidden) == ((512,) * 2, (512,) * 3)
    assert long.pfnn == dataclasses.replace(holden.pfnn, iterations=2 * holden.pfnn.iterations)
    assert large.pfnn == holden.pfnn and preset("reference", "quick", "ava").pfnn.ordinary == 0
    assert [one.configuration for one in (holden, deep, long, large)] == list(CONFIGURATIONS)
    with pytest.raises(UserError, match="no configuration 'bear'; choose from holden, holden-xl"):
        preset("ours", "quick", "bear")


def test_settings_go_through_plain_data_and_files(tmp_path: Path) -> None:
    one = preset("ours", "quick", "holden-xl")
    assert config.from_dict(PhaseTraining, config.to_dict(one)) == one
    path = tmp_path / "own.toml"
    config.dump(one, path)
    assert load(path, PhaseTraining(preset="quick", configuration="holden-xl")) == one
    path.write_text("seed = 3\n[pfnn]\nbatch = 7\n")
    expected = dataclasses.replace(one, seed=3, pfnn=dataclasses.replace(one.pfnn, batch=7))
    assert load(path, one) == expected
    path.write_text("latent = 3\n")
    with pytest.raises(UserError, match="latent"):
        load(path, one)


@pytest.mark.parametrize(
    "name, value",
    [
        ("keep", 0.0),
        ("shrink", -1.0),
        ("noise", 11.0),
        ("phase_noise", -1.0),
        ("ordinary", -1),
        ("joint_scale", 0.0),
    ],
)
def test_what_is_out_of_range_is_named(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"{name}: .* is out of range"):
        PhaseStageSettings(**{name: value})
