"""Going back and going on by other settings: every system that drives characters, against itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import lmm_models
import numpy as np
import pytest
from locomotion_models import CONTROLLERS, MODELS

from lmm import controller as controllers
from lmm.locomotion.settings import LocomotionSettings
from lmm.mixtures import COMBINATIONS
from mm.control import Command, Resumable
from mm.settings import Settings
from motion import springs
from motion.errors import UserError

OTHER = Settings(
    search_interval=0.25,
    ignore_radius=0.1,
    continuing_bias=0.4,
    velocity_halflife=0.1,
    synchronization="clamp",
    maximal_distance=0.05,
    foot_lock=False,
)


def make(name: str, settings: Any = None) -> Resumable:
    if name in CONTROLLERS:
        system = CONTROLLERS[name](MODELS[name](), count=2, settings=settings)
    else:
        database = lmm_models.database()
        model = lmm_models.model(database)
        learned = name.removeprefix("mm")
        system = controllers.controller(model, learned=learned, database=database, count=2, settings=settings)
    assert isinstance(system, Resumable)
    return system


def drive(system: Resumable, frames: range) -> dict[str, np.ndarray]:
    """Records [T, N, ...] of two who walk in a curve and turn about."""
    records = []
    for frame in frames:
        heading = 0.03 * frame if frame < 50 else -2.0
        command = Command.still(2)
        command.velocity[:] = [1.4 * np.sin(heading), 1.4 * np.cos(heading)]
        command.yaw[:] = springs.wrap(heading)
        system.step(command)
        records.append(system.record())
    return {name: np.stack([record[name] for record in records]) for name in records[0]}


NAMES = [*(f"mm{letters}" for letters in COMBINATIONS), *CONTROLLERS]


@pytest.mark.parametrize("name", NAMES)
def test_who_goes_back_does_the_same_again(name: str) -> None:
    system = make(name)
    drive(system, range(31))
    there = system.remember()
    once = drive(system, range(31, 80))
    system.reset(np.full((2, 2), 5.0, np.float32), np.ones(2, np.float32))
    system.recall(there)
    again = drive(system, range(31, 80))
    assert once.keys() == again.keys()
    for key, values in once.items():
        np.testing.assert_array_equal(values, again[key], err_msg=key)
    assert np.ptp(once["positions"][:, :, 0], axis=0).max() > 0


@pytest.mark.parametrize("name", NAMES)
def test_other_settings_do_what_they_do_in_a_system_made_with_them(name: str) -> None:
    other: Any = OTHER
    if name in CONTROLLERS:
        other = LocomotionSettings(
            position_bias=0.5, direction_bias=2.0, velocity_halflife=0.2, stretch=False, foot_lock=False
        )
    system, made = make(name), make(name, other)
    drive(system, range(31))
    made.recall(system.remember())
    before = system.remember()
    system.retune(other)
    retuned, expected = (drive(each, range(31, 80)) for each in (system, made))
    for key in ("positions", "rotations", "locked", "simulation_position"):
        np.testing.assert_array_equal(retuned[key], expected[key], err_msg=key)
    system.retune(type(other)())
    system.recall(before)
    untuned = drive(system, range(31, 80))
    assert any(not np.array_equal(retuned[key], untuned[key]) for key in ("positions", "rotations"))


def test_feet_are_locked_from_when_it_is_asked() -> None:
    system = make("mm", Settings(foot_lock=False))
    assert not drive(system, range(30))["locked"].any()
    system.retune(Settings())
    assert drive(system, range(30, 80))["locked"].any()


def test_what_an_index_is_built_with_stays() -> None:
    system = make("mm")
    with pytest.raises(UserError, match="ignore_end cannot change"):
        system.retune(replace(Settings(), ignore_end=0.1))
    assert system.settings == Settings()
