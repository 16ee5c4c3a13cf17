"""The learned stages, and how they mix with the classical ones: all eight combinations of `mm.stages`.

    query - Projector - state - Stepper - state - Decompressor - pose

A learned state is a feature and a latent vector, a classical one a frame; stepping says which of them a
chain holds. Where a stage of the other kind meets it, one lookup converts: a frame becomes its row of
features and latents; a learned state becomes the frame whose row is nearest, every column in units of its
standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mm.kernels
import mm.kernels_numpy
from features import normalise
from mm import search
from mm.controller import build_index
from mm.database import Database
from mm.settings import Settings
from mm.stages import (
    Decompression,
    Frames,
    FrameState,
    FrameStepping,
    GatherDecompression,
    Projection,
    SearchProjection,
    Stages,
    Stepping,
    plain,
)
from motion.errors import UserError
from motion.pose import Poses

from . import kernels, kernels_numpy
from .evaluator import Evaluator
from .frames import projector_inputs
from .model import Model

LETTERS = "PSD"
COMBINATIONS = ("", "P", "S", "D", "PS", "PD", "SD", "PSD")


@dataclass(eq=False)
class LatentState:
    """Learned states: features and latents, side by side.

    Attributes
    ----------
    values : float32 [N, F + L], normalised features, then latents.
    width : F.
    asked : uint32 [N], tags of what was found, or asked for, at the last projection.
    near : int32 [N], the frame found by the last lookup plus the steps since; -1 where there was none.
    """

    values: NDArray[np.float32]
    width: int
    asked: NDArray[np.uint32]
    near: NDArray[np.int32]

    @staticmethod
    def of(values: NDArray[np.float32], width: int) -> LatentState:
        """States of values [N, F + L] that nothing else is known of."""
        count = len(values)
        return LatentState(values, width, np.zeros(count, np.uint32), np.full(count, -1, np.int32))

    def __len__(self) -> int:
        return len(self.values)

    def features(self) -> NDArray[np.float32]:
        return np.ascontiguousarray(self.values[:, : self.width])

    def latents(self) -> NDArray[np.float32]:
        """Latents [N, L]."""
        return self.values[:, self.width :]

    def frames(self) -> NDArray[np.int32]:
        return np.full(len(self), -1, np.int32)

    def tags(self) -> NDArray[np.uint32]:
        return self.asked

    def ended(self) -> NDArray[np.bool_]:
        return np.zeros(len(self), np.bool_)

    def take(self, who: NDArray[np.int64]) -> LatentState:
        return LatentState(self.values[who], self.width, self.asked[who], self.near[who])

    def put(self, who: NDArray[np.int64], other: LatentState) -> None:
        self.values[who], self.asked[who], self.near[who] = other.values, other.asked, other.near


class Rows:
    """The database as learned states: features as they are, latents [T, L] as half floats."""

    def __init__(self, database: Database, latents: NDArray) -> None:
        if len(latents) != len(database):
            raise UserError(
                f"latents of {len(latents)} frames for a database of {len(database)}",
                remedy="make them from this database",
            )
        self.data = Frames.of(database)
        self.latents = plain(np.asarray(latents, np.float16))

    @property
    def width(self) -> int:
        """F."""
        return self.data.features.shape[1]

    def values(self, frames: NDArray[np.int32]) -> NDArray[np.float32]:
        """Rows [N, F + L] of frames [N]."""
        out = np.empty((len(frames), self.width + self.latents.shape[1]), np.float32)
        out[:, : self.width], out[:, self.width :] = self.data.features[frames], self.latents[frames]
        return out

    def states(self, frames: NDArray[np.int32]) -> LatentState:
        """Frames [N] as learned states."""
        return LatentState(self.values(frames), self.width, self.data.tags[frames], frames)

    def memory(self) -> dict[str, int]:
        data = self.data
        return {"features": data.features.nbytes, "latents": self.latents.nbytes, "tags": data.tags.nbytes}


class Nearest:
    """Finds the database frame nearest to a learned state, every column divided by its deviation."""

    def __init__(self, model: Model, database: Database, rows: Rows, *, ignore_end: int) -> None:
        std = model.state_std
        self._scale = np.where(std > 0, 1 / np.where(std > 0, std, 1), 0).astype(np.float32)
        self._table = plain(rows.values(np.arange(len(database), dtype=np.int32)) * self._scale)
        self._index = search.build(
            "exact", self._table, database.starts, database.stops, ignore_end=ignore_end, tags=database.tags
        )

    def frames(
        self,
        values: NDArray[np.float32],
        near: NDArray[np.int32],
        exclude: search.Exclusions | None = None,
    ) -> NDArray[np.int32]:
        """The nearest frames [N] of values [N, F + L]; -1 where all are excluded.

        near [N] are frames to start from (-1: none): what lies further than they do need not be looked at.
        """
        points = values * self._scale
        bound = None
        if exclude is None:
            difference = points - self._table[near]
            bound = np.einsum("nc,nc->n", difference, difference)
            bound[near < 0] = np.inf
        found, _ = self._index.search(points, bound=bound, exclude=exclude)
        return found[:, 0] if exclude is not None else np.where(found[:, 0] < 0, near, found[:, 0])

    def memory(self) -> dict[str, int]:
        return {"lookup": self._table.nbytes + self._index.nbytes}


class ProjectorProjection:
    """The Projector: a network's guess at the nearest state. It costs what its features differ by.

    As in motion matching a guess is taken where it is cheaper than playing on; both costs are the schema's,
    in the database's normalised space. Of tags it knows "crouch" alone, and that where its data divides.
    """

    def __init__(self, model: Model, *, compiled: bool = True) -> None:
        description = model.description
        self.width, self.schema = model.F, description.schema
        self._crouch = np.uint32(description.crouch_tag)
        self._names = description.tag_names
        self._network = Evaluator(model.projector, compiled=compiled)

    def guess(self, queries: NDArray[np.float32], required_tags: NDArray[np.uint32]) -> NDArray[np.float32]:
        """What the network answers [M, F + L] to queries [M, F]; a copy."""
        return self._network.evaluate(projector_inputs(queries, int(self._crouch), required_tags)).copy()

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        self.check_tags(required_tags, forbidden_tags)
        values = self.guess(queries, required_tags)
        guessed = LatentState.of(values, self.width)
        guessed.asked = required_tags
        found_costs = normalise.total_costs(self.schema, queries, values[:, : self.width])
        return guessed, found_costs, found_costs < bound

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return not (required_tags | forbidden_tags) & ~int(self._crouch) and not (
            required_tags & forbidden_tags
        )

    def check_tags(self, required: NDArray[np.uint32], forbidden: NDArray[np.uint32]) -> None:
        """A UserError for tags that the network does not know."""
        unknown = np.bitwise_or.reduce(required | forbidden, initial=0) & ~self._crouch
        if unknown:
            names = [name for bit, name in enumerate(self._names) if unknown >> bit & 1]
            raise UserError(
                f"a projector is asked for tags that it does not know: {', '.join(names) or unknown}",
                remedy="ask for no tags"
                if not self._crouch
                else "ask for crouching alone, or search the database",
            )

    def memory(self) -> dict[str, int]:
        return {"projector": self._network.nbytes}


class GuessedFrames:
    """The Projector for classical states: the frame nearest to its guess, away from the one that plays.

    It costs what the frame does, since that is what would play.
    """

    def __init__(self, projector: ProjectorProjection, nearest: Nearest, *, ignore_radius: int) -> None:
        self._projector, self._nearest, self._radius = projector, nearest, ignore_radius

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        self._projector.check_tags(required_tags, forbidden_tags)
        exclude = search.Exclusions(state.frames(), self._radius, required_tags, forbidden_tags)
        frames = self._nearest.frames(self._projector.guess(queries, required_tags), state.frames(), exclude)
        lost = frames < 0
        candidates = FrameState(np.where(lost, state.frames(), frames), state.data)
        found_costs = normalise.total_costs(self._projector.schema, queries, candidates.features())
        found_costs[lost] = np.inf
        return candidates, found_costs, found_costs < bound

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return self._projector.possible(required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self._projector.memory() | self._nearest.memory()


class SearchedLatents:
    """Search for learned states: the frame found, as features and latents.

    A learned state is no frame, so what it excludes lies around `LatentState.near`: where the last search
    led, plus the steps since. It is what would be excluded had the frames themselves been played.
    """

    def __init__(self, searching: SearchProjection, rows: Rows) -> None:
        self._search, self._rows = searching, rows

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        playing = FrameState(state.near, self._rows.data)
        found, found_costs, any_found = self._search.project(
            queries, playing, bound, required_tags, forbidden_tags
        )
        candidates, lost = self._rows.states(found.index), np.flatnonzero(~any_found)
        candidates.put(lost, state.take(lost))
        return candidates, found_costs, any_found

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return self._search.possible(required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self._search.memory() | self._rows.memory()


class StepperStepping:
    """The Stepper: a state moves by its rates of change, for a frame. Nothing keeps it in the data's range.

    last [T], the last frame of each one's range, where states are looked up in a database.
    """

    def __init__(self, model: Model, *, last: NDArray[np.int32] | None = None, compiled: bool = True) -> None:
        self._width, self._fps = model.F, model.description.fps
        self._middle = model.stepper.input_mean
        self._network = Evaluator(model.stepper, compiled=compiled)
        self._advance = (kernels if compiled else kernels_numpy).advance
        self._last = last

    def start(self, count: int) -> LatentState:
        """The mean of what the stepper was trained on."""
        return LatentState.of(np.tile(self._middle, (count, 1)), self._width)

    def step(self, state: LatentState) -> None:
        self._advance(state.values, self._network.evaluate(state.values), self._fps)
        if self._last is not None:
            known = state.near >= 0
            np.minimum(state.near + 1, self._last[state.near], out=state.near, where=known)

    def memory(self) -> dict[str, int]:
        ranges = {} if self._last is None else {"ranges": self._last.nbytes}
        return {"stepper": self._network.nbytes} | ranges


class DecompressorDecompression:
    """The Decompressor: the pose that belongs to features and latents.

    rows : the database's, where states are frames.
    """

    def __init__(self, model: Model, *, rows: Rows | None = None, compiled: bool = True) -> None:
        self._fps, self._rows = model.description.fps, rows
        self._network = Evaluator(model.decompressor, compiled=compiled)
        self._unpack = (kernels if compiled else kernels_numpy).unpack

    def decompress(self, state: Any, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        values = state.values if self._rows is None else self._rows.values(state.index)
        vectors = self._network.evaluate(values)
        self._unpack(
            vectors, self._fps, poses.positions, poses.rotations, poses.velocities, poses.angular_velocities,
            contacts,
        )  # fmt: skip

    def memory(self) -> dict[str, int]:
        rows = {} if self._rows is None else self._rows.memory()
        return {"decompressor": self._network.nbytes} | rows


class LookedUpPoses:
    """Poses of learned states from the database: those of the nearest frames, which the states remember."""

    def __init__(self, gathering: GatherDecompression, rows: Rows, nearest: Nearest) -> None:
        self._gather, self._rows, self._nearest = gathering, rows, nearest

    def decompress(self, state: LatentState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        state.near[:] = self._nearest.frames(state.values, state.near)
        self._gather.decompress(FrameState(state.near, self._rows.data), poses, contacts)

    def memory(self) -> dict[str, int]:
        return self._gather.memory() | self._nearest.memory()


def letters(learned: str | Iterable[str]) -> str:
    """Which stages are learned, in the order of PSD; anything else is a UserError."""
    asked = [letter.upper() for letter in learned]
    if len(set(asked)) < len(asked) or not set(asked) <= set(LETTERS):
        raise UserError(
            f"{''.join(learned)!r} does not name stages",
            remedy="P is the projector, S the stepper, D the decompressor: PSD for all of them, or some",
        )
    return "".join(letter for letter in LETTERS if letter in asked)


def stages(
    model: Model,
    *,
    learned: str = LETTERS,
    database: Database | None = None,
    index: str | search.Index = "exact",
    latents: NDArray | None = None,
    settings: Settings | None = None,
    compiled: bool = True,
) -> Stages:
    """Three stages, some of them learned.

    Parameters
    ----------
    model : the networks.
    learned : which stages are networks, of the letters P (Projection), S (Stepping) and D (Decompression).
        None of them is motion matching itself.
    database : what the model was trained from; needed unless all three are learned.
    index : a search index's name, or one built on the database; for classical Projection.
    latents : [T, L] of the database; None computes them where they are needed.
    settings : frames that are not searched.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """
    learned, settings = letters(learned), settings or Settings()
    if database is None:
        if learned != LETTERS:
            raise UserError(
                "stages that are not learned need the database", remedy="give it, or take all three learned"
            )
        return Stages(
            ProjectorProjection(model, compiled=compiled),
            StepperStepping(model, compiled=compiled),
            DecompressorDecompression(model, compiled=compiled),
        )
    model.check(database)
    return _mixed(model, learned, database, index, latents, settings, compiled)


def _mixed(
    model: Model,
    learned: str,
    database: Database,
    index: str | search.Index,
    latents: NDArray | None,
    settings: Settings,
    compiled: bool,
) -> Stages:
    projects, steps, decompresses = (letter in learned for letter in LETTERS)
    radius, ignore_end = (round(s * database.fps) for s in (settings.ignore_radius, settings.ignore_end))
    gather = (mm.kernels if compiled else mm.kernels_numpy).gather
    # What meets states of the other kind: classical Projection and Decompression learned ones, and so on.
    up, down = steps and not projects, steps and not decompresses
    guessed, fed = projects and not steps, decompresses and not steps
    rows, nearest = None, None
    if up or down or guessed or fed:
        rows = Rows(database, model.latents(database) if latents is None else latents)
    if rows is not None and (down or guessed):
        nearest = Nearest(model, database, rows, ignore_end=ignore_end if guessed else 0)

    projection: Projection
    if projects:
        projection = projector = ProjectorProjection(model, compiled=compiled)
        if guessed and nearest is not None:
            projection = GuessedFrames(projector, nearest, ignore_radius=radius)
    else:
        built = build_index(database, index, settings) if isinstance(index, str) else index
        projection = searching = SearchProjection(built, database.tags, ignore_radius=radius)
        if up and rows is not None:
            projection = SearchedLatents(searching, rows)

    stepping: Stepping = FrameStepping(database, ignore_end=ignore_end)
    if steps:
        stepping = StepperStepping(model, last=rows.data.last if rows else None, compiled=compiled)

    decompression: Decompression
    if decompresses:
        decompression = DecompressorDecompression(model, rows=rows if fed else None, compiled=compiled)
    else:
        decompression = gathering = GatherDecompression(database, gather=gather)
        if down and rows is not None and nearest is not None:
            decompression = LookedUpPoses(gathering, rows, nearest)
    return Stages(projection, stepping, decompression)
