"""Characters that a network drives by their trajectory: what is asked goes in by it (REFERENCE 4.2).

Each step: take commands in and blend the trajectory; ask the ground for its heights; evaluate the network;
show the pose; move root and trajectory on; hold the feet.
"""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground, flat, heights
from mm import settings as mm_settings
from mm.control import Command
from motion import foot_lock, foot_lock_numpy, springs
from motion.errors import NotFinite, UserError
from motion.plain import plain
from motion.pose import Poses

from ..evaluator import Products
from . import bones, trajectory
from . import settings as settings_types
from .model import LocomotionModel
from .settings import LocomotionSettings
from .window import GAITS, PRESENT, SAMPLES, SIDES

STAGES = ("trajectory", "network", "pose", "foot lock")
FIRST = ("path", "facing", "gaits", "positions", "velocities")  # blocks of inputs that all kernels want
SETTLING = 3.0  # seconds in which a character comes to rest out of the mean pose
RARE = 0.01  # share of the data's frames; a gait that is no more than that was not learned
ANY_HEIGHT = 1e6  # metres; feet lock as high as they stand where the ground is not flat


class LocomotionController:
    """Drives N characters by commands; implements `mm.control.System`.

    Whatever N, a character does the same: bit for bit, with bfloat16 products but for rounding.
    `stage_seconds` holds the time of the last step by stage when `timed` is set. What is a network's own:
    its evaluator, kernels, what a character remembers, and how it stands on the ground. The model's weights
    are not held: the evaluator has its own.

    Parameters
    ----------
    model : the network and its skeleton.
    count : N.
    products : of the network's numbers, see the evaluators.
    settings : see `lmm.locomotion.settings.LocomotionSettings`.
    ground : any function of heights (`features.terrain.Ground`); flat at 0 by default. Errors: see
        `features.terrain.heights`.
    obstacles : float [M, 5], see `mm.controller.Controller`; roots keep off them.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    name : what reports call this system.
    """

    kernels: ClassVar[tuple[Any, Any]]  # a module such as `lmm.pfnn.steps`, and its twin
    character: ClassVar[np.dtype] = trajectory.character()
    past: ClassVar[int] = trajectory.PAST  # numbers of a past frame
    lag = 0.05  # seconds, see `mm.control.lag_of`: they turn within 0.03 to 0.08 s, whatever the biases
    fed: ClassVar[tuple[int, ...]] = (3, 3)  # numbers of a joint that it is given of its own frame before

    def __init__(
        self,
        model: LocomotionModel,
        *,
        count: int = 1,
        products: Products = "float32",
        settings: LocomotionSettings | None = None,
        ground: Ground = flat,
        obstacles: ArrayLike = (),
        compiled: bool = True,
        name: str | None = None,
    ) -> None:
        if count < 1:
            raise UserError(f"{count} characters", remedy="ask for one or more")
        self.description, self.layout, self.count = model.description, model.layout, count
        self.network = self._evaluator(model.network, products, count, compiled)
        self._steps, self._bounds = self.kernels[0 if compiled else 1], model.bounds
        self._kind, self._tells_contacts = model.kind, bool(model.contacts)
        description, layout = model.description, model.layout
        self.skeleton, self.fps = description.skeleton, description.fps
        self.name = name or f"{model.family}-{self.network.variant}"
        self._ground = None if ground is flat else ground
        self._lock_feet = (foot_lock if compiled else foot_lock_numpy).lock_feet
        spacing = trajectory.interval(self.fps)
        self._obstacles = np.asarray(obstacles, np.float32).reshape(-1, 5)
        # Where blocks begin: of inputs those first that any network has, then its own.
        inputs = [layout.inputs[block] for block in dict.fromkeys((*FIRST, *layout.inputs))]
        self._into, self._out = (
            np.array([columns.start for columns in blocks], np.int64)
            for blocks in (inputs, layout.outputs.values())
        )
        self._offsets = self.skeleton.offsets.astype(np.float32)

        joints, feet = len(self.skeleton), description.contact_roles
        told = feet if model.contacts else ()
        missing = [role for role in told if role not in model.contacts]
        if missing:
            raise UserError(f"the network tells nothing of the contact {missing[0]!r}")
        self._contact_columns = np.array([model.contacts.index(role) for role in told], np.int64)
        gaits = layout.inputs["gaits"].start + SAMPLES * np.arange(len(GAITS)) + PRESENT
        shares = dict(zip(GAITS, model.network.input_mean[gaits].tolist(), strict=True))
        self._knows = {"jogs": shares["jog"] > RARE, "crouches": shares["crouch"] > RARE}
        self._take_settings(settings or LocomotionSettings())

        self.characters = np.zeros(count, self.character)
        self._past = trajectory.ring(count, spacing, self.past)
        self._head = 0
        self._fed = tuple(np.zeros((count, joints - 1, numbers), np.float32) for numbers in self.fed)
        self._x = np.zeros((count, layout.input_size), np.float32)
        self._points = np.zeros((count, SAMPLES, SIDES, 2), np.float32)
        self._turned = np.zeros((joints - 1, 4), np.float32)
        self._places = np.zeros((joints - 1, 3), np.float32)
        self._shown = Poses.empty(count, joints)
        # What is shown differs from what the network goes on from by the locked legs' rotations.
        self._rotations = self._shown.rotations.copy()
        shown = self._shown
        self._pose = Poses(shown.positions, self._rotations, shown.velocities, shown.angular_velocities)
        self._world = np.zeros((joints, 3), np.float32), np.zeros((joints, 4), np.float32)
        self._contacts = np.zeros((count, len(feet)), np.uint8)
        self._feet = np.zeros((count, len(feet)), foot_lock.FOOT)
        self._command = Command.still(count)
        self.timed = False
        self._lap_start = 0.0
        self.stage_seconds = dict.fromkeys(STAGES, 0.0)
        self._rest = self._settle(model.network.output_mean)
        self.reset(np.zeros((count, 2), np.float32), np.zeros(count, np.float32))

    def _evaluator(self, network: Any, products: Products, count: int, compiled: bool) -> Any:
        """A network at run time, which tells its `variant` and `memory`."""
        raise NotImplementedError

    def _take_settings(self, settings: LocomotionSettings) -> None:
        description = self.description
        # The legs first: a skeleton that lacks them leaves all as it was.
        locks = settings.foot_lock and self._tells_contacts
        self._legs = description.feet(settings.foot_height) if locks else None
        if self._legs is not None:
            self._lock_heights = self._legs.heights
            if self._ground is not None:
                anywhere = np.empty_like(self._lock_heights)
                anywhere[:] = -ANY_HEIGHT, ANY_HEIGHT
                self._lock_heights = plain(anywhere)
        self.settings = settings
        self._aims = np.empty((0, 2), np.int64) if settings.stretch else bones.aims(description.skeleton)
        self._settings = settings_types.record(
            settings, self.fps, walk_mps=description.walk_mps, run_mps=description.run_mps, **self._knows
        )
        self._lock_settings = mm_settings.record(
            mm_settings.Settings(foot_halflife=settings.foot_halflife, unlock_radius=settings.unlock_radius),
            self.fps,
        )
        # What the kernels blend what is asked by.
        self._blend: tuple[NDArray, ...] = self._blends(trajectory.interval(self.fps))

    def _blends(self, spacing: int) -> tuple[NDArray, ...]:
        return trajectory.blend(spacing, self.settings.position_bias, self.settings.direction_bias)

    def retune(self, settings: LocomotionSettings) -> None:
        """Go on by other settings from the next step on."""
        unlocked = self._legs is None
        self._take_settings(settings)
        if unlocked:
            self._release_feet(slice(None))

    def _frame(self, who: slice, command: Command, ground: Ground | None) -> int:
        """A frame of some characters, up to their feet; the first whose command is not finite, or -1."""
        characters, past, x, kernels = self.characters[who], self._past[who], self._x[who], self._steps
        fed = tuple(array[who] for array in self._fed)
        wrong = kernels.plan(
            characters, past, self._head, command.velocity, command.yaw, command.turn_rate, command.crouch,
            self._settings, *self._blend, *fed, self._into, x,
        )  # fmt: skip
        if wrong >= 0:
            return wrong
        if ground is not None:
            kernels.sample_points(characters, self._into, x, self._points)
            at = self._points
            self._stand(characters, heights(ground, at[..., 0], at[..., 1]), x)
        self._lap("trajectory")
        y = self._evaluate(characters, x)
        if self._bounds is not None:
            kernels.bound(y, self._bounds)
        self._lap("network")
        shown = self._shown
        kernels.show(
            characters, y, self._out, self._settings, self.skeleton.parents, self._offsets,
            self._aims, self._contact_columns, *fed, shown.positions[who], shown.rotations[who],
            shown.velocities[who], shown.angular_velocities[who], self._contacts[who], self._turned,
            self._places,
        )  # fmt: skip
        self._head = (self._head + 1) % past.shape[1]
        kernels.advance(characters, past, self._head, y, self._out, self._settings, self._obstacles)
        self._lap("pose")
        return -1

    def _stand(self, characters: NDArray, heights: NDArray[np.float32], x: NDArray[np.float32]) -> None:
        """Put characters on the ground's heights [N, 12, 3], which a network's inputs [N, I] may tell."""
        raise NotImplementedError

    def _evaluate(self, characters: NDArray, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """The network's outputs [N, O] of inputs [N, I]."""
        raise NotImplementedError

    def reset(self, positions: ArrayLike, yaws: ArrayLike) -> None:
        """Put the characters at positions [N, 2] (x, z), facing yaws [N], at rest."""
        self._place(slice(None), positions, yaws)
        character, fed, pose, contacts = self._rest
        for name in {"phase", "gait"} & set(character.dtype.names):
            self.characters[name] = character[name]
        for array, at_rest in zip(self._fed, fed, strict=True):
            array[:] = at_rest
        self._shown[:] = pose
        self._contacts[:] = contacts
        self._past[:, :, 4 : trajectory.PAST] = character["gait"]
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
        characters[:] = np.zeros((), characters.dtype)
        characters["root"][:, :2], characters["root"][:, 2] = np.asarray(positions, np.float32), yaws
        characters["target_yaw"], characters["shown"] = yaws, characters["root"]
        characters["future"][:, :, 3] = 1
        past[:] = 0
        past[:, :, :2] = characters["root"][:, None, :2]
        past[:, :, 2], past[:, :, 3] = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
        self._release_feet(who)

    def _release_feet(self, who: slice) -> None:
        self._feet[who] = np.zeros((), foot_lock.FOOT)
        self._feet["target"][who] = np.nan

    def _stand_on_ground(self) -> None:
        if self._ground is not None:
            x, z = self.characters["root"][:, 0], self.characters["root"][:, 1]
            self.characters["height"] = self.characters["shown_height"] = heights(self._ground, x, z)

    def _settle(self, mean: NDArray[np.float32]) -> tuple[Any, ...]:
        """A character at rest: what the network makes of its mean outputs' pose when it is asked to stand."""
        one, command = slice(0, 1), Command.still(1)
        self._place(one, np.zeros((1, 2)), np.zeros(1))
        stand = np.eye(len(self.characters["gait"][0]))[0]
        self.characters["gait"][0] = self._past[0, :, 4 : trajectory.PAST] = stand
        self._begin(self.layout.unpack_outputs(mean[None]))
        for _ in range(round(SETTLING * self.fps)):
            self._frame(one, command, None)
        fed = tuple(array[0].copy() for array in self._fed)
        return self.characters[0].copy(), fed, self._shown[one].copy(), self._contacts[0].copy()

    def _begin(self, mean: Any) -> None:
        """Give the first character the joints of the mean outputs, as if it did not move."""
        joints, velocities = self._fed[:2]
        joints[0], velocities[0] = mean.positions[0], 0

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
            raise NotFinite(f"the command of character {wrong} is not finite", remedy="give it numbers")
        self._command = command
        shown = self._shown
        np.copyto(self._rotations, shown.rotations)
        if self._legs is not None:
            legs = self._legs
            self._lock_feet(
                self._feet, self._contacts, self._lock_settings, self.skeleton.parents, legs.needed,
                legs.joints, legs.points, legs.hinges, self._lock_heights, shown.positions, self._rotations,
                *self._world,
            )  # fmt: skip
        self._lap("foot lock")
        return self._pose

    def _lap(self, stage: str) -> None:
        """Book the time since the last lap under a stage."""
        if self.timed:
            now = time.perf_counter()
            self.stage_seconds[stage] = now - self._lap_start
            self._lap_start = now

    def poses(self) -> Poses:
        """The poses [N] that the last step showed, valid until the next one."""
        return self._pose

    def check_tags(self, required: int, forbidden: int) -> None:
        """A UserError for any tags: a network of locomotion knows none."""
        names = self.description.tags_of(required | forbidden)
        if names:
            raise UserError(f"a {self._kind} knows nothing of the tag {names[0]!r}", remedy="ask for no tags")

    def contacts(self) -> NDArray[np.uint8]:
        """Which feet touch the ground by the network [N, C]; valid until the next step."""
        return self._contacts

    def planted(self) -> NDArray[np.uint8]:
        """Which feet the last step held on the ground [N, C]."""
        return self._feet["locked"].astype(np.uint8)

    def record(self) -> dict[str, NDArray]:
        """What the last step did; copies with leading axis N. Keys: see `mm.recording`.

        trajectory [N, 12, 3] is what the network was given; gait [N, 6] is that of the frame to come.
        """
        c = self.characters
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
            "trajectory": trajectory.world(c["shown"], self._x, int(self._into[0])),
            "gait": c["gait"].copy(),
        }

    def memory(self) -> dict[str, int]:
        """Bytes by part: weights, their padding, statistics, room to work in, the state of one character."""
        own = self.network.memory()
        room = sum(array.nbytes for array in (self._turned, self._places, *self._world))
        bounds = 0 if self._bounds is None else self._bounds.nbytes
        return own | {
            "statistics": own["statistics"] + bounds,
            "workspace": own["workspace"] + room,
            "state": sum(array.nbytes for array in self._held()) // self.count,
        }

    def _held(self) -> tuple[NDArray, ...]:
        """All arrays that are held of the characters from frame to frame."""
        state = self.characters, self._past, *self._fed, self._x, self._points
        return *state, self._contacts, self._feet, self._rotations, *self._shown.arrays().values()

    def remember(self) -> tuple[Any, ...]:
        """The characters as they are, for `recall`: a copy."""
        return tuple(array.copy() for array in self._held()), self._head, self._command

    def recall(self, remembered: tuple[Any, ...]) -> None:
        """Be again where this controller, or one with other settings of the same network, was."""
        held, self._head, self._command = remembered
        for array, its in zip(self._held(), held, strict=True):
            array[:] = its
