"""lmm.mann.controller and steps: against the twin; what goes in; two feet and four."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mann_models
import numpy as np
import pytest
from locomotion_models import commands, drift, gliding

from lmm.locomotion import settings as settings_types
from lmm.locomotion import trajectory
from lmm.locomotion.labelling import labels_of
from lmm.locomotion.settings import LocomotionSettings
from lmm.mann import steps, steps_numpy
from lmm.mann.controller import CHARACTER, PAST, MannController
from lmm.mann.frames import frames
from lmm.mann.layout import to_axes
from lmm.mann.model import MannModel
from mm import build
from mm.control import Command
from mm.description import Description
from motion import quat

NO_LOCK = LocomotionSettings(foot_lock=False)


def state(count: int, model: MannModel, seed: int) -> dict:
    """Arguments of the kernels, characters in all sorts of states."""
    rng = np.random.default_rng(seed)
    joints = model.layout.joints

    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    characters = np.zeros(count, CHARACTER)
    for name in CHARACTER.names:
        characters[name] = numbers(*characters[name].shape)
    characters["gait"] = rng.dirichlet(np.ones(6), count)
    return {
        "characters": characters,
        "past": numbers(count, 60, PAST),
        "joints": numbers(count, joints, 3),
        "velocities": numbers(count, joints, 3),
        "axes": numbers(count, joints, 6),
        "x": numbers(count, model.layout.input_size),
        "y": numbers(count, model.layout.output_size),
        "heights": numbers(count, 12, 3),
        "positions": numbers(count, joints + 1, 3),
        "rotations": quat.normalize(numbers(count, joints + 1, 4)),
        "local_velocities": numbers(count, joints + 1, 3),
        "local_angular": numbers(count, joints + 1, 3),
        "contacts": np.zeros((count, 2), np.uint8),
    }


def run(kernels, name: str, model: MannModel, stretch: bool = True) -> dict:
    """What a kernel makes of the same state."""
    a, controller = state(7, model, 3), MannController(model)
    c, command, skeleton = a["characters"], commands(7), model.description.skeleton
    into, out = controller._into, controller._out
    settings = settings_types.record(LocomotionSettings(facing_halflife=0.1), 60, walk_mps=0.5, run_mps=1.5)
    if name == "plan":
        assert kernels.plan(
            c, a["past"], 17, command.velocity, command.yaw, command.turn_rate, command.crouch, settings,
            *trajectory.blend(10, 2.0, 5.0), controller._blend[2], a["joints"], a["velocities"], a["axes"],
            into, a["x"],
        ) == -1  # fmt: skip
    elif name == "stand":
        kernels.stand(c, a["heights"])
    elif name == "advance":
        obstacles = np.array([[0.2, 0.1, 0.5, 0.3, 0.1], [-1, 0, 0, 0, 0.4]], np.float32)
        kernels.advance(c, a["past"], 5, a["y"], out, settings, obstacles)
    else:
        kernels.show(
            c, a["y"], out, settings, skeleton.parents.astype(np.int64), skeleton.offsets.astype(np.float32),
            stretch, np.array([1, 0]), a["joints"], a["velocities"], a["axes"], a["positions"],
            a["rotations"], a["local_velocities"], a["local_angular"], a["contacts"],
            np.zeros((model.layout.joints, 4), np.float32),
        )  # fmt: skip
    return a


@pytest.mark.parametrize("name", ["plan", "stand", "show", "show rigid", "advance"])
def test_kernels_are_their_twins(name: str) -> None:
    model = mann_models.model()
    name, stretch = name.removesuffix(" rigid"), not name.endswith("rigid")
    given, one, other = state(7, model, 3), *(run(k, name, model, stretch) for k in (steps, steps_numpy))
    changed = False
    for key, value in one.items():
        pairs = [(value, other[key], given[key])]
        if value.dtype.names:
            pairs = [(value[n], other[key][n], given[key][n]) for n in value.dtype.names]
        for found, expected, before in pairs:
            np.testing.assert_allclose(found, expected, rtol=2e-3, atol=5e-4, err_msg=key)
            changed |= not np.array_equal(found, before)
    assert changed


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
    parts = controller.model.layout.unpack_inputs(controller._x)
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


def test_other_products() -> None:
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
