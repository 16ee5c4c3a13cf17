"""Characters driven by a phase-functioned network: what is asked goes in by the trajectory (REFERENCE 4.2).

Each step: take commands in and blend the trajectory; ask the ground for its heights; evaluate the network;
show the pose; move root, phase and trajectory on; hold the feet.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat
from mm import settings as mm_settings
from mm.control import Command
from motion import foot_lock, foot_lock_numpy, springs
from motion.errors import UserError
from motion.pose import Poses

from ..evaluator import Products
from . import settings as settings_types
from . import steps, steps_numpy, trajectory
from .evaluator import PhaseEvaluator
from .layout import SAMPLES, SIDES
from .model import PhaseModel
from .settings import PhaseSettings
from .spline import Mode

STAGES = ("trajectory", "network", "pose", "foot lock")
SETTLING = 3.0  # seconds in which a character comes to rest out of the mean pose
ANY_HEIGHT = 1e6  # metres; feet lock as high as they stand where the ground is not flat


class PhaseController:
    """Drives N characters by commands; implements `mm.control.System`.

    Parameters
    ----------
    model : the network and its skeleton.
    count : N.
    mode : how weights are made of the phase, see `lmm.pfnn.spline`.
    products : of the network's numbers, see `lmm.pfnn.evaluator`.
    settings : see `lmm.pfnn.settings.PhaseSettings`.
    ground : any function of heights (`features.terrain.Ground`); flat at 0 by default.
    obstacles : float [M, 5], see `mm.controller.Controller`; roots keep off them.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    name : what reports call this system.

    Whatever N, a character does the same: bit for bit, with bfloat16 products but for rounding.
    `stage_seconds` holds the time of the last step by stage when `timed` is set.
    """

    def __init__(
        self,
        model: PhaseModel,
        *,
        count: int = 1,
        mode: Mode = "cubic",
        products: Products = "float32",
        settings: PhaseSettings | None = None,
        ground: Ground = flat,
        obstacles: ArrayLike = (),
        compiled: bool = True,
        name: str | None = None,
    ) -> None:
        if count < 1:
            raise UserError(f"{count} characters", remedy="ask for one or more")
        self.model, self.description, self.count = model, model.description, count
        description, layout = model.description, model.layout
        self.settings = settings = settings or PhaseSettings()
        self.skeleton, self.fps = description.skeleton, description.fps
        self.name = name or f"pfnn-{mode}"
        self.network = PhaseEvaluator(
            model.network, mode=mode, products=products, count=count, compiled=compiled
        )
        self._ground = None if ground is flat else ground
        self._steps: Any = steps if compiled else steps_numpy
        self._lock_feet = (foot_lock if compiled else foot_lock_numpy).lock_feet
        self._settings = settings_types.record(
            settings, self.fps, walk_mps=description.walk_mps, run_mps=description.run_mps
        )
        spacing = trajectory.interval(self.fps)
        self._blend = trajectory.blend(spacing, settings.position_bias, settings.direction_bias)
        self._obstacles = np.asarray(obstacles, np.float32).reshape(-1, 5)
        self._into, self._out = (
            np.array([columns.start for columns in blocks.values()], np.int64)
            for blocks in (layout.inputs, layout.outputs)
        )
        self._parents = np.ascontiguousarray(self.skeleton.parents, np.int64)
        self._offsets = self.skeleton.offsets.astype(np.float32)

        joints, feet = len(self.skeleton), description.contact_roles
        missing = [role for role in feet if role not in model.contacts]
        if missing:
            raise UserError(f"the network tells nothing of the contact {missing[0]!r}")
        self._contact_columns = np.array([model.contacts.index(role) for role in feet], np.int64)
        self._legs = description.feet(settings.foot_height) if settings.foot_lock else None
        self._lock_settings = mm_settings.record(
            mm_settings.Settings(foot_halflife=settings.foot_halflife, unlock_radius=settings.unlock_radius),
            self.fps,
        )
        if self._legs is not None:
            self._lock_heights = self._legs.heights.copy()
            if self._ground is not None:
                self._lock_heights[:] = -ANY_HEIGHT, ANY_HEIGHT

        self.characters = np.zeros(count, trajectory.CHARACTER)
        self._past = trajectory.ring(count, spacing)
        self._head = 0
        self._joints = np.zeros((count, joints - 1, 3), np.float32)
        self._velocities = np.zeros((count, joints - 1, 3), np.float32)
        self._x = np.zeros((count, layout.input_size), np.float32)
        self._points = np.zeros((count, SAMPLES, SIDES, 2), np.float32)
        self._turned = np.zeros((joints - 1, 4), np.float32)
        self._shown = Poses.empty(count, joints)
        # What is shown differs from what the network goes on from by the locked legs' rotations.
        self._rotations = self._shown.rotations.copy()
        shown = self._shown
        self._pose = Poses(shown.positions, self._rotations, shown.velocities, shown.angular_velocities)
        self._contacts = np.zeros((count, len(feet)), np.uint8)
        self._feet = np.zeros((count, len(feet)), foot_lock.FOOT)
        self._command = Command.still(count)
        self.timed = False
        self._lap_start = 0.0
        self.stage_seconds = dict.fromkeys(STAGES, 0.0)
        self._rest = self._settle()
        self.reset(np.zeros((count, 2), np.float32), np.zeros(count, np.float32))

    def reset(self, positions: ArrayLike, yaws: ArrayLike) -> None:
        """Put the characters at positions [N, 2] (x, z), facing yaws [N], at rest."""
        self._place(slice(None), positions, yaws)
        character, joints, velocities, pose, contacts = self._rest
        for name in ("phase", "gait"):
            self.characters[name] = character[name]
        self._joints[:], self._velocities[:] = joints, velocities
        self._shown[:] = pose
        self._contacts[:] = contacts
        self._past[:, :, 4:] = character["gait"]
        self._stand_on_ground()
        root, shown = self.characters["root"], self._shown
        shown.positions[:, 0] = np.stack([root[:, 0], self.characters["height"], root[:, 1]], axis=-1)
        shown.rotations[:, 0] = 0
        shown.rotations[:, 0, 0], shown.rotations[:, 0, 2] = np.cos(root[:, 2] / 2), np.sin(root[:, 2] / 2)
        for rates in (shown.velocities, shown.angular_velocities):
            rates[:] = 0
        np.copyto(self._rotations, shown.rotations)

    def _place(self, who: slice, positions: ArrayLike, yaws: ArrayLike) -> None:
        """Characters without motion, whose trajectory is where they stand."""
        characters, past = self.characters[who], self._past[who]
        yaws = springs.wrap(np.broadcast_to(np.asarray(yaws, np.float32), len(characters)))
        characters[:] = np.zeros((), trajectory.CHARACTER)
        characters["root"][:, :2], characters["root"][:, 2] = np.asarray(positions, np.float32), yaws
        characters["target_yaw"], characters["shown"] = yaws, characters["root"]
        characters["future"][:, :, 3] = 1
        past[:, :, :2] = characters["root"][:, None, :2]
        past[:, :, 2], past[:, :, 3] = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
        self._feet[who] = np.zeros((), foot_lock.FOOT)
        self._feet["target"][who] = np.nan

    def _stand_on_ground(self) -> None:
        if self._ground is not None:
            x, z = self.characters["root"][:, 0], self.characters["root"][:, 1]
            self.characters["height"] = self.characters["shown_height"] = self._ground(x, z)

    def _settle(self) -> tuple[Any, ...]:
        """A character at rest: what the network makes of its mean pose when it is asked to stand."""
        one, command, layout = slice(0, 1), Command.still(1), self.model.layout
        self._place(one, np.zeros((1, 2)), np.zeros(1))
        self.characters["gait"][0] = self._past[0, :, 4:] = np.eye(len(self.characters["gait"][0]))[0]
        mean = layout.unpack_outputs(self.model.network.output_mean[None])
        self._joints[one], self._velocities[one] = mean.positions, 0
        for _ in range(round(SETTLING * self.fps)):
            self._frame(one, command, None)
        arrays = (self._joints[0], self._velocities[0], self._shown[one].copy(), self._contacts[0])
        return (self.characters[0].copy(), *(array.copy() for array in arrays))

    def step(self, command: Command) -> Poses:
        """Advance one frame, 1 / fps. Returns the poses [N] shown, valid until the next step."""
        if command.velocity.shape != (self.count, 2) or command.yaw.shape != (self.count,):
            raise UserError(
                f"commands with velocity {command.velocity.shape} and yaw {command.yaw.shape}",
                remedy=f"give {self.count} characters ({self.count}, 2) and ({self.count},)",
            )
        self._lap_start = time.perf_counter()
        wrong = self._frame(slice(None), command, self._ground)
        if wrong >= 0:
            raise UserError(f"the command of character {wrong} is not finite", remedy="give it numbers")
        self._command = command
        shown = self._shown
        np.copyto(self._rotations, shown.rotations)
        if self._legs is not None:
            legs = self._legs
            self._lock_feet(
                self._feet, self._contacts, self._lock_settings, self._parents, legs.needed, legs.joints,
                legs.points, legs.hinges, self._lock_heights, shown.positions, self._rotations,
            )  # fmt: skip
        self._lap("foot lock")
        return self._pose

    def _frame(self, who: slice, command: Command, ground: Ground | None) -> int:
        """A frame of some characters, up to their feet; the first whose command is not finite, or -1."""
        characters, past, x, kernels = self.characters[who], self._past[who], self._x[who], self._steps
        joints, velocities = self._joints[who], self._velocities[who]
        wrong = kernels.plan(
            characters, past, self._head, command.velocity, command.yaw, command.turn_rate, command.crouch,
            self._settings, *self._blend, joints, velocities, self._into, x,
        )  # fmt: skip
        if wrong >= 0:
            return wrong
        if ground is not None:
            kernels.sample_points(characters, self._into, x, self._points)
            heights = np.asarray(ground(self._points[..., 0], self._points[..., 1]), np.float32)
            kernels.write_heights(characters, heights, self._into, x)
        self._lap("trajectory")
        y = self.network.evaluate(x, characters["phase"])
        self._lap("network")
        shown = self._shown
        kernels.show(
            characters, y, self._out, self._settings, self._parents, self._offsets, self.settings.stretch,
            self._contact_columns, joints, velocities, shown.positions[who], shown.rotations[who],
            shown.velocities[who], shown.angular_velocities[who], self._contacts[who], self._turned,
        )  # fmt: skip
        self._head = (self._head + 1) % past.shape[1]
        kernels.advance(characters, past, self._head, y, self._out, self._settings, self._obstacles)
        self._lap("pose")
        return -1

    def _lap(self, stage: str) -> None:
        """Book the time since the last lap under a stage."""
        if self.timed:
            now = time.perf_counter()
            self.stage_seconds[stage] = now - self._lap_start
            self._lap_start = now

    def poses(self) -> Poses:
        """The poses [N] that the last step showed, valid until the next one."""
        return self._pose

    def planted(self) -> NDArray[np.uint8]:
        """Which feet the last step held on the ground [N, C]."""
        return self._feet["locked"].astype(np.uint8)

    def record(self) -> dict[str, NDArray]:
        """What the last step did; copies with leading axis N. Keys: see `mm.recording`.

        trajectory [N, 12, 3] is what the network was given; phase [N], radians, and gait [N, 6] are those of
        the frame to come.
        """
        c, nothing = self.characters, np.zeros(self.count, np.bool_)
        return {
            "command_velocity": self._command.velocity.astype(np.float32),
            "command_yaw": self._command.yaw.astype(np.float32),
            "simulation_position": c["shown"][:, :2].copy(),
            "simulation_velocity": c["velocity"].copy(),
            "simulation_yaw": c["shown"][:, 2].copy(),
            "positions": self._shown.positions.copy(),
            "rotations": self._rotations.copy(),
            "contacts": self._contacts.copy(),
            "locked": self._feet["locked"].copy(),
            "frame": np.full(self.count, -1, np.int32),
            "searched": nothing,
            "forced": nothing.copy(),
            "transition": nothing.copy(),
            "trajectory": trajectory.world(c["shown"], self._x, int(self._into[0])),
            "phase": c["phase"].copy(),
            "gait": c["gait"].copy(),
        }

    def memory(self) -> dict[str, int]:
        """Bytes by part: the mode's weights, their padding and statistics, the state of one character."""
        state = self.characters, self._past, self._joints, self._velocities, self._x, self._points
        more = self._contacts, self._feet, self._rotations, *self._shown.arrays().values()
        return self.network.memory() | {
            "character": sum(array.nbytes for array in (*state, *more)) // self.count
        }
