"""lmm.locomotion.controller, whatever the network: the protocol of systems; N as one; rest, ground, feet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from locomotion_models import CONTROLLERS, HASTY, MODELS, commands, drift, gliding, part, still_turned

from lmm.locomotion import bones, settings, steps, steps_numpy
from lmm.locomotion.controller import STAGES
from lmm.locomotion.settings import LocomotionSettings
from mm import courses
from mm.control import Command
from mm.driver import LOOKAHEAD, Driver
from mm.recording import Recording, record
from mm.wrapped import Wrapped
from motion import kinematics, quat
from motion.config import ConfigError
from motion.errors import UserError
from motion.skeleton import Skeleton


@pytest.mark.parametrize(
    ("kind", "of_model", "options"),
    [
        *(("pfnn", {}, {"mode": mode}) for mode in ("cubic", "linear", "constant")),
        *(("mann", {"experts": experts}, {}) for experts in (4, 8)),
    ],
)
def test_a_character_does_the_same_in_a_crowd_bit_for_bit(
    kind: str, of_model: dict[str, Any], options: dict[str, Any]
) -> None:
    model, count = MODELS[kind](**of_model), 256
    rng = np.random.default_rng(1)
    starts, yaws = rng.uniform(-9, 9, (count, 2)), rng.uniform(-3, 3, count)
    crowd = CONTROLLERS[kind](model, count=count, **options)
    crowd.reset(starts, yaws)
    alone = {n: CONTROLLERS[kind](model, **options) for n in (0, 100, 255)}
    for n, one in alone.items():
        one.reset(starts[n : n + 1], yaws[n : n + 1])
    for frame in range(60):
        command = commands(count, frame // 20)
        poses = crowd.step(command)
        for n, one in alone.items():
            for name, array in one.step(part(command, n)).arrays().items():
                np.testing.assert_array_equal(array[0], poses.arrays()[name][n], err_msg=name)


@pytest.mark.parametrize("kind", MODELS)
def test_compiled_and_plain_do_the_same(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(*HASTY)
    model = MODELS[kind]()
    one, other = (CONTROLLERS[kind](model, count=4, compiled=compiled) for compiled in (True, False))
    for frame in range(30):
        command = commands(4, frame // 10)
        found, expected = one.step(command), other.step(command)
        np.testing.assert_allclose(found.positions, expected.positions, atol=2e-4)
        assert np.degrees(quat.angle_between(found.rotations, expected.rotations)).max() < 0.5


@pytest.mark.parametrize("kind", MODELS)
def test_reset_puts_everyone_at_rest_and_the_same_commands_do_the_same_again(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), count=3)
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
    first = CONTROLLERS[kind](MODELS[kind](), count=3)
    first.reset(starts, yaws)
    np.testing.assert_array_equal(first.step(commands(3)).positions, runs[0][0])


@pytest.mark.parametrize("kind", MODELS)
def test_where_characters_stand_does_not_matter_to_them(kind: str) -> None:
    """Root-space poses are the same anywhere, but for rounding."""
    model = MODELS[kind]()
    controller = CONTROLLERS[kind](model, count=2, settings=LocomotionSettings(foot_lock=False))
    controller.reset([[0, 0], [40, -30]], [0, 2.0])
    for _ in range(40):
        command = Command.still(2)
        command.velocity[:] = [[0, 1.5], [1.5 * np.sin(2), 1.5 * np.cos(2)]]
        command.yaw[:] = 0, 2
        poses = controller.step(command)
    np.testing.assert_allclose(poses.positions[0, 1:], poses.positions[1, 1:], atol=1e-3)


@pytest.mark.parametrize("kind", MODELS)
def test_rates_are_those_of_the_poses_shown(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), settings=LocomotionSettings(foot_lock=False))
    before = controller.step(commands(1)).copy()
    after = controller.step(commands(1))
    np.testing.assert_allclose(after.velocities, (after.positions - before.positions) * 60, atol=1e-3)
    turned = quat.mul(quat.exp(after.angular_velocities / 60), before.rotations)
    assert quat.angle_between(turned, after.rotations).max() < 1e-3


@pytest.mark.parametrize("kind", MODELS)
def test_bones_keep_their_length(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), settings=LocomotionSettings(foot_lock=False))
    poses, skeleton = controller.step(commands(1)), controller.skeleton
    under = skeleton.parents > 0
    np.testing.assert_allclose(poses.positions[0, under], skeleton.offsets[under], atol=1e-6)


def test_two_bones_end_where_they_shall() -> None:
    """A thigh and a shin of 0.4 m whose joints are put where they can be, too near to each other, too far."""
    parents, aims = np.array([-1, 0, 1, 2]), np.array([[-1, -1], [2, 3], [3, -1], [-1, -1]])
    offsets = np.array([[0, 0, 0], [0, 1, 0], [0, -0.4, 0], [0, -0.4, 0]], np.float32)
    hip, rng = np.array([0.1, 0.9, 0.2]), np.random.default_rng(0)
    for asked, height in ((0.75, 0.12), (0.79, 0.1), (0.6, 0.3), (0.9, 0.05), (0.78, 0.0)):
        reach, side = np.array([0, -asked, 0]), np.array([0, 0, height])
        joints = np.array([hip, hip + reach / 2 + side, hip + reach], np.float32)
        turned = quat.normalize(rng.standard_normal((3, 4))).astype(np.float32)
        places, twin = np.zeros((3, 3), np.float32), turned[None].copy()
        twin = steps_numpy._keep_lengths(parents, offsets, aims, joints[None], twin)[0]
        steps._keep_lengths(parents, offsets, aims, joints, turned, places)
        np.testing.assert_allclose(turned, twin, atol=1e-5)
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        np.testing.assert_allclose(lengths, 0.4, atol=1e-5)
        bend = np.sqrt(max(0.4**2 - (asked / 2) ** 2, 0))
        if asked > 0.8:  # out of reach
            np.testing.assert_allclose(places[2], hip - np.array([0, 0.8, 0]), atol=1e-3)
        elif bend <= height + steps.BEND:
            np.testing.assert_allclose(places[2], joints[2], atol=1e-4)
            assert places[1, 2] > hip[2]
        else:  # nobody bends a straight leg this way and that
            assert abs(places[1, 2] - hip[2]) <= height + steps.BEND + 1e-6


@pytest.mark.parametrize("kind", MODELS)
def test_bones_stretch_when_told_to(kind: str) -> None:
    settings = LocomotionSettings(stretch=True, foot_lock=False)
    controller = CONTROLLERS[kind](MODELS[kind](), settings=settings)
    poses = controller.step(commands(1))
    poses.positions[0, 0], poses.rotations[0, 0] = 0, [1, 0, 0, 0]
    shown, _ = kinematics.forward(controller.skeleton, poses.positions[0], poses.rotations[0])
    np.testing.assert_allclose(shown[1:], controller._fed[0][0], atol=1e-4)


def test_bones_end_at_the_furthest_child_hubs_have_none_and_limbs_reach() -> None:
    joints = {
        "root": ("", (0, 0, 0)),
        "pelvis": ("root", (0, 1, 0)),  # two thighs, either way
        "thigh": ("pelvis", (0.11, 0, 0)),
        "other": ("pelvis", (-0.11, 0, 0)),
        "twist": ("thigh", (0, -0.2, 0)),  # a helper beside the bone
        "shin": ("thigh", (0.01, -0.42, 0)),
        "ankle": ("shin", (0, -0.4, 0.02)),
        "toe": ("ankle", (0, -0.05, 0.06)),  # near
        "helper": ("other", (0, -0.2, 0)),  # a helper within the bone
        "below": ("helper", (0, -0.2, 0)),
        "end": ("below", (0, -0.4, 0)),
        "arm": ("pelvis", (0, 0.5, 0)),
        "forearm": ("arm", (0, 0.3, 0)),
        "wrist": ("forearm", (0, 0.2, 0)),
        "hand": ("wrist", (0, 0.01, 0)),
    }
    names = list(joints)
    roles = {"left_up_leg": "thigh", "left_leg": "shin", "left_foot": "ankle"}
    roles |= {"left_arm": "arm", "left_forearm": "forearm", "left_hand": "hand"}
    roles |= {"right_up_leg": "other", "right_leg": "below", "right_foot": "end", "right_arm": "arm"}
    skeleton = Skeleton(
        tuple(names),
        np.array([names.index(parent) if parent else -1 for parent, _ in joints.values()]),
        np.array([offset for _, offset in joints.values()], float),
        {role: names.index(name) for role, name in roles.items()},
    )
    found = {
        names[joint]: tuple(names[end] if end >= 0 else None for end in ends)
        for joint, ends in enumerate(bones.aims(skeleton))
        if ends.max() >= 0
    }
    whole = {"thigh": ("shin", "ankle"), "shin": ("ankle", None)}
    whole |= {"arm": ("forearm", "wrist"), "forearm": ("wrist", None)}
    helped = {"other": ("helper", None), "helper": ("below", None), "below": ("end", None)}
    assert found == whole | helped


@pytest.mark.parametrize("kind", MODELS)
def test_stages_are_timed_when_asked(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind]())
    controller.step(commands(1))
    assert not any(controller.stage_seconds.values())
    controller.timed = True
    controller.step(commands(1))
    assert tuple(controller.stage_seconds) == STAGES and all(t > 0 for t in controller.stage_seconds.values())


@pytest.mark.parametrize("kind", MODELS)
def test_the_root_stands_on_the_ground(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), ground=lambda x, z: 0 * x + 2.5)
    flat = CONTROLLERS[kind](MODELS[kind]())
    for _ in range(5):
        high, low = controller.step(commands(1)), flat.step(commands(1))
        np.testing.assert_allclose(high.positions[0, 0], low.positions[0, 0] + [0, 2.5, 0], atol=1e-5)
        np.testing.assert_allclose(high.positions[0, 1:], low.positions[0, 1:], atol=1e-5)


@pytest.mark.parametrize("kind", MODELS)
def test_a_ground_that_is_none_is_told(kind: str) -> None:
    model = MODELS[kind]()
    with pytest.raises(UserError, match=r"a ground gives heights \(3,\) for x and z"):
        CONTROLLERS[kind](model, ground=lambda x, z: np.zeros(3))
    heights = [0.0, np.nan]  # where it begins, and ever after
    controller = CONTROLLERS[kind](model, ground=lambda x, z: 0 * x + heights[x.ndim > 1])
    with pytest.raises(UserError, match="a ground gives no finite heights"):
        controller.step(commands(1))


@pytest.mark.parametrize("kind", MODELS)
def test_obstacles_stop_the_root(kind: str) -> None:
    model = MODELS[kind]()
    mean = model.network.output_mean.copy()
    mean[model.layout.outputs["root_velocity"]] = 0, 3
    model = replace(model, network=replace(model.network, output_mean=mean))
    controller = CONTROLLERS[kind](model, obstacles=[[0, 2, 5, 0.1, 0]])
    command = Command.still(1)
    command.velocity[0, 1] = 3
    for _ in range(120):
        poses = controller.step(command)
    assert 1 < poses.positions[0, 0, 2] < 2 - 0.1 - 0.3 + 1e-4


@pytest.mark.parametrize("kind", MODELS)
def test_gaits_follow_the_command(kind: str) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), settings=LocomotionSettings(jog_from=1.5, jog_to=2.0))
    for speed, crouch, gait in ((0, False, 0), (1.0, False, 1), (3.0, False, 2), (1.0, True, 3)):
        command = Command.still(1)
        command.velocity[0, 1], command.crouch[0] = speed, crouch
        for _ in range(120):
            controller.step(command)
        np.testing.assert_allclose(controller.characters["gait"][0], np.eye(6)[gait], atol=1e-3)


def test_hardly_any_speed_is_half_a_walk() -> None:
    """Walks at 1 m/s and runs at 4 m/s meet at 2 m/s, each twice as far from the other."""
    made = settings.record(LocomotionSettings(), 60.0, walk_mps=1.0, run_mps=4.0)[0]
    np.testing.assert_allclose([made["jog_from"], made["jog_to"]], [1.95, 2.05], rtol=1e-6)
    own = settings.record(LocomotionSettings(jog_from=3.0), 60.0, walk_mps=1.0, run_mps=4.0)[0]
    np.testing.assert_allclose([own["jog_from"], own["jog_to"]], [3.0, 3.1], rtol=1e-6)
    still = settings.record(LocomotionSettings(), 60.0, walk_mps=0.0, run_mps=0.0)[0]
    assert np.isfinite([still["jog_from"], still["jog_to"]]).all() and still["jog_to"] > still["jog_from"]


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", MODELS)
def test_what_the_data_has_no_gait_of_is_asked_in_one_that_it_has(
    kind: str, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(*HASTY)
    model = MODELS[kind]()
    mean = model.network.input_mean.copy()
    mean[model.layout.inputs["gaits"]] = np.repeat([0.1, 0.895, 0.0, 0.005, 0.0, 0.0], 12)
    model = replace(model, network=replace(model.network, input_mean=mean))
    settings = LocomotionSettings(jog_from=1.5, jog_to=2.0)
    controller = CONTROLLERS[kind](model, settings=settings, compiled=compiled)
    for speed, crouch in ((3.0, False), (1.0, True)):
        command = Command.still(1)
        command.velocity[0, 1], command.crouch[0] = speed, crouch
        for _ in range(90):
            controller.step(command)
        np.testing.assert_allclose(controller.characters["gait"][0], np.eye(6)[1], atol=2e-3)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.9])
def test_roots_are_drawn_to_the_way_asked_by_a_share_of_their_speed(
    kind: str, compiled: bool, ratio: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network goes straight on at 1 m/s, whatever it is asked."""
    monkeypatch.setattr(*HASTY)
    model = still_turned(gliding(MODELS[kind](), speed=1.0))
    settings = LocomotionSettings(adjustment_ratio=ratio, velocity_halflife=0, gait_halflife=0)
    for degrees, drawn in ((0, 0.0), (30, 0.5), (-30, -0.5), (150, 0.0)):
        controller = CONTROLLERS[kind](model, settings=settings, compiled=compiled)
        controller.reset(np.zeros((1, 2)), np.zeros(1))
        asked, command = np.radians(degrees), Command.still(1)
        command.velocity[0] = 2 * np.sin(asked), 2 * np.cos(asked)
        before = controller.characters["root"][0, :2].copy()
        controller.step(command)
        went = 60 * (controller.characters["root"][0, :2] - before)
        # What is taken away of its way lies across that asked, and is all of it where that is no more.
        across = np.array([np.cos(asked), -np.sin(asked)])
        share = np.sign(drawn) * min(abs(drawn), ratio)
        np.testing.assert_allclose(went, [0, 1] + share * across, atol=2e-3)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", MODELS)
