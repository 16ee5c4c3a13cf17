"""lmm.mann.controller: its own beside `lmm.locomotion.controller`: what goes in; two feet and four."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mann_models
import numpy as np
import pytest
from locomotion_models import HASTY, commands, drift, gliding

from lmm.locomotion.labelling import labels_of
from lmm.locomotion.settings import LocomotionSettings
from lmm.mann.controller import MannController
from lmm.mann.frames import frames
from lmm.mann.layout import to_axes
from mm import build
from mm.control import Command
from mm.description import Description
from motion import quat

NO_LOCK = LocomotionSettings(foot_lock=False)


def test_inputs_say_what_is_asked_and_what_was() -> None:
    """Somebody who was asked to stand, to walk to +X for a second, and now to +Z."""
    controller = MannController(mann_models.model(), settings=NO_LOCK)
    command = Command.still(1)
    for _ in range(60):
        controller.step(command)
    command.velocity[0], arrived = (1.5, 0), []
    for _ in range(60):
        controller.step(command)
        arrived.append(controller.characters["velocity"][0].copy())
    command.velocity[0] = 0, 0.5
    for _ in range(30):
        before = controller.characters["root"][0].copy(), controller.characters["velocity"][0].copy()
        predicted = controller.characters["future"][0].copy()
        controller.step(command)
    parts = controller.layout.unpack_inputs(controller._x)
    np.testing.assert_allclose(parts.speeds[0], np.where(np.arange(12) < 4, 1.5, 0.5), atol=1e-3)
    back = quat.from_yaw(-before[0][2])

    def local(vector: tuple[float, float]) -> np.ndarray:
        return quat.rotate(back, np.array([vector[0], 0, vector[1]]))[[0, 2]]

    np.testing.assert_allclose(parts.going[0, 6], local(tuple(before[1])), atol=1e-4)
    for k in range(3):  # velocities of 60, 50 and 40 frames before, when it went to +X
        np.testing.assert_allclose(parts.going[0, k], local(tuple(arrived[28 + 10 * k])), atol=1e-4)
    asked = local((0, 0.5))
    for k in range(1, 6):
        share = 1 - (1 - k / 6) ** controller.settings.position_bias
        expected = predicted[k, 4:] + share * (asked - predicted[k, 4:])
        np.testing.assert_allclose(parts.going[0, 6 + k], expected, atol=2e-3)
    np.testing.assert_allclose(parts.gaits[0].sum(axis=-1), 1, atol=1e-5)
    assert (parts.gaits[0, :, 0] < 0.2).all()


def test_other_products(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(*HASTY)
    controller = MannController(mann_models.model(), products="bfloat16", compiled=False)
    for _ in range(5):
        poses = controller.step(commands(1))
    assert np.isfinite(poses.positions).all()


def test_feet_are_free_where_contacts_are_not_told() -> None:
    model = gliding(mann_models.model(spread=1e-4), bent=True)
    toe, layout, network = model.description.skeleton.role("left_toe"), model.layout, model.network
    free, _ = drift(model, toe, settings=NO_LOCK)
    columns = np.delete(np.arange(layout.output_size), layout.outputs["contacts"])
    last = (*network.weights[:-1], network.weights[-1][..., columns].copy())
    biases = (*network.biases[:-1], network.biases[-1][:, columns].copy())
    ends = {name: getattr(network, name)[columns] for name in ("output_mean", "output_std")}
    silent = replace(model, contacts=(), network=replace(network, weights=last, biases=biases, **ends))
    loose, controller = drift(silent, toe)
    assert not controller.planted().any() and loose == pytest.approx(free, rel=1e-3)


def test_memory() -> None:
    model = mann_models.model()
    controller = MannController(model)
    memory = controller.memory()
    assert memory["network"] == model.network.weight_bytes
    assert memory["state"] == MannController(model, count=64).memory()["state"]


def test_a_dog_stands_on_four_feet(data: Path) -> None:
    """REFERENCE 5's gate of 19; all four feet of a body that glides are held."""
    clip = data / "dog_mann/D1_010_KAN01_004.bvh"
    database = build.build(clip, schema="quadruped39", mirror=False)
    found = frames(database, labels_of(database, phase=False))
    model = gliding(mann_models.model(spread=1e-4, found=Description.of(database, rigs=False)))
    assert model.network.gate_sizes[0] == 19
    layout = model.layout
    assert found.x.shape[1] == layout.input_size == 156 + 12 * (len(database.skeleton) - 1)
    assert found.y.shape[1] == layout.output_size
    pose = layout.unpack_outputs(found.y.mean(axis=0)[None])
    mean = model.network.output_mean
    mean[layout.outputs["positions"]] = pose.positions.ravel()
    mean[layout.outputs["rotations"]] = to_axes(pose.rotations).ravel()
    joint = database.skeleton.role("right_hand")
    # The mean of a gallop floats: feet lock at any height.
    height = float(pose.positions[0, joint - 1, 1])
    (held, one), (free, _) = (
        drift(model, joint, settings=LocomotionSettings(foot_height=height, foot_lock=lock))
        for lock in (True, False)
    )
    assert one.planted().shape == (1, 4) and one.planted().all()
    assert held < 0.2 * free
