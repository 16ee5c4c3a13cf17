"""lmm.locomotion.steps and a network's own: against a window of 120 frames in the world, and the twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pfnn_models
import pytest
from locomotion_models import CONTROLLERS, MODELS, commands
from mann_models import NOWHERE

from lmm.locomotion import trajectory
from lmm.locomotion.controller import LocomotionController
from lmm.locomotion.settings import LocomotionSettings
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.layout import Inputs
from lmm.pfnn.model import PhaseModel
from mm.control import Command
from motion import foot_lock, kinematics, quat, springs

WINDOW, NOW = 120, 60


def turn(vectors: np.ndarray, yaw: float) -> np.ndarray:
    """Ground vectors [.., 2] (x, z) turned by yaw, +Z towards +X."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack(
        [c * vectors[..., 0] + s * vectors[..., 1], c * vectors[..., 1] - s * vectors[..., 0]], -1
    )


class Window:
    """The whole loop as REFERENCE 4.2 tells it: one character, 120 frames at 60 Hz, joints in the world."""

    def __init__(
        self, model: PhaseModel, settings: LocomotionSettings, start: PhaseController, ground
    ) -> None:
        self.model, self.settings, self.ground = model, settings, ground
        c = start.characters[0]
        self.path = np.tile(c["root"][:2].astype(float), (WINDOW, 1))
        self.yaws = np.full(WINDOW, float(c["root"][2]))
        self.gaits = np.tile(c["gait"].astype(float), (WINDOW, 1))
        # Somebody at rest is going nowhere: the future lies where the root is.
        self.phase, self.velocity, self.target = float(c["phase"]), np.zeros(2), float(c["root"][2])
        self.height = float(c["height"])
        joints, velocities = (fed[0].astype(float) for fed in start._fed)
        self.joints, self.joint_velocities = self.to_world(joints, self.height), self.turned(velocities)
        self.before = (self.path[NOW].copy(), self.yaws[NOW], self.height)

    def turned(self, vectors: np.ndarray, yaw: float | None = None) -> np.ndarray:
        return quat.rotate(quat.from_yaw(self.yaws[NOW] if yaw is None else yaw), vectors)

    def to_world(self, local: np.ndarray, height: float) -> np.ndarray:
        return self.turned(local) + np.array([self.path[NOW, 0], height, self.path[NOW, 1]])

    def step(self, velocity: np.ndarray, yaw: float) -> np.ndarray:
        """A frame; the joints [J, 3] shown."""
        s, layout = self.settings, self.model.layout
        kept = 0.5 ** (1 / (60 * s.velocity_halflife))
        self.velocity = velocity + kept * (self.velocity - velocity)
        self.target += (1 - 0.5 ** (1 / (60 * s.facing_halflife))) * springs.wrap(yaw - self.target)
        speed = np.linalg.norm(self.velocity)
        stand = 1 - min(speed / s.stand_speed, 1)
        jog = np.clip((speed - s.jog_from) / (s.jog_to - s.jog_from), 0, 1)
        asked = np.array([stand, (1 - stand) * (1 - jog), (1 - stand) * jog, 0, 0, 0])
        gait = self.gaits[NOW]
        gait = gait + (1 - 0.5 ** (1 / (60 * s.gait_halflife))) * (asked - gait)
        self.gaits[NOW:] = gait

        blended = self.path.copy()
        for i in range(NOW + 1, WINDOW):
            t = (i - NOW) / 60
            share = 1 - (1 - t) ** s.position_bias
            step = (1 - share) * (self.path[i] - self.path[i - 1]) + share * self.velocity / 60
            blended[i] = blended[i - 1] + step
            share = 1 - (1 - t) ** s.direction_bias
            self.yaws[i] += share * springs.wrap(self.target - self.yaws[i])
        self.path = blended

        at = np.arange(0, WINDOW, 10)
        root, root_yaw = self.path[NOW].copy(), self.yaws[NOW]
        facing = np.stack([np.sin(self.yaws[at]), np.cos(self.yaws[at])], -1)
        left = np.stack([facing[:, 1], -facing[:, 0]], -1)
        sides = np.stack([self.path[at] - 0.25 * left, self.path[at], self.path[at] + 0.25 * left], 1)
        heights = self.ground(sides[..., 0], sides[..., 1])
        self.height = heights[:, 1].mean()
        last, last_yaw, last_height = self.before
        old = self.turned(self.joints - [last[0], last_height, last[1]], -last_yaw)
        x = layout.pack_inputs(
            Inputs(
                turn(self.path[at] - root, -root_yaw)[None], turn(facing, -root_yaw)[None],
                self.gaits[at][None], old[None], self.turned(self.joint_velocities, -last_yaw)[None],
                (heights - self.height)[None],
            )
        )  # fmt: skip
        out = layout.unpack_outputs(self.model.network.evaluate(x, [self.phase]))
        self.joint_velocities = self.turned(out.velocities[0].astype(float))
        shown = self.to_world(out.positions[0].astype(float), self.height)
        moved = self.joints + self.joint_velocities / 60
        self.joints = s.joint_smoothing * moved + (1 - s.joint_smoothing) * shown
        self.before = (root, root_yaw, self.height)

        self.path[:NOW], self.yaws[:NOW] = self.path[1 : NOW + 1], self.yaws[1 : NOW + 1]
        self.gaits[:NOW] = self.gaits[1 : NOW + 1]
        going = (1 - gait[0]) ** 0.25
        self.path[NOW] = root + going * turn(out.root_velocity[0].astype(float), root_yaw) / 60
        self.yaws[NOW] = root_yaw + going * float(out.turn_rate[0]) / 60
        self.phase = (self.phase + (0.9 * going + 0.1) * float(out.phase_rate[0]) / 60) % (2 * np.pi)
        ahead = out.path[0].astype(float)
        ahead[0] = 0  # where the root is
        for i in range(NOW + 1, WINDOW):
            k, m = divmod(i - NOW, 10)
            after = min(k + 1, 5)
            here = (1 - m / 10) * ahead[k] + m / 10 * ahead[after]
            self.path[i] = self.path[NOW] + turn(here, self.yaws[NOW])
            direction = (1 - m / 10) * out.facing[0, k] + m / 10 * out.facing[0, after]
            self.yaws[i] = self.yaws[NOW] + np.arctan2(*direction)
        return self.joints


