"""Settings of training: presets, TOML over them, faults that name the key."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from lmm.training import pfnn_settings
from lmm.training import settings as module
from lmm.training.settings import PRESETS, RECIPES, Common, Settings, StageSettings, preset
from motion import config
from motion.config import ConfigError
from motion.errors import UserError

STAGES = ("decompressor", "stepper", "projector")


@pytest.mark.parametrize("recipe", RECIPES)
def test_presets_differ_in_length_only_by_order(recipe: str) -> None:
    smoke, quick, full = (preset(recipe, name) for name in PRESETS)
    for name in (*STAGES, "closed_loop") if recipe == "ours" else STAGES:
        stages = [getattr(one, name) for one in (smoke, quick, full)]
        assert stages[0].iterations < 100 < stages[1].iterations < stages[2].iterations
        assert all(stage.evaluate <= stage.iterations for stage in stages)
    assert (quick.recipe, quick.preset) == (recipe, "quick")


def test_the_reference_is_as_published() -> None:
    found = preset("reference", "full")
    for name, window, layers in zip(STAGES, (2, 20, 1), (1, 2, 4), strict=True):
        stage = getattr(found, name)
        assert (stage.iterations, stage.batch, stage.learning_rate) == (500_000, 32, 1e-3)
        assert (stage.schedule, stage.optimiser, stage.average, stage.clip) == ("step", "adamw", 0, 0)
        assert (stage.window, stage.hidden) == (window, (512,) * layers)
    assert found.closed_loop is None and found.stepper_noise == 0
    assert (found.latent, found.compressor, found.precision) == (32, (512, 512, 512), "float32")


def test_an_unknown_preset_lists_those_known() -> None:
    with pytest.raises(UserError, match="no preset 'tiny'; choose from smoke, quick, full"):
        preset("ours", "tiny")
    with pytest.raises(UserError, match="no recipe 'theirs'; choose from ours, reference"):
        preset("theirs", "full")


@pytest.mark.parametrize("recipe", RECIPES)
def test_settings_go_through_plain_data(recipe: str, tmp_path: Path) -> None:
    one = preset(recipe, "quick")
    assert config.from_dict(Settings, config.to_dict(one)) == one
    config.dump(one, tmp_path / "settings.toml")
    base = Settings(recipe=recipe, preset="quick")
    assert module.load(tmp_path / "settings.toml", base) == one


def test_a_file_overrides_what_it_names_only(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text("latent = 16\n[stepper]\nbatch = 7\nhidden = [64, 64]\n")
    base = preset("ours", "quick")
    expected = dataclasses.replace(
        base, latent=16, stepper=dataclasses.replace(base.stepper, batch=7, hidden=(64, 64))
    )
    assert module.load(path, base) == expected


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("latent = 16\nlatents = 3\n", 2, "latents: unknown key; choose from recipe,"),
        ("[stepper]\nbatch = 8\nwindow = 1\n", 3, "stepper.window: 1 frame has no rate of change"),
        ("[stepper]\nbatch = 0\n", 2, "stepper.batch: 0 is out of range"),
        ('[projector]\nhidden = "512"\n', 2, "projector.hidden: expected a list"),
        ("[projector]\nhidden = []\n", 2, r"projector.hidden: \[\] are no layers"),
        ('[decompressor]\nschedule = "linear"\n', 2, "decompressor.schedule: 'linear' is no choice"),
        ("stepper = 3\n", 1, "stepper: expected a table"),
        ("compressor = [0]\n", 1, r"compressor: \[0\] are no layers"),
        ("held_out = 1.0\n", 1, "held_out: 1.0 is out of range"),
    ],
)
def test_faults_of_a_file_name_line_and_key(text: str, line: int, message: str, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=f"own.toml:{line}: {message}"):
        module.load(path, preset("ours", "full"))


@pytest.mark.parametrize(
    ("name", "asked", "base"),
    [
        ("recipe", "reference", preset("ours", "full")),
        ("preset", "smoke", preset("ours", "full")),
        ("configuration", "holden-xl", pfnn_settings.preset()),
    ],
)
def test_a_file_does_not_say_what_settings_begin_as(
    name: str, asked: str, base: Common, tmp_path: Path
) -> None:
    """Its networks would have the sizes of one recipe and be trained by the other."""
    path = tmp_path / "own.toml"
    path.write_text(f'seed = 3\n{name} = "{asked}"\n')
    with pytest.raises(UserError, match=f"own.toml:2: {name}: '{asked}' is .*; give --{name} {asked}$"):
        module.load(path, base)
    path.write_text(f'seed = 3\n{name} = "{getattr(base, name)}"\n')
    assert module.load(path, base) == dataclasses.replace(base, seed=3)


@pytest.mark.parametrize(
    "change",
    [
        {"iterations": 0},
        {"learning_rate": 0.0},
        {"learning_rate": float("inf")},
        {"average": 1.0},
        {"optimiser": "sgd"},
        {"warm_up": 1.5},
        {"clip": -1.0},
        {"evaluate": 0},
        {"hidden": (512, 0)},
        {"batch": "32"},
    ],
)
def test_what_is_out_of_range_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        StageSettings(**change)
