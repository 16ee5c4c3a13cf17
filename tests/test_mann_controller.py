"""lmm.mann.controller and steps: the protocol of systems; N as one; against the twin; two feet and four."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import mann_models
import numpy as np
import pytest

from lmm.locomotion import settings as settings_types
from lmm.locomotion import trajectory
from lmm.locomotion.labelling import labels_of
from lmm.locomotion.settings import LocomotionSettings
from lmm.mann import steps, steps_numpy
from lmm.mann.controller import CHARACTER, PAST, STAGES, MannController
from lmm.mann.frames import frames
from lmm.mann.layout import to_axes
from lmm.mann.model import MannModel
from mm import build
from mm import course as courses
from mm.control import Command
from mm.description import Description
from mm.recording import Recording, record
from motion import kinematics, quat
from motion.errors import UserError

NO_LOCK = LocomotionSettings(foot_lock=False)


def commands(count: int, seed: int = 0) -> Command:
    rng = np.random.default_rng(seed)
    command = Command.still(count)
    command.velocity[:] = rng.uniform(-2, 2, (count, 2))
    command.yaw[:] = rng.uniform(-3, 3, count)
    command.turn_rate[:] = rng.uniform(-1, 1, count)
    command.crouch[:] = rng.random(count) < 0.5
    return command


def part(command: Command, n: int) -> Command:
    return Command(*(getattr(command, field.name)[n : n + 1] for field in fields(Command)))


@pytest.mark.parametrize("experts", [4, 8])
def test_a_character_does_the_same_in_a_crowd_bit_for_bit(experts: int) -> None:
    model, count = mann_models.model(experts=experts), 256
    rng = np.random.default_rng(1)
    starts, yaws = rng.uniform(-9, 9, (count, 2)), rng.uniform(-3, 3, count)
    crowd = MannController(model, count=count)
    crowd.reset(starts, yaws)
    alone = {n: MannController(model) for n in (0, 100, 255)}
    for n, one in alone.items():
        one.reset(starts[n : n + 1], yaws[n : n + 1])
    for frame in range(60):
        command = commands(count, frame // 20)
        poses = crowd.step(command)
        for n, one in alone.items():
            for name, array in one.step(part(command, n)).arrays().items():
                np.testing.assert_array_equal(array[0], poses.arrays()[name][n], err_msg=name)


def test_compiled_and_plain_do_the_same() -> None:
    model = mann_models.model()
    one, other = (MannController(model, count=4, compiled=compiled) for compiled in (True, False))
    for frame in range(30):
        command = commands(4, frame // 10)
        found, expected = one.step(command), other.step(command)
        np.testing.assert_allclose(found.positions, expected.positions, atol=2e-4)
        assert np.degrees(quat.angle_between(found.rotations, expected.rotations)).max() < 0.5


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


def test_reset_puts_everyone_at_rest_and_the_same_commands_do_the_same_again() -> None:
    controller = MannController(mann_models.model(), count=3)
    starts, yaws = [[1, 2], [3, 4], [-5, 0]], [0.5, -3.0, 4.0]
    runs = []
    for _ in range(2):
        controller.reset(starts, yaws)
        rest = controller.poses().copy()
        np.testing.assert_allclose(rest.positions[:, 0][:, [0, 2]], starts)
        np.testing.assert_allclose(np.cos(quat.yaw(rest.rotations[:, 0]) - yaws), 1, atol=1e-6)
        np.testing.assert_allclose(rest.positions[1, 1:], rest.positions[0, 1:])
        assert not rest.velocities.any() and not controller.planted().any()
        runs.append(np.stack([controller.step(commands(3)).positions.copy() for _ in range(20)]))
    np.testing.assert_array_equal(*runs)
    first = MannController(mann_models.model(), count=3)
    first.reset(starts, yaws)
    np.testing.assert_array_equal(first.step(commands(3)).positions, runs[0][0])


def test_where_characters_stand_does_not_matter_to_them() -> None:
    controller = MannController(mann_models.model(), count=2, settings=NO_LOCK)
    controller.reset([[0, 0], [40, -30]], [0, 2.0])
    for _ in range(40):
        command = Command.still(2)
        command.velocity[:] = [[0, 1.5], [1.5 * np.sin(2), 1.5 * np.cos(2)]]
        command.yaw[:] = 0, 2
        poses = controller.step(command)
    np.testing.assert_allclose(poses.positions[0, 1:], poses.positions[1, 1:], atol=1e-3)


def test_it_is_driven_recorded_and_played_like_any_system(tmp_path: Path) -> None:
    controller = MannController(mann_models.model(), count=2)
    run_ = record(controller, courses.load("start-stop"), seconds=1.0, progress=lambda it, **_: it)
    assert run_["positions"].shape == (60, 2, len(controller.skeleton), 3)
    np.testing.assert_array_equal(run_["simulation_position"], run_.roots()[0])
    np.testing.assert_allclose(run_["experts"].sum(axis=-1), 1, atol=1e-5)
    np.testing.assert_allclose(run_["trajectory"][:, :, 6, :2], run_.roots()[0], atol=1e-6)
    run_.save(tmp_path / "run")
    np.testing.assert_array_equal(Recording.load(tmp_path / "run")["experts"], run_["experts"])
    assert "phase" not in run_.arrays and controller.name == "mann-4"


@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_other_rates_and_products(fps: float) -> None:
    controller = MannController(mann_models.model(fps=fps), products="bfloat16", compiled=False)
    for _ in range(5):
        poses = controller.step(commands(1))
    assert controller.fps == fps and np.isfinite(poses.positions).all()


def test_the_root_stands_on_the_ground() -> None:
    controller = MannController(mann_models.model(), ground=lambda x, z: 0 * x + 2.5)
    flat = MannController(mann_models.model())
    for _ in range(5):
        high, low = controller.step(commands(1)), flat.step(commands(1))
        np.testing.assert_allclose(high.positions[0, 0], low.positions[0, 0] + [0, 2.5, 0], atol=1e-5)
        np.testing.assert_allclose(high.positions[0, 1:], low.positions[0, 1:], atol=1e-5)


def drift(
    model: MannModel, lock: bool, joint: int, settings: LocomotionSettings = NO_LOCK
) -> tuple[float, MannController]:
    """How far a joint moves over 18 frames of a body that glides forward, all contacts on."""
    controller = MannController(model, settings=replace(settings, foot_lock=lock))
    command, places = Command.still(1), []
    command.velocity[0, 1] = 0.3
    for _ in range(24):
        poses = controller.step(command)
        world, _ = kinematics.forward(controller.skeleton, poses.positions[0], poses.rotations[0])
        places.append(world[joint, [0, 2]])
    return float(np.linalg.norm(places[-1] - places[6])), controller


def gliding(model: MannModel) -> MannModel:
    mean, std = model.network.output_mean.copy(), model.network.output_std.copy()
    outputs = model.layout.outputs
    mean[outputs["contacts"]], std[outputs["contacts"]] = 1, 1e-4
    mean[outputs["root_velocity"]], std[outputs["root_velocity"]] = (0, 0.3), 1e-4
    return replace(model, network=replace(model.network, output_mean=mean, output_std=std))


def test_feet_in_contact_are_held_where_contacts_are_told() -> None:
    model = gliding(mann_models.model(spread=1e-4))
    mean, skeleton = model.network.output_mean, model.description.skeleton
    for side in ("left", "right"):  # knees bent, so that legs can reach back
        mean[model.layout.outputs["positions"]][3 * (skeleton.role(f"{side}_leg") - 1) + 2] += 0.25
    toe = skeleton.role("left_toe")
    (held, one), (free, other) = (drift(model, lock, toe) for lock in (True, False))
    assert one.planted().all() and not other.planted().any()
    assert held < 0.01 * free
    layout = model.layout
    columns = np.delete(np.arange(layout.output_size), layout.outputs["contacts"])
    network = model.network
    last = (*network.weights[:-1], network.weights[-1][..., columns].copy())
    biases = (*network.biases[:-1], network.biases[-1][:, columns].copy())
    ends = {name: getattr(network, name)[columns] for name in ("output_mean", "output_std")}
    silent = replace(model, contacts=(), network=replace(network, weights=last, biases=biases, **ends))
    loose, controller = drift(silent, True, toe)
    assert not controller.planted().any() and loose == pytest.approx(free, rel=1e-3)


def test_memory_and_stages() -> None:
    model = mann_models.model()
    controller = MannController(model)
    memory = controller.memory()
    assert memory["network"] == model.network.weight_bytes
    assert memory["state"] == MannController(model, count=64).memory()["state"]
    controller.timed = True
    controller.step(commands(1))
    assert tuple(controller.stage_seconds) == STAGES and all(t > 0 for t in controller.stage_seconds.values())


def test_what_cannot_be_is_said() -> None:
    model = mann_models.model()
    with pytest.raises(UserError, match="0 characters"):
        MannController(model, count=0)
    controller = MannController(model, count=3)
    with pytest.raises(UserError, match="give 3 characters"):
        controller.step(Command.still(2))
    before, command = controller.characters.copy(), Command.still(3)
    command.velocity[1, 0] = np.nan
    with pytest.raises(UserError, match="character 1 is not finite"):
        controller.step(command)
    np.testing.assert_array_equal(controller.characters, before)
    with pytest.raises(UserError, match="nothing of the contact 'left_toe'"):
        MannController(replace(model, contacts=("left_hand", "right_hand")))


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
    ground = LocomotionSettings(foot_height=float(pose.positions[0, joint - 1, 1]))
    (held, one), (free, _) = (drift(model, lock, joint, ground) for lock in (True, False))
    assert one.planted().shape == (1, 4) and one.planted().all()
    assert held < 0.2 * free