def test_what_is_put_out_is_followed_up_to_its_bounds(
    kind: str, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A network that goes on at 1 m/s goes at 0.4 where that is the most; none is slowed down by more."""
    monkeypatch.setattr(*HASTY)
    model = gliding(MODELS[kind](), speed=1.0)
    column = model.layout.outputs["root_velocity"].start + 1
    far = np.full(model.layout.output_size, 1e6, np.float32)
    near = far.copy()
    near[column] = 0.4
    command = Command.still(2)
    command.velocity[:] = 0, 2
    found = {}
    for name, most in (("none", None), ("far", far), ("near", near)):
        bounds = None if most is None else np.stack([-far, most])
        controller = CONTROLLERS[kind](replace(model, bounds=bounds), count=2, compiled=compiled)
        for _ in range(20):
            controller.step(command)
        found[name] = controller.characters["velocity"].copy(), controller.memory()["statistics"]
    np.testing.assert_array_equal(found["none"][0], found["far"][0])
    speeds = {name: np.linalg.norm(velocity, axis=1) for name, (velocity, _) in found.items()}
    np.testing.assert_allclose(speeds["near"], 0.4 * speeds["far"], rtol=1e-3)
    assert found["far"][1] - found["none"][1] == 8 * model.layout.output_size


@pytest.mark.parametrize("kind", MODELS)
def test_nobody_is_drawn_anywhere_who_is_asked_to_stand(kind: str) -> None:
    controller, command = CONTROLLERS[kind](MODELS[kind]()), Command.still(1)
    command.velocity[0] = 1, 1
    for frame in range(300):
        if frame == 10:
            command.velocity[:] = 0  # what is taken in of it becomes as small as numbers can be
        controller.step(command)
    assert np.isfinite(controller.characters["root"]).all()


@pytest.mark.parametrize("fps", [30.0, 120.0])
@pytest.mark.parametrize("kind", MODELS)
def test_other_rates(kind: str, fps: float) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](fps=fps))
    for _ in range(10):
        poses = controller.step(commands(1))
    assert controller.fps == fps and np.isfinite(poses.positions).all()


@pytest.mark.parametrize(
    ("kind", "own", "name"), [("pfnn", "phase", "pfnn-cubic"), ("mann", "experts", "mann-4")]
)
def test_it_is_driven_recorded_and_played_like_any_system(
    tmp_path: Path, kind: str, own: str, name: str
) -> None:
    controller = CONTROLLERS[kind](MODELS[kind](), count=2)
    run = record(controller, courses.load("start-stop"), seconds=1.0, progress=lambda it, **_: it)
    assert run["positions"].shape == (60, 2, len(controller.skeleton), 3) and controller.name == name
    np.testing.assert_array_equal(run["simulation_position"], run.roots()[0])
    # It plays no frames, and neither searches nor jumps.
    others = {"frame", "searched", "forced", "transition"} | ({"phase", "experts"} - {own})
    assert not others & set(run.arrays)
    np.testing.assert_allclose(run["gait"].sum(axis=-1), 1, atol=1e-5)
    # The sample of the present is the root.
    np.testing.assert_allclose(run["trajectory"][:, :, 6, :2], run.roots()[0], atol=1e-6)
    run.save(tmp_path / "run")
    np.testing.assert_array_equal(Recording.load(tmp_path / "run")[own], run[own])


@pytest.mark.parametrize("kind", MODELS)
def test_feet_in_contact_are_held(kind: str) -> None:
    """All contacts on, the root drifts: the feet that are held stay, the free ones go along."""
    model = gliding(MODELS[kind](spread=1e-4), bent=True)
    toe = model.description.skeleton.role("left_toe")
    held, free = (drift(model, toe, settings=LocomotionSettings(foot_lock=lock)) for lock in (True, False))
    assert held[1].planted().all() and not free[1].planted().any()
    assert held[0] < 0.01 * free[0]


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", MODELS)
def test_what_cannot_be_is_said(kind: str, compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(*HASTY)
    model, controllers = MODELS[kind](), CONTROLLERS[kind]
    with pytest.raises(UserError, match="0 characters"):
        controllers(model, count=0)
    controller = controllers(model, count=3, compiled=compiled)
    with pytest.raises(UserError, match="give 3 characters"):
        controller.step(Command.still(2))
    before, command = controller.characters.copy(), Command.still(3)
    command.velocity[1, 0] = np.nan
    with pytest.raises(UserError, match="character 1 is not finite"):
        controller.step(command)
    np.testing.assert_array_equal(controller.characters, before)
    others = [name.replace("toe", "hand") for name in model.contacts]
    with pytest.raises(UserError, match="nothing of the contact 'left_toe'"):
        controllers(replace(model, contacts=tuple(others)))


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"position_bias": -1}, {"joint_smoothing": 1.0}, {"jog_from": 2.0, "jog_to": 1.0}):
        with pytest.raises(ConfigError):
            LocomotionSettings(**wrong)


@pytest.mark.parametrize("kind", MODELS)
def test_who_drives_a_network_knows_that_it_turns_sooner_than_a_spring(kind: str) -> None:
    system = CONTROLLERS[kind](MODELS[kind]())
    assert 0 < system.lag < LOOKAHEAD / 4
    driver = Driver(courses.load("circle"))
    record(system, driver.course, seconds=1 / 60, driver=driver)
    assert driver.lag == [system.lag]
    several = Driver(courses.load("circle"), 2)
    several.know(Wrapped(system), SimpleNamespace())  # type: ignore[arg-type]
    np.testing.assert_array_equal(several.lag, [system.lag, LOOKAHEAD / 2])
