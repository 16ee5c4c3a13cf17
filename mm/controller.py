"""The controller: any three stages, and all that surrounds them, for N characters at once.

Each step: take commands in and predict the trajectory; where a search is due, build the query, project, and
jump if the candidate is cheaper than playing on; step; decompress; inertialize; keep the character with its
simulated object; hold the feet.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features import normalise
from motion import foot_lock, foot_lock_numpy, springs
from motion.errors import NotFinite, UserError
from motion.pose import Poses

from . import characters as state_types
from . import kernels, kernels_numpy, search, stages
from . import settings as settings_types
from .control import Command
from .database import Database
from .description import Description
from .search import terms
from .settings import Settings

STAGES = (
    "prediction",
    "query",
    "projection",
    "stepping",
    "decompression",
    "inertialization",
    "synchronization",
    "foot lock",
)


class Controller:
    """Drives N characters by commands; implements `mm.control.System`.

    Parameters
    ----------
    data : the database that the characters play; for stages that need none, its description.
    count : N.
    settings : see `mm.settings.Settings`.
    index : a search index's name, or one already built on this database (with the same settings' ignore_end).
    three_stages : other stages than the classical ones; index is then not used. A description needs them.
    obstacles : float [M, 5], boxes and circles on the ground: centre x, z, half widths x, z, radius.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    name : what reports call this system.

    `stage_seconds` holds the time of the last step by stage when `timed` is set.
    """

    def __init__(
        self,
        data: Database | Description,
        *,
        count: int = 1,
        settings: Settings | None = None,
        index: str | search.Index = "exact",
        three_stages: stages.Stages | None = None,
        obstacles: ArrayLike = (),
        compiled: bool = True,
        name: str | None = None,
    ) -> None:
        if count < 1:
            raise UserError(f"{count} characters", remedy="ask for one or more")
        self.database = data if isinstance(data, Database) else None
        self.description = data if isinstance(data, Description) else Description.of(data, rigs=False)
        self.count, description = count, self.description
        self.settings = settings = settings or Settings()
        self.skeleton, self.fps = description.skeleton, description.fps
        self._kernels = kernels if compiled else kernels_numpy
        self._lock_feet = (foot_lock if compiled else foot_lock_numpy).lock_feet
        self._obstacles = np.asarray(obstacles, np.float32).reshape(-1, 5)
        if three_stages is None:
            if self.database is None:
                raise TypeError("a description has no frames to play: give three stages, or the database")
            index = build_index(self.database, index, settings) if isinstance(index, str) else index
            three_stages = stages.classical(
                self.database,
                index,
                ignore_radius=round(settings.ignore_radius * self.fps),
                ignore_end=round(settings.ignore_end * self.fps),
                gather=self._kernels.gather,
            )
            name = name or f"mm {index.name}"
        self.name = name or "controller"
        self.stages = three_stages

        self._schema = schema = description.schema
        layout = schema.trajectory()
        self._layout = layout
        self._columns = (layout.position_columns.astype(np.int64), layout.direction_columns.astype(np.int64))
        future, past = layout.times > 0, layout.times < 0
        self._future_times = layout.times[future].astype(np.float32)
        self._future_slots = np.flatnonzero(future)
        self._past_slots = np.flatnonzero(past)
        self._past_frames = (-layout.times[past] * self.fps).astype(np.float32)
        self._present_slots = np.flatnonzero(layout.times == 0)
        self._normalisation = (stages.plain(description.offset), stages.plain(description.scale))
        self._terms = terms.of_schema(schema)

        self._crouch_tag = np.uint32(description.crouch_tag)
        self._required, self._forbidden = np.zeros((2, count), np.uint32)

        joints, feet = len(self.skeleton), len(description.contact_roles)
        self.characters = np.zeros(count, state_types.CHARACTER)
        self._feet = np.zeros((count, feet), foot_lock.FOOT)
        self._playing, self._shown = Poses.empty(count, joints), Poses.empty(count, joints)
        self._offsets = np.zeros((count, joints, 4, 3), np.float32)
        self._contacts = np.zeros((count, feet), np.uint8)
        self._planted = np.zeros((count, feet), np.uint8)
        # What is shown differs from what the next transition starts from by the locked legs' rotations only.
        self._rotations = self._shown.rotations.copy()
        shown = self._shown
        self._pose = Poses(shown.positions, self._rotations, shown.velocities, shown.angular_velocities)
        self._trajectory = np.zeros((count, len(layout), 3), np.float32)
        self._history = np.zeros((count, 2 + int(self._past_frames.max(initial=0)), 3), np.float32)
        self._head = 0
        self._queries = np.zeros((count, schema.size), np.float32)
        self._played = self._queries.copy()
        self._sources, self._candidates = np.full((2, count), -1, np.int32)
        self._cost_current = np.full(count, np.nan, np.float32)
        self._cost_candidate = np.full(count, np.nan, np.float32)
        self._moved, self._ended = np.zeros((2, count), np.bool_)
        self._searching = np.zeros(count, np.int64)
        # Room to work in: what is asked, what is jumped to, and a character's joints in the world.
        needed, avoided = np.zeros((2, count), np.uint32)
        forced, (costs, bounds) = np.zeros(count, np.bool_), np.zeros((2, count), np.float32)
        asked = np.zeros_like(self._queries), needed, avoided, forced, costs, bounds
        self._asked: tuple[NDArray, ...] = asked
        self._landing = Poses.empty(count, joints)
        self._landing_contacts = np.zeros((count, feet), np.uint8)
        self._world = np.zeros((joints, 3), np.float32), np.zeros((joints, 4), np.float32)
        self._take_settings(settings)
        self.timed = False
        self._lap_start = 0.0
        self.stage_seconds = dict.fromkeys(STAGES, 0.0)
        self.reset(np.zeros((count, 2), np.float32), np.zeros(count, np.float32))

    def _take_settings(self, settings: Settings) -> None:
        # The legs first: a skeleton that lacks them leaves all as it was.
        self._legs = self.description.feet(settings.foot_height) if settings.foot_lock else None
        self.settings, self._settings = settings, settings_types.record(settings, self.fps)

    def retune(self, settings: Settings) -> None:
        """Go on by other settings from the next step on.

        ignore_end must stay, since a search index is built with it: another one is a UserError.
        """
        if settings.ignore_end != self.settings.ignore_end:
            remedy = "make another controller, and let it recall what this one remembers"
            raise UserError("ignore_end cannot change while characters are driven", remedy=remedy)
        unlocked = self._legs is None
        self._take_settings(settings)
        if unlocked:
            self._release_feet()
        for stage in (self.stages.projection, self.stages.stepping, self.stages.decompression):
            if isinstance(stage, stages.Tuned):
                stage.retune(settings, self.fps)

    def reset(self, positions: ArrayLike, yaws: ArrayLike) -> None:
        """Put the characters at positions [N, 2] (x, z), facing yaws [N], at rest."""
        positions = np.broadcast_to(np.asarray(positions, np.float32), (self.count, 2))
        yaws = np.broadcast_to(np.asarray(yaws, np.float32), (self.count,))
        self.characters[:] = np.zeros((), state_types.CHARACTER)
        self.characters["position"] = positions
        self.characters["yaw"] = self.characters["desired_yaw"] = springs.wrap(yaws)
        for name in ("root", "data_root"):
            self.characters[name][:, :2] = positions
            self.characters[name][:, 2] = springs.wrap(yaws)
        self._release_feet()
        self._offsets[:] = 0
        self._history[:] = self.characters["root"][:, None]
        self.state = self.stages.stepping.start(self.count)
        self.state.put(np.arange(self.count), self._standing().take(np.zeros(self.count, np.int64)))
        self.stages.decompression.decompress(self.state, self._playing, self._contacts)
        for shown, playing in zip(
            self._shown.arrays().values(), self._playing.arrays().values(), strict=True
        ):
            shown[:] = playing
        self._write_root()
        np.copyto(self._rotations, self._shown.rotations)
        self._moved[:] = False
        self._sources[:] = self._candidates[:] = -1
        self._cost_current[:] = self._cost_candidate[:] = np.nan

    def _release_feet(self) -> None:
        self._feet[:] = np.zeros((), foot_lock.FOOT)
        self._feet["target"] = np.nan

    def _standing(self) -> stages.State:
        """The state [1] of a character at rest: what projection finds, and finds again, for going nowhere."""
        state = self.stages.stepping.start(1)
        query = state.features().copy()
        still, nothing = np.zeros(1, state_types.CHARACTER), np.zeros(1, np.uint32)
        trajectory = np.zeros((1, len(self._layout), 3), np.float32)
        for _ in range(3):
            self._kernels.build_queries(
                still, np.zeros(1, np.int64), state.features(), trajectory, *self._columns,
                *self._normalisation, query,
            )  # fmt: skip
            anything = np.full(1, np.inf, np.float32)
            state, _, found = self.stages.projection.project(query, state, anything, nothing, nothing)
            if not found[0]:
                break
        return state

    def step(self, command: Command) -> Poses:
        """Advance one frame, 1 / fps. Returns the poses [N] shown, valid until the next step."""
        if command.velocity.shape != (self.count, 2) or command.yaw.shape != (self.count,):
            raise UserError(
                f"commands with velocity {command.velocity.shape} and yaw {command.yaw.shape}",
                remedy=f"give {self.count} characters ({self.count}, 2) and ({self.count},)",
            )
        characters, settings, shown = self.characters, self._settings, self._shown
        self._lap_start = time.perf_counter()
        required, forbidden = self._tags(command)
        self.state.ended(self._ended)
        wrong, searching = self._kernels.control(
            characters, command.velocity, command.yaw, command.turn_rate, required, forbidden, self._ended,
            settings, self._obstacles, self._future_times, self._future_slots, self._trajectory,
            self._searching,
        )  # fmt: skip
        if wrong >= 0:
            raise NotFinite(f"the command of character {wrong} is not finite", remedy="give it numbers")
        if self._past_slots.size or self._present_slots.size:
            self._head = (self._head + 1) % self._history.shape[1]
            self._kernels.remember(
                characters, self._history, self._head, self._past_frames, self._past_slots,
                self._present_slots, self._trajectory,
            )  # fmt: skip
        self._lap("prediction")
        self._moved[:] = False
        if searching:
            self._search(self._searching[:searching], required, forbidden)
        else:
            self._lap("query")
            self._lap("projection")
        jumped = self.state.jumped()
        if len(jumped):
            self._blend(jumped, self.state.take(jumped))
        self.stages.stepping.step(self.state)
        self._lap("stepping")
        self.stages.decompression.decompress(self.state, self._playing, self._contacts)
        self._lap("decompression")
        self._kernels.inertialize(
            characters, settings, self._offsets,
            self._playing.positions, self._playing.rotations,
            self._playing.velocities, self._playing.angular_velocities,
            shown.positions, shown.rotations, shown.velocities, shown.angular_velocities,
        )  # fmt: skip
        self._lap("inertialization")
        self._kernels.synchronize(
            characters, settings, self._obstacles,
            shown.positions, shown.rotations, shown.velocities, shown.angular_velocities,
        )  # fmt: skip
        self._lap("synchronization")
        np.copyto(self._rotations, shown.rotations)
        if self._legs is not None:
            legs = self._legs
            self._lock_feet(
                self._feet, self._contacts, settings, self.skeleton.parents, legs.needed, legs.joints,
                legs.points, legs.hinges, legs.heights, shown.positions, self._rotations, *self._world,
            )  # fmt: skip
        self._lap("foot lock")
        return self._pose

    def _tags(self, command: Command) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Tags that are required and forbidden [N]; crouching is one, forbidden to who goes upright."""
        if not self._crouch_tag:
            return command.required_tags, command.forbidden_tags
        self._kernels.divide(
            command.crouch, self._crouch_tag, command.required_tags, command.forbidden_tags,
            self._required, self._forbidden,
        )  # fmt: skip
        return self._required, self._forbidden

    def _search(
        self, who: NDArray[np.int64], required: NDArray[np.uint32], forbidden: NDArray[np.uint32]
    ) -> None:
        """Look for a better place in the data for characters who, by tags [N], and jump there."""
        state = self.state.take(who)
        features = state.features()
        queries, needed, avoided, forced, current, bound = (room[: len(who)] for room in self._asked)
        self._kernels.ask(
            self.characters, who, features, state.tags(), required, forbidden, self._ended, self._trajectory,
            *self._columns, *self._normalisation, self._terms, np.float32(1 - self.settings.continuing_bias),
            queries, needed, avoided, forced, current, bound,
        )  # fmt: skip
        self._sources[who] = state.origins()
        self._lap("query")
        candidates, costs, found = self.stages.projection.project(queries, state, bound, needed, avoided)
        origins = candidates.origins()
        self._candidates[who] = np.where(found, origins, -1)
        radius = round(self.settings.ignore_radius * self.fps)
        self._kernels.turn_back(self.characters, who, origins, forced, radius, 1 / self.fps, found)
        hits = np.count_nonzero(found)
        if hits < len(who):
            self._check_possible(who, forced & ~found, needed, avoided)
        if hits:
            self._jump(who[found], candidates.take(np.flatnonzero(found)))
            features = self.state.take(who).features()
        self._queries[who], self._played[who] = queries, features
        self._cost_current[who], self._cost_candidate[who] = current, costs
        self._lap("projection")

    def _check_possible(
        self,
        who: NDArray[np.int64],
        lost: NDArray[np.bool_],
        needed: NDArray[np.uint32],
        avoided: NDArray[np.uint32],
    ) -> None:
        """Refuse tags that no frame bears, and a clip's end that nothing can follow, to the lost [M]."""
        for m in np.flatnonzero(lost):
            if not self.stages.projection.possible(int(needed[m]), int(avoided[m])):
                raise UserError(
                    f"character {who[m]} is asked for tags that no frame bears",
                    remedy="ask for tags that go together in the database (see `mm info`)",
                )
            if self._ended[who[m]]:
                raise UserError(
                    f"character {who[m]} is at the end of its clip and no frame may follow",
                    remedy="build the database from more or longer clips, or bearing these tags",
                )

    def _jump(self, who: NDArray[np.int64], destination: stages.State) -> None:
        """Transition characters who to the destination states, inertialized."""
        self.characters["left"][who] = self._sources[who]
        self.characters["until_back"][who] = self.settings.reselect_time
        self._blend(who, destination)
        self.state.put(who, destination)
        self._moved[who] = True

    def _blend(self, who: NDArray[np.int64], destination: stages.State) -> None:
        """From the next step on, blend characters who from what they show into the destination states."""
        poses, contacts = self._landing[: len(who)], self._landing_contacts[: len(who)]
        self.stages.decompression.decompress(destination, poses, contacts)
        shown = self._shown
        self._kernels.transition(
            who, self.characters,
            shown.positions, shown.rotations, shown.velocities, shown.angular_velocities, self._offsets,
            poses.positions, poses.rotations, poses.velocities, poses.angular_velocities,
        )  # fmt: skip

    def _write_root(self) -> None:
        """Joint 0 of the pose shown, from the characters' roots."""
        root, shown = self.characters["root"], self._shown
        shown.positions[:, 0] = np.stack([root[:, 0], np.zeros(self.count), root[:, 1]], axis=-1)
        shown.rotations[:, 0] = 0
        shown.rotations[:, 0, 0], shown.rotations[:, 0, 2] = np.cos(root[:, 2] / 2), np.sin(root[:, 2] / 2)
        shown.velocities[:, 0] = shown.angular_velocities[:, 0] = 0

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
        """A UserError unless something can be played that bears tags required, none of those forbidden."""
        if self.stages.projection.possible(required, forbidden):
            return
        tags = self.description.tags_of
        wanted = [f"with {', '.join(tags(required))}"] * bool(required)
        wanted += [f"without {', '.join(tags(forbidden))}"] * bool(forbidden)
        raise UserError(f"no frame {' and '.join(wanted)}", remedy="require or forbid fewer tags")

    def contacts(self) -> NDArray[np.uint8]:
        """Which feet touch the ground by what is played [N, C]; valid until the next step."""
        return self._contacts

    def planted(self) -> NDArray[np.uint8]:
        """Which feet the last step held on the ground [N, C]; valid until the next one."""
        np.copyto(self._planted, self._feet["locked"], casting="unsafe")
        return self._planted

    def record(self) -> dict[str, NDArray]:
        """What the last step did; copies with leading axis N. Keys: see `mm.recording`."""
        c = self.characters
        return {
            "command_velocity": c["desired_velocity"].copy(),
            "command_yaw": c["desired_yaw"].copy(),
            "simulation_position": c["position"].copy(),
            "simulation_velocity": c["velocity"].copy(),
            "simulation_yaw": c["yaw"].copy(),
            "positions": self._shown.positions.copy(),
            "rotations": self._rotations.copy(),
            "contacts": self._contacts.copy(),
            "locked": self._feet["locked"].copy(),
            "frame": self.state.frames().copy(),
            "searched": c["searching"].copy(),
            "forced": c["forced"].copy(),
            "transition": self._moved.copy(),
            "query": self._queries.copy(),
            "required_tags": c["required_tags"].copy(),
            "forbidden_tags": c["forbidden_tags"].copy(),
            "source": self._sources.copy(),
            "candidate": self._candidates.copy(),
            "cost_current": self._cost_current.copy(),
            "cost_candidate": self._cost_candidate.copy(),
            "feature_costs": normalise.costs(self._schema, self._queries, self._played),
            "trajectory": self._trajectory.copy(),
        }

    def _held(self) -> tuple[NDArray, ...]:
        """All arrays that are held of the characters from frame to frame, apart from their states."""
        return (
            self.characters, self._required, self._forbidden, self._feet, self._offsets, self._contacts,
            self._planted, self._trajectory, self._history, self._queries, self._played, self._sources,
            self._candidates, self._cost_current, self._cost_candidate, self._moved,
            self._ended, *self._playing.arrays().values(), *self._shown.arrays().values(), self._rotations,
        )  # fmt: skip

    def remember(self) -> tuple[Any, ...]:
        """The characters as they are, for `recall`: a copy."""
        held = tuple(array.copy() for array in self._held())
        return held, self.state.take(np.arange(self.count)), self._head

    def recall(self, remembered: tuple[Any, ...]) -> None:
        """Be again where this controller, or one with other settings on the same data, was."""
        held, state, self._head = remembered
        for array, its in zip(self._held(), held, strict=True):
            array[:] = its
        self.state.put(np.arange(self.count), state)

    def memory(self) -> dict[str, int]:
        """Bytes by part: what the stages hold, statistics of features, all that is held of one character from
        frame to frame, its state, and room to work in, which stages may have, too."""
        room = sum(array.nbytes for array in self._landing.arrays().values())
        others: tuple[NDArray, ...] = (self._searching, self._landing_contacts, *self._asked)
        room = (room + sum(array.nbytes for array in others)) // self.count
        parts = {"workspace": room + sum(array.nbytes for array in self._world)}
        for stage in (self.stages.projection, self.stages.stepping, self.stages.decompression):
            own = stage.memory()
            parts |= own | {"workspace": parts["workspace"] + own.get("workspace", 0)}
        return parts | {
            "statistics": sum(array.nbytes for array in self._normalisation),
            "state": (sum(array.nbytes for array in self._held()) + self.state.nbytes) // self.count,
        }


def build_index(database: stages.Searched, name: str, settings: Settings, **options: Any) -> search.Index:
    """A search index over a database, with the exclusions of the settings."""
    return search.build(
        name,
        stages.plain(database.features),
        database.starts,
        database.stops,
        ignore_end=round(settings.ignore_end * database.fps),
        tags=database.tags,
        schema=database.schema,
        **options,
    )


def box(x: float, z: float, width: float, depth: float) -> Sequence[float]:
    """An obstacle: a box on the ground, centre and full widths along x and z."""
    return x, z, width / 2, depth / 2, 0.0


def circle(x: float, z: float, radius: float) -> Sequence[float]:
    """An obstacle: a circle on the ground."""
    return x, z, 0.0, 0.0, radius
