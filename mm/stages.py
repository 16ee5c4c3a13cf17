"""The three stages of a motion-matching step, as protocols, and their classical implementations.

    query - Projection - state - Stepping - state - Decompression - pose

All work on a batch of characters. A classical state is a frame index each; a learned one is a feature and a
latent vector each. A controller composes any three stages whose states agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema
from motion.plain import plain
from motion.pose import Poses

from . import kernels, search
from .database import Database
from .settings import Settings

NOBODY = np.zeros(0, np.int64)


class Searched(Protocol):
    """What search and stepping ask of a database, compressed or not: all but its poses."""

    @property
    def fps(self) -> float: ...

    @property
    def schema(self) -> Schema: ...

    @property
    def features(self) -> NDArray[np.float32]: ...

    @property
    def tags(self) -> NDArray[np.uint32]: ...

    @property
    def starts(self) -> NDArray[np.int32]: ...

    @property
    def stops(self) -> NDArray[np.int32]: ...

    def ranges(self) -> NDArray[np.int32]: ...


class State(Protocol):
    """Where N characters are in the data."""

    @property
    def nbytes(self) -> int:
        """Bytes of all N, without the data that they are in."""
        ...

    def __len__(self) -> int: ...

    def features(self) -> NDArray[np.float32]:
        """Normalised features [N, F]."""
        ...

    def frames(self) -> NDArray[np.int32]:
        """Database frames [N], -1 where the state is not one."""
        ...

    def origins(self) -> NDArray[np.int32]:
        """Database frames [N] around which a search leaves frames out, -1 for none."""
        ...

    def tags(self) -> NDArray[np.uint32]:
        """Tags that what is played bears [N]."""
        ...

    def ended(self, out: NDArray[np.bool_]) -> None:
        """Write whether the data ends here, so that a jump is due [N]."""
        ...

    def jumped(self) -> NDArray[np.int64]:
        """Who [K] goes on elsewhere than the last pose was, by no projection, so that a blend is due."""
        ...

    def take(self, who: NDArray[np.int64]) -> Self:
        """The states of some characters."""
        ...

    def put(self, who: NDArray[np.int64], other: Self) -> None:
        """Replace the states of some characters."""
        ...


class Projection(Protocol):
    """Finds the state whose features are nearest to a query."""

    def project(
        self,
        queries: NDArray[np.float32],
        state: State,
        bound: NDArray[np.float32],
        required_tags: NDArray[np.uint32],
        forbidden_tags: NDArray[np.uint32],
    ) -> tuple[State, NDArray[np.float32], NDArray[np.bool_]]:
        """Candidates for M characters.

        queries [M, F] normalised, state [M] where they are, bound [M] the cost that a candidate must beat.
        Returns candidate states [M], their costs [M], and whether there is one [M].
        """
        ...

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        """Whether there is any state that bears these tags, and none of those."""
        ...

    def memory(self) -> dict[str, int]: ...


class Stepping(Protocol):
    """Advances a state by one frame."""

    def start(self, count: int) -> State:
        """A state to begin from, for count characters."""
        ...

    def step(self, state: Any) -> None: ...

    def memory(self) -> dict[str, int]: ...


class Decompression(Protocol):
    """Turns a state into a pose, joint 0 holding the root's motion (see `mm.kernels`)."""

    def decompress(self, state: Any, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        """Write the poses [N, J, ..] and contacts [N, C] of state [N]."""
        ...

    def memory(self) -> dict[str, int]: ...


@runtime_checkable
class Tuned(Protocol):
    """A stage that settings say something to."""

    def retune(self, settings: Settings, fps: float) -> None:
        """Go on by other settings, at fps steps a second."""
        ...


@dataclass(eq=False)
class Stages:
    """Any three stages whose states agree."""

    projection: Projection
    stepping: Stepping
    decompression: Decompression


@dataclass(frozen=True, eq=False)
class Frames:
    """What is asked of T frames that play, apart from their poses.

    features float32 [T, F] normalised, tags uint32 [T], last int32 [T]: the last frame of each one's range.
    """

    features: NDArray[np.float32]
    tags: NDArray[np.uint32]
    last: NDArray[np.int32]

    @staticmethod
    def of(database: Searched) -> Frames:
        return Frames(plain(database.features), plain(database.tags), last_frames(database))


def last_frames(database: Searched) -> NDArray[np.int32]:
    """The last frame of each frame's range, int32 [T]."""
    return (database.stops - 1)[database.ranges()].astype(np.int32)


@dataclass(eq=False)
class FrameState:
    """Classical states: a database frame each."""

    index: NDArray[np.int32]
    data: Frames

    @property
    def nbytes(self) -> int:
        return self.index.nbytes

    def __len__(self) -> int:
        return len(self.index)

    def features(self) -> NDArray[np.float32]:
        return self.data.features[self.index]

    def frames(self) -> NDArray[np.int32]:
        return self.index

    def origins(self) -> NDArray[np.int32]:
        return self.index

    def tags(self) -> NDArray[np.uint32]:
        return self.data.tags[self.index]

    def ended(self, out: NDArray[np.bool_]) -> None:
        kernels.at_ends(self.index, self.data.last, out)

    def jumped(self) -> NDArray[np.int64]:
        return NOBODY

    def take(self, who: NDArray[np.int64]) -> FrameState:
        return FrameState(self.index[who], self.data)

    def put(self, who: NDArray[np.int64], other: FrameState) -> None:
        self.index[who] = other.index


class SearchProjection:
    """Nearest-neighbour search in the database's features; tags [T] are those that the index looks at."""

    def __init__(self, index: search.Index, tags: NDArray[np.uint32], *, ignore_radius: int) -> None:
        self.index = index
        self.tags = plain(tags)
        self.ignore_radius = ignore_radius

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        tagged = np.count_nonzero(required_tags) or np.count_nonzero(forbidden_tags)
        exclude = search.Exclusions(
            current=state.frames(),
            radius=self.ignore_radius,
            required_tags=required_tags if tagged else None,
            forbidden_tags=forbidden_tags if tagged else None,
        )
        frames, costs = self.index.search(queries, bound=bound, exclude=exclude)
        found = frames[:, 0] >= 0
        # Where nothing was found the state stays what it is.
        index = np.where(found, frames[:, 0], state.frames())
        return FrameState(index, state.data), costs[:, 0], found

    def retune(self, settings: Settings, fps: float) -> None:
        self.ignore_radius = round(settings.ignore_radius * fps)

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        required, forbidden = np.uint32(required_tags), np.uint32(forbidden_tags)
        return bool(((self.tags & required == required) & (self.tags & forbidden == 0)).any())

    def memory(self) -> dict[str, int]:
        return {"index": self.index.nbytes}


class FrameStepping:
    """The next frame of the same range; the last one of a range stays."""

    def __init__(self, database: Searched, *, ignore_end: int, data: Frames | None = None) -> None:
        self.data = Frames.of(database) if data is None else data
        lengths = database.stops - database.starts
        # Begin where a search could have put us: the longest range, a little into it.
        longest = int(np.argmax(lengths))
        self.first = int(database.starts[longest] + min(ignore_end, lengths[longest] // 2))

    def start(self, count: int) -> FrameState:
        return FrameState(np.full(count, self.first, np.int32), self.data)

    def step(self, state: FrameState) -> None:
        kernels.play_on(state.index, state.data.last)

    def memory(self) -> dict[str, int]:
        data = self.data
        return {"features": data.features.nbytes, "tags": data.tags.nbytes, "ranges": data.last.nbytes}


class GatherDecompression:
    """Rows of the database's poses."""

    def __init__(self, database: Database, *, gather: Callable[..., None] = kernels.gather) -> None:
        self._gather = gather
        self._poses = tuple(plain(array) for array in database.poses.arrays().values())
        self._contacts = plain(database.contacts)
        self.root_steps = root_steps(database)

    def decompress(self, state: FrameState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        self._gather(
            state.index, self.root_steps, *self._poses, self._contacts,
            poses.positions, poses.rotations, poses.velocities, poses.angular_velocities, contacts,
        )  # fmt: skip

    def memory(self) -> dict[str, int]:
        return {
            "poses": sum(array.nbytes for array in self._poses),
            "contacts": self._contacts.nbytes,
            "root motion": self.root_steps.nbytes,
        }


def root_steps(database: Database) -> NDArray[np.float32]:
    """The ground root's motion, float32 [T, 6]: displacement x, z (m) and turn (rad) since the previous
    frame, in the previous root's space; velocity x, z (m/s) and turn rate (rad/s) in the root's own space.

    A range's first frame moves as its second does.
    """
    x, z = database.poses.positions[:, 0, 0], database.poses.positions[:, 0, 2]
    w, _, y, _ = np.moveaxis(np.asarray(database.poses.rotations[:, 0]), -1, 0)
    yaw = 2 * np.arctan2(y.astype(np.float64), w)
    out = np.zeros((len(database), 6), np.float32)
    before = yaw[:-1]
    dx, dz = np.diff(x.astype(np.float64)), np.diff(z.astype(np.float64))
    out[1:, 0] = np.cos(before) * dx - np.sin(before) * dz
    out[1:, 1] = np.cos(before) * dz + np.sin(before) * dx
    turned = np.diff(yaw)
    out[1:, 2] = turned - 2 * np.pi * np.round(turned / (2 * np.pi))
    second = np.minimum(database.starts + 1, database.stops - 1)
    out[database.starts] = np.where((second > database.starts)[:, None], out[second], 0)
    vx, vz = database.poses.velocities[:, 0, 0], database.poses.velocities[:, 0, 2]
    out[:, 3] = np.cos(yaw) * vx - np.sin(yaw) * vz
    out[:, 4] = np.cos(yaw) * vz + np.sin(yaw) * vx
    out[:, 5] = database.poses.angular_velocities[:, 0, 1]
    return out


def classical(
    database: Database,
    index: search.Index,
    *,
    ignore_radius: int,
    ignore_end: int,
    gather: Callable[..., None],
) -> Stages:
    """The three classical stages on one database."""
    return Stages(
        SearchProjection(index, database.tags, ignore_radius=ignore_radius),
        FrameStepping(database, ignore_end=ignore_end),
        GatherDecompression(database, gather=gather),
    )
