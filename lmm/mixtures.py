"""Chains of learned and classical stages: all eight combinations of `lmm.stages` and `mm.stages`.

A learned state is a feature and a latent vector, a classical one a frame; stepping says which of them a
chain holds. Where a stage of the other kind meets it, one lookup converts: a frame becomes its row of
features and latents; a learned state becomes the frame whose row is nearest, every column in units of its
standard deviation. Poses that are looked up play on, and change as motion matching's do: every so often the
nearest frame is taken where it is clearly nearer, and blended into.
"""

from __future__ import annotations

from collections.abc import Iterable

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

from . import kernels
from .evaluator import Products, check_products
from .model import Model
from .stages import DecompressorDecompression, LatentState, ProjectorProjection, StepperStepping

LETTERS = "PSD"
LEAST = 0.1  # of the mean deviation is what a column is divided by at least: rounding must not decide
COMBINATIONS = ("", "P", "S", "D", "PS", "PD", "SD", "PSD")


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

    @property
    def size(self) -> int:
        """F + L."""
        return self.width + self.latents.shape[1]

    def values(
        self, frames: NDArray[np.int32], out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Rows [N, F + L] of frames [N], in out [N or more, F + L] if that is given."""
        out = np.empty((len(frames), self.size), np.float32) if out is None else out[: len(frames)]
        kernels.rows_of(frames, self.data.features, self.latents.view(np.uint16), out)
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
        self._scale = (1 / np.maximum(std, LEAST * std.mean() or 1)).astype(np.float32)
        self._table = plain(rows.values(np.arange(len(database), dtype=np.int32)) * self._scale)
        self._index = search.build(
            "exact", self._table, database.starts, database.stops, ignore_end=ignore_end, tags=database.tags
        )

    def frames(
        self, values: NDArray[np.float32], exclude: search.Exclusions | None = None
    ) -> NDArray[np.int32]:
        """The nearest frames [N] of values [N, F + L]; -1 where all are excluded."""
        return self._index.search(values * self._scale, exclude=exclude)[0][:, 0]

    def better(
        self, values: NDArray[np.float32], near: NDArray[np.int32], share: NDArray[np.float32]
    ) -> NDArray[np.int32]:
        """Frames [N] nearer to values [N, F + L] than frames near [N] are; -1 where there is none.

        Their squared distance is below share [N] of that of near; where that is infinite anything will do.
        """
        points = values * self._scale
        difference = points - self._table[near]
        bound = np.einsum("nc,nc->n", difference, difference)
        np.multiply(bound, share, out=bound, where=np.isfinite(share))
        bound[np.isinf(share)] = np.inf
        return self._index.search(points, bound=bound)[0][:, 0]

    def memory(self) -> dict[str, int]:
        return {"lookup": self._table.nbytes + self._index.nbytes}


class GuessedFrames:
    """The Projector for classical states: the frame nearest to its guess, away from the one that plays.

    It costs what the frame does, since that is what would play.
    """

    def __init__(self, projector: ProjectorProjection, nearest: Nearest, *, ignore_radius: int) -> None:
        self.projector, self._nearest, self._radius = projector, nearest, ignore_radius

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        self.projector.check_tags(required_tags, forbidden_tags)
        exclude = search.Exclusions(state.frames(), self._radius, required_tags, forbidden_tags)
        frames = self._nearest.frames(self.projector.guess(queries, required_tags), exclude)
        lost = frames < 0
        candidates = FrameState(np.where(lost, state.frames(), frames), state.data)
        found_costs = normalise.total_costs(self.projector.schema, queries, candidates.features())
        found_costs[lost] = np.inf
        return candidates, found_costs, found_costs < bound

    def retune(self, settings: Settings, fps: float) -> None:
        self._radius = round(settings.ignore_radius * fps)

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return self.projector.possible(required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self.projector.memory() | self._nearest.memory()


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

    def retune(self, settings: Settings, fps: float) -> None:
        self._search.retune(settings, fps)

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return self._search.possible(required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self._search.memory() | self._rows.memory()


class DecompressedFrames:
    """The Decompressor for classical states: of the features and latents that belong to the frames."""

    def __init__(self, decompressor: DecompressorDecompression, rows: Rows) -> None:
        self._decompressor, self._rows = decompressor, rows
        self._values = np.zeros((1, rows.size), np.float32)

    def decompress(self, state: FrameState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        if len(state) > len(self._values):
            self._values = np.zeros((len(state), self._rows.size), np.float32)
        self._decompressor.decode(self._rows.values(state.index, self._values), poses, contacts)

    def memory(self) -> dict[str, int]:
        own = self._decompressor.memory()
        return own | self._rows.memory() | {"workspace": own["workspace"] + self._values.nbytes}


class LookedUpPoses:
    """Poses of learned states from the database: of frames that play on while they are near to the states.

    At every search interval, and where a range ends, the nearest frame is looked up, and with the next step
    taken where its squared distance is below that of the frame that plays by the continuing bias. With both
    as motion matching's own searches have them poses are as smooth as its; by the frame that is nearest in
    each frame they would change 30 to 60 times a second, between frames that are hardly nearer.
    """

    def __init__(
        self,
        gathering: GatherDecompression,
        rows: Rows,
        nearest: Nearest,
        *,
        settings: Settings,
        fps: float,
    ) -> None:
        self._gather, self._rows, self._nearest = gathering, rows, nearest
        self._flags = np.zeros((2, 1), np.bool_)
        self.retune(settings, fps)

    def retune(self, settings: Settings, fps: float) -> None:
        self._interval = max(1, round(settings.search_interval * fps))
        self._share = np.float32(1 - settings.continuing_bias)

    def decompress(self, state: LatentState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        if len(state) > self._flags.shape[1]:
            self._flags = np.zeros((2, len(state)), np.bool_)
        due, ended = self._flags[:, : len(state)]
        if np.less(state.near, 0, out=due).any():
            unknown = np.flatnonzero(due)
            state.near[unknown] = self._nearest.frames(state.values[unknown])
            state.since[unknown] = 0
        playing = FrameState(state.near, self._rows.data)
        self._gather.decompress(playing, poses, contacts)
        playing.ended(ended)
        np.greater_equal(state.since, self._interval, out=due)
        np.logical_or(due, ended, out=due)
        state.moved[:] = False
        if due.any():
            who = np.flatnonzero(due)
            share = np.where(ended[who], np.float32(np.inf), self._share)
            better = self._nearest.better(state.values[who], state.near[who], share)
            state.since[who] = 0
            state.moved[who] = better >= 0
            state.near[state.moved] = better[better >= 0]

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
    products: Products = "float32",
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
    products : bfloat16 makes crowds cheaper on processors with matrix tiles (see `bench crowd` and
        `lmm.evaluator`); one that does not multiply such numbers is a UserError.
    compiled : use the compiled kernels; False takes their NumPy twins, for tests.
    """
    learned, settings = letters(learned), settings or Settings()
    check_products(products, compiled=compiled)
    radius = round(settings.ignore_radius * model.description.fps)
    if database is None:
        if learned != LETTERS:
            raise UserError(
                "stages that are not learned need the database", remedy="give it, or take all three learned"
            )
        return Stages(
            ProjectorProjection(model, ignore_radius=radius, products=products, compiled=compiled),
            StepperStepping(model, products=products, compiled=compiled),
            DecompressorDecompression(model, products=products, compiled=compiled),
        )
    model.check(database)
    return _mixed(model, learned, database, index, latents, settings, products, compiled)


def _mixed(
    model: Model,
    learned: str,
    database: Database,
    index: str | search.Index,
    latents: NDArray | None,
    settings: Settings,
    products: Products,
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
        if rows.latents.shape[1:] != (model.L,):
            what = f"latents of shape {list(rows.latents.shape)}, expected [{len(database)}, {model.L}]"
            raise UserError(what, remedy="make them with this model")
    if rows is not None and (down or guessed):
        nearest = Nearest(model, database, rows, ignore_end=ignore_end)

    projection: Projection
    if projects:
        projection = projector = ProjectorProjection(
            model, ignore_radius=radius, products=products, compiled=compiled
        )
        if guessed and nearest is not None:
            projection = GuessedFrames(projector, nearest, ignore_radius=radius)
    else:
        built = build_index(database, index, settings) if isinstance(index, str) else index
        projection = searching = SearchProjection(built, database.tags, ignore_radius=radius)
        if up and rows is not None:
            projection = SearchedLatents(searching, rows)

    stepping: Stepping = FrameStepping(database, ignore_end=ignore_end)
    if steps:
        last, tags = (rows.data.last, rows.data.tags) if rows else (None, None)
        stepping = StepperStepping(
            model, last=last, tags=tags if up else None, products=products, compiled=compiled
        )

    decompression: Decompression
    if decompresses:
        decompression = decompressor = DecompressorDecompression(model, products=products, compiled=compiled)
        if fed and rows is not None:
            decompression = DecompressedFrames(decompressor, rows)
    else:
        decompression = gathering = GatherDecompression(database, gather=gather)
        if down and rows is not None and nearest is not None:
            decompression = LookedUpPoses(gathering, rows, nearest, settings=settings, fps=database.fps)
    return Stages(projection, stepping, decompression)