def hills(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return 0.2 * np.sin(x) + 0.1 * z


@pytest.mark.parametrize("bias", [0.5, 2.0])
def test_it_is_the_window_of_120_frames(bias: float) -> None:
    settings = LocomotionSettings(
        position_bias=bias, direction_bias=3.0, velocity_halflife=0.05, jog_from=1.0, jog_to=2.0,
        adjustment_ratio=0, stretch=True, foot_lock=False,
    )  # fmt: skip
    model = pfnn_models.model()
    controller = PhaseController(model, settings=settings, ground=hills)
    controller.reset([[3, -2]], [2.0])
    window = Window(model, settings, controller, hills)
    commands = [((0, 0), 2.0), ((1.2, 0.5), 0.5), ((-2, 1), -2.5), ((0, 0), -2.5)]
    command = Command.still(1)
    for frame in range(160):
        velocity, yaw = commands[frame // 40]
        command.velocity[0], command.yaw[0] = velocity, yaw
        poses = controller.step(command)
        expected = window.step(np.array(velocity, float), yaw)
        world, _ = kinematics.forward(controller.skeleton, poses.positions[0], poses.rotations[0])
        np.testing.assert_allclose(world[1:], expected, atol=2e-3, err_msg=f"frame {frame}")
    c = controller.characters[0]
    np.testing.assert_allclose(c["root"][:2], window.path[NOW], atol=2e-3)
    assert abs(springs.wrap(c["root"][2] - window.yaws[NOW])) < 2e-3
    assert abs(springs.wrap(c["phase"] - window.phase)) < 2e-3
    np.testing.assert_allclose(c["gait"], window.gaits[NOW], atol=1e-5)


@pytest.mark.parametrize("fps, frames", [(60, 10), (30, 5), (120, 20), (4, 1)])
def test_samples_are_a_sixth_of_a_second_apart(fps: float, frames: int) -> None:
    assert trajectory.interval(fps) == frames
    sums, turns = trajectory.blend(frames, 1.0, 1.0)
    np.testing.assert_allclose(turns, np.arange(1, 6) / 6, rtol=1e-6)  # bias 1: in proportion to time
    total = sum(i / (6 * frames) for i in range(1, 5 * frames + 1))
    assert sums.sum() == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("kind", MODELS)
def test_joints_are_followed_as_fast_at_any_rate(kind: str, fps: float) -> None:
    model = MODELS[kind](fps=fps)
    still = replace(model.network, output_std=np.full(model.layout.output_size, 1e-6, np.float32))
    controller = CONTROLLERS[kind](replace(model, network=still))
    joints = controller._fed[0]
    at_rest = joints.copy()
    joints += 1  # metre
    for _ in range(round(0.1 * fps)):
        controller.step(Command.still(1))
    np.testing.assert_allclose(joints - at_rest, 0.5**6, rtol=1e-3)  # half of it every 1/60 s


def any_state(kind: str, *, compiled: bool, stretch: bool = True) -> LocomotionController:
    """Characters in all sorts of states, the same at every call, with kernels compiled or not."""
    settings = LocomotionSettings(facing_halflife=0.1, position_bias=2.0, direction_bias=5.0, stretch=stretch)
    obstacles = [[0.2, 0.1, 0.5, 0.3, 0.1], [-1, 0, 0, 0, 0.4]]
    controller = CONTROLLERS[kind](MODELS[kind](), count=7, settings=settings, obstacles=obstacles)
    controller._steps = controller.kernels[0 if compiled else 1]
    rng = np.random.default_rng(3)
    for array in (*fields(controller.characters), *controller._held()[1:]):
        if array.dtype == np.float32:
            array[:] = rng.standard_normal(array.shape)
    controller.characters["gait"] = rng.dirichlet(np.ones(6), 7)
    controller.characters["crouch"] = rng.random(7)
    controller._shown.rotations[:] = quat.normalize(controller._shown.rotations)
    controller._head = 17
    return controller


def fields(characters: np.ndarray) -> list[np.ndarray]:
    return [characters[name] for name in characters.dtype.names]


def call(controller: LocomotionController, name: str) -> None:
    """One of its kernels, with all that a frame gives it."""
    c, everyone, rng = controller, commands(7), np.random.default_rng(4)
    y = rng.standard_normal((7, c.layout.output_size)).astype(np.float32)
    if c.name.startswith("mann"):
        columns = c.layout.outputs["rotations"].start + np.arange(6)
        y[: len(NOWHERE), columns], y[6, columns[2]] = NOWHERE, np.nan
    kernels, shown = c._steps, c._shown
    if name == "plan":
        wrong = kernels.plan(
            c.characters, c._past, c._head, everyone.velocity, everyone.yaw, everyone.turn_rate,
            everyone.crouch, c._settings, *c._blend, *c._fed, c._into, c._x,
        )  # fmt: skip
        assert wrong == -1
    elif name == "sample_points":
        kernels.sample_points(c.characters, c._into, c._x, c._points)
    elif name == "stand":
        c._stand(c.characters, c._points[..., 0].copy(), c._x)
    elif name == "show":
        kernels.show(
            c.characters, y, c._out, c._settings, c.skeleton.parents, c._offsets, c._aims,
            c._contact_columns, *c._fed, *shown.arrays().values(), c._contacts, c._turned, c._places,
        )  # fmt: skip
    else:
        kernels.advance(c.characters, c._past, c._head, y, c._out, c._settings, c._obstacles)


@pytest.mark.parametrize("name", ["plan", "sample_points", "stand", "show", "show rigid", "advance"])
@pytest.mark.parametrize("kind", MODELS)
def test_kernels_are_their_twins(kind: str, name: str) -> None:
    stretch, changed = not name.endswith("rigid"), False
    one, other = (any_state(kind, compiled=compiled, stretch=stretch) for compiled in (True, False))
    before = one.remember()[0]
    for controller in (one, other):
        call(controller, name.removesuffix(" rigid"))
    for n, (found, expected) in enumerate(zip(one._held(), other._held(), strict=True)):
        parts = [(found, expected)] if n else zip(fields(found), fields(expected), strict=True)
        for values in parts if found.dtype != foot_lock.FOOT else ():
            np.testing.assert_allclose(*values, rtol=2e-3, atol=5e-4, err_msg=f"array {n}")
        changed |= found.tobytes() != before[n].tobytes()
    assert changed


@pytest.mark.parametrize("compiled", [True, False])
def test_axes_without_direction_turn_nothing_and_no_numbers_stay_none(compiled: bool) -> None:
    controller = any_state("mann", compiled=compiled)
    call(controller, "show")
    np.testing.assert_allclose(controller._shown.rotations[: len(NOWHERE), 1], [[1, 0, 0, 0]] * len(NOWHERE))
    assert np.isnan(controller._shown.rotations[6, 1]).all()
