"""lmm.pfnn.controller: the protocol of systems; N characters as one; rest, ground, obstacles, settings."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pfnn_models
import pytest

from lmm.locomotion.settings import LocomotionSettings
from lmm.pfnn.controller import STAGES, PhaseController
from mm import course as courses
from mm.control import Command
from mm.recording import Recording, record
from motion import kinematics, quat
from motion.config import ConfigError
from motion.errors import UserError


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


@pytest.mark.parametrize("mode", ["cubic", "linear", "constant"])
def test_a_character_does_the_same_in_a_crowd_bit_for_bit(mode) -> None:
    model, count = pfnn_models.model(), 256
    rng = np.random.default_rng(1)
    starts, yaws = rng.uniform(-9, 9, (count, 2)), rng.uniform(-3, 3, count)
    crowd = PhaseController(model, count=count, mode=mode)
    crowd.reset(starts, yaws)
    chosen = (0, 100, 255)
    alone = {n: PhaseController(model, mode=mode) for n in chosen}
    for n, one in alone.items():
        one.reset(starts[n : n + 1], yaws[n : n + 1])
    for frame in range(60):
        command = commands(count, frame // 20)
        poses = crowd.step(command)
        for n, one in alone.items():
            for name, array in one.step(part(command, n)).arrays().items():
                np.testing.assert_array_equal(array[0], poses.arrays()[name][n], err_msg=name)


def test_compiled_and_plain_do_the_same() -> None:
    model = pfnn_models.model()
    one, other = (PhaseController(model, count=4, compiled=compiled) for compiled in (True, False))
    for frame in range(30):
        command = commands(4, frame // 10)
        found, expected = one.step(command), other.step(command)
        np.testing.assert_allclose(found.positions, expected.positions, atol=2e-4)
        assert np.degrees(quat.angle_between(found.rotations, expected.rotations)).max() < 0.5


def test_reset_puts_everyone_at_rest_and_the_same_commands_do_the_same_again() -> None:
    controller = PhaseController(pfnn_models.model(), count=3)
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
    first = PhaseController(pfnn_models.model(), count=3)
    first.reset(starts, yaws)
    np.testing.assert_array_equal(first.step(commands(3)).positions, runs[0][0])


def test_where_characters_stand_does_not_matter_to_them() -> None:
    """Root-space poses are the same anywhere, but for rounding."""
    model = pfnn_models.model()
    controller = PhaseController(model, count=2, settings=LocomotionSettings(foot_lock=False))
    controller.reset([[0, 0], [40, -30]], [0, 2.0])
    for _ in range(40):
        command = Command.still(2)
        command.velocity[:] = [[0, 1.5], [1.5 * np.sin(2), 1.5 * np.cos(2)]]
        command.yaw[:] = 0, 2
        poses = controller.step(command)
    np.testing.assert_allclose(poses.positions[0, 1:], poses.positions[1, 1:], atol=1e-3)


def test_rates_are_those_of_the_poses_shown() -> None:
    controller = PhaseController(pfnn_models.model(), settings=LocomotionSettings(foot_lock=False))
    before = controller.step(commands(1)).copy()
    after = controller.step(commands(1))
    np.testing.assert_allclose(after.velocities, (after.positions - before.positions) * 60, atol=1e-3)
    turned = quat.mul(quat.exp(after.angular_velocities / 60), before.rotations)
    assert quat.angle_between(turned, after.rotations).max() < 1e-3


def test_bones_keep_their_length_when_told_to() -> None:
    controller = PhaseController(
        pfnn_models.model(), settings=LocomotionSettings(stretch=False, foot_lock=False)
    )
    poses = controller.step(commands(1))
    under = controller.skeleton.parents > 0
    np.testing.assert_allclose(poses.positions[0, under], controller.skeleton.offsets[under], atol=1e-6)


def test_it_is_driven_recorded_and_played_like_any_system(tmp_path) -> None:
    controller = PhaseController(pfnn_models.model(), count=2)
    run = record(controller, courses.load("start-stop"), seconds=1.0, progress=lambda it, **_: it)
    assert run["positions"].shape == (60, 2, len(controller.skeleton), 3)
    np.testing.assert_array_equal(run["simulation_position"], run.roots()[0])
    # It plays no frames, and neither searches nor jumps.
    assert not {"frame", "searched", "forced", "transition"} & set(run.arrays)
    np.testing.assert_allclose(run["gait"].sum(axis=-1), 1, atol=1e-5)
    # The sample of the present is the root.
    np.testing.assert_allclose(run["trajectory"][:, :, 6, :2], run.roots()[0], atol=1e-6)
    run.save(tmp_path / "run")
    np.testing.assert_array_equal(Recording.load(tmp_path / "run")["phase"], run["phase"])


def test_stages_are_timed_when_asked() -> None:
    controller = PhaseController(pfnn_models.model())
    controller.step(commands(1))
    assert not any(controller.stage_seconds.values())
    controller.timed = True
    controller.step(commands(1))
    assert tuple(controller.stage_seconds) == STAGES and all(t > 0 for t in controller.stage_seconds.values())


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_other_rates(fps: float) -> None:
    controller = PhaseController(pfnn_models.model(fps=fps))
    for _ in range(10):
        poses = controller.step(commands(1))
    assert controller.fps == fps and np.isfinite(poses.positions).all()


def test_the_root_stands_on_the_ground() -> None:
    controller = PhaseController(pfnn_models.model(), ground=lambda x, z: 0 * x + 2.5)
    flat = PhaseController(pfnn_models.model())
    for _ in range(5):
        high, low = controller.step(commands(1)), flat.step(commands(1))
        np.testing.assert_allclose(high.positions[0, 0], low.positions[0, 0] + [0, 2.5, 0], atol=1e-5)
        np.testing.assert_allclose(high.positions[0, 1:], low.positions[0, 1:], atol=1e-5)


def test_obstacles_stop_the_root() -> None:
    model = pfnn_models.model()
    mean = model.network.output_mean.copy()
    mean[model.layout.outputs["root_velocity"]] = 0, 3
    model = replace(model, network=replace(model.network, output_mean=mean))
    controller = PhaseController(model, obstacles=[[0, 2, 5, 0.1, 0]])
    command = Command.still(1)
    command.velocity[0, 1] = 3
    for _ in range(120):
        poses = controller.step(command)
    assert 1 < poses.positions[0, 0, 2] < 2 - 0.1 - 0.3 + 1e-4


def test_feet_in_contact_are_held() -> None:
    """All contacts on, the root drifts: the feet that are held stay, the free ones go along."""
    model = pfnn_models.model(spread=1e-4)
    mean, std = model.network.output_mean.copy(), model.network.output_std.copy()
    mean[model.layout.outputs["contacts"]], std[model.layout.outputs["contacts"]] = 1, 1e-4
    mean[model.layout.outputs["root_velocity"]], std[model.layout.outputs["root_velocity"]] = (0, 0.3), 1e-4
    for side in ("left", "right"):  # knees bent, so that legs can reach back
        knee = model.description.skeleton.role(f"{side}_leg") - 1
        mean[model.layout.outputs["positions"]][3 * knee + 2] += 0.25
    model = replace(model, network=replace(model.network, output_mean=mean, output_std=std))
    way = {}
    for lock in (True, False):
        controller = PhaseController(model, settings=LocomotionSettings(foot_lock=lock))
        command, feet = Command.still(1), []
        command.velocity[0, 1] = 0.3
        for _ in range(24):
            poses = controller.step(command)
            world, _ = kinematics.forward(controller.skeleton, poses.positions[0], poses.rotations[0])
            feet.append(world[controller.skeleton.role("left_toe"), [0, 2]])
        way[lock] = np.linalg.norm(feet[-1] - feet[6])
        assert controller.planted().all() == lock
    assert way[True] < 0.01 * way[False]


def test_gaits_follow_the_command() -> None:
    controller = PhaseController(pfnn_models.model(), settings=LocomotionSettings(jog_from=1.5, jog_to=2.0))
    for speed, crouch, gait in ((0, False, 0), (1.0, False, 1), (3.0, False, 2), (1.0, True, 3)):
        command = Command.still(1)
        command.velocity[0, 1], command.crouch[0] = speed, crouch
        for _ in range(120):
            controller.step(command)
        np.testing.assert_allclose(controller.characters["gait"][0], np.eye(6)[gait], atol=1e-3)


def test_memory_names_the_weights_of_the_mode() -> None:
    model = pfnn_models.model()
    sizes = {mode: PhaseController(model, mode=mode).memory() for mode in ("cubic", "linear", "constant")}
    for mode, memory in sizes.items():
        assert memory["network"] == model.network.weight_bytes(mode)
    assert sizes["cubic"]["state"] == PhaseController(model, count=64).memory()["state"]


def test_what_cannot_be_is_said() -> None:
    model = pfnn_models.model()
    with pytest.raises(UserError, match="0 characters"):
        PhaseController(model, count=0)
    with pytest.raises(UserError, match="no phase mode"):
        PhaseController(model, mode="square")  # type: ignore[arg-type]
    controller = PhaseController(model, count=2)
    with pytest.raises(UserError, match="give 2 characters"):
        controller.step(Command.still(3))
    whole = model.contacts
    with pytest.raises(UserError, match="nothing of the contact 'left_toe'"):
        PhaseController(replace(model, contacts=("left_heel", "left_hand", *whole[2:])))


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"position_bias": -1}, {"joint_smoothing": 1.0}, {"jog_from": 2.0, "jog_to": 1.0}):
        with pytest.raises(ConfigError):
            LocomotionSettings(**wrong)
