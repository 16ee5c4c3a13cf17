"""Training of the Projector: from a query to the state that the exact search finds for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.evaluation.projector import distances
from lmm.frames import projector_inputs
from mm import queries as recorded
from mm.database import Database
from mm.queries import Queries

from .checkpoint import Errors
from .data import Data, floored, spread
from .decompressor import DecompressorStage
from .networks import Perceptron
from .randomness import generator, users
from .settings import Settings

Array = NDArray[np.float32]
JUDGED = 2000
# Weights of features, latents, and the distance to the query (REFERENCE 3.2).
WEIGHTS = (1.0, 5.0, 0.3)
MOST = 400_000  # recorded queries
FEWEST = 2_000
REUSE = 8  # how often a query is shown, where the training is not longer than their number allows
REAL = 0.5  # share of a batch that was recorded
LARGEST = 1.5  # times the residual of a recorded query is what a made one has at most
KINDS = {True: "crouched frames", False: "upright frames"}
ELSE = 0.1  # share of made queries that ask for the other kind of frames: crouched from upright ones


class ProjectorStage:
    """The Projector, on exact answers of `mm`'s search with the controller's exclusions (REFERENCE 3.1, 3.2).

    The published recipe asks for rows with much noise. Ours has half of its queries from a driven crowd, and
    makes the others, new ones for each batch, of rows and residuals of recorded queries, so that noise is of
    the size and kind that a controller's queries have (see `mm.queries.noise`).

    Of the controller's exclusions ours learns the ends of clips and the tags, but not the frames around the
    current one, which a network is not told. Were they left out, a query that the present pose answers best
    would have to be answered by some other clip, neighbouring queries by different ones, and the network by
    the mean of them, which glides. An answer near the present state is no transition, since it costs as much.
    Judged it is by all of them.
    """

    name = "projector"

    def __init__(self, data: Data, settings: Settings, before: DecompressorStage) -> None:
        self.settings, self._all, self._data, self._before = settings.projector, settings, data, before
        self._tag = _crouch_tag(data)
        self._begun = False
        features = data.features.shape[1]
        sizes = (features + bool(self._tag), *self.settings.hidden, features + settings.latent)
        self.projector = Perceptron(sizes, "relu", seed=settings.seed, name=self.name)

    def modules(self) -> Mapping[str, nn.Module]:
        return {"projector": self.projector}

    def begin(self) -> None:
        if self._begun:
            return
        data = self._data
        self._states = np.hstack([data.features, self._before.latents()])
        train = data.frames["training"]
        mean, std = spread(self._states[train])
        width = data.features.shape[1]
        asked = np.array([0.5] * bool(self._tag), np.float32)
        self.projector.normalise(
            input_mean=np.concatenate([mean[:width], asked]),
            input_std=np.concatenate([floored(std[:width]), asked]),
            output_mean=mean,
            output_std=std,
        )
        self.projector.to(self._all.device)
        self._tensor = torch.from_numpy(self._states).to(self._all.device)
        self._features_std = data.features[train].std(axis=0)
        playing = recorded.SETTINGS
        fps = data.database.fps
        self._limits = round(playing.ignore_radius * fps), round(playing.ignore_end * fps)
        self._index = recorded.index_of(
            data.database, ranges=data.ranges["training"], threads=torch.get_num_threads()
        )
        training, judging_user = users(self._all.seed)
        judging = self.answered(self._record(JUDGED, judging_user))
        # Queries of motion matching's crowd, and ones like them at held-out clips, with their answers.
        self.judged = {"training": judging}
        if "held_out" in data.parts():
            draw = generator(self._all.seed, "made queries")
            self.judged["held_out"] = self.answered(self._make(draw, JUDGED, judging, "held_out"))
        if self._all.recipe == "ours":
            count = min(max(self.settings.iterations * self.settings.batch // REUSE, FEWEST), MOST)
            self._real = self.answered(anywhere(self._record(count, training)))
        self._begun = True

    def _record(self, count: int, seed: int) -> Queries:
        """What a crowd asks that plays the clips that are trained on, and no others."""
        return recorded.record(self._data.database, count, seed=seed, index=self._index)

    def _make(
        self, draw: np.random.Generator, count: int, like: tuple[Queries, NDArray[np.int64]], part: str
    ) -> Queries:
        """Queries like recorded ones anywhere in a part: rows with the residuals of recorded queries."""
        real, frames = like
        some = draw.integers(0, len(frames), count)
        residual = real.features[some] - self._data.features[frames[some]]
        train = self._data.frames[part]
        rows = train[draw.integers(0, len(train), count)].astype(np.int32)
        size = draw.uniform(0, LARGEST, (count, 1)).astype(np.float32)
        features = self._data.features[rows] + size * residual
        crouches = (self._data.database.tags[rows] & np.uint32(self._tag)) != 0
        crouches ^= draw.random(count) < ELSE
        tag = np.full(count, self._tag, np.uint32)
        none = np.zeros(count, np.uint32)
        bound = np.full(count, np.inf, np.float32)
        return Queries(
            features, rows, bound, np.where(crouches, tag, none), np.where(crouches, none, tag),
            real.radius, real.ignore_end,
        )  # fmt: skip

    def made(self, draw: np.random.Generator, count: int) -> tuple[Queries, NDArray[np.int64]]:
        """So many made queries to train on, less those without an answer, and their answers."""
        return self.answered(anywhere(self._make(draw, count, self._real, "training")))

    def answered(self, queries: Queries) -> tuple[Queries, NDArray[np.int64]]:
        """Queries that have an answer, and the frames that answer them."""
        frames, _ = recorded.neighbours(self._index, queries)
        found = frames >= 0
        return queries.take(found), frames[found].astype(np.int64)

    def inputs(self, queries: Queries) -> Array:
        """What the network sees of queries."""
        return projector_inputs(queries.features, self._tag, queries.required)

    def batch(self, draw: np.random.Generator, batch: int) -> tuple[Array, NDArray[np.int64]]:
        """Inputs and answers of so many queries."""
        if self._all.recipe == "reference":
            queries, frames = self.answered(self._published(draw, batch))
            return self.inputs(queries), frames
        queries, frames = self._real
        which = draw.integers(0, len(queries), round(REAL * batch))
        made, found = self.made(draw, batch - len(which))
        inputs = np.concatenate([self.inputs(queries.take(which)), self.inputs(made)])
        return inputs, np.concatenate([frames[which], found])

    def _published(self, draw: np.random.Generator, count: int) -> Queries:
        """Rows with the published noise, N(0, 1) x U(0, 1) x (column's deviation + 1)."""
        train = self._data.frames["training"]
        rows = train[draw.integers(0, len(train), count)]
        shape = count, self._data.features.shape[1]
        noise = draw.standard_normal(shape) * draw.random((count, 1)) * (self._features_std + 1)
        tag = self._data.database.tags[rows] & np.uint32(self._tag)
        nothing = np.full(count, -1, np.int32)
        bound = np.full(count, np.inf, np.float32)
        return Queries(
            (self._data.features[rows] + noise).astype(np.float32), nothing, bound, tag,
            np.uint32(self._tag) & ~tag, *self._limits,
        )  # fmt: skip

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        draw = generator(self._all.seed, self.name, iteration)
        return self.loss_of(*self.batch(draw, self.settings.batch))

    def loss_of(self, found: Array, frames: NDArray[np.int64]) -> Mapping[str, Tensor]:
        """The loss of inputs and their answers."""
        width = self._data.features.shape[1]
        inputs = torch.from_numpy(np.ascontiguousarray(found, np.float32)).to(self._tensor.device)
        truth, query = self._tensor[torch.from_numpy(frames).to(inputs.device)], inputs[:, :width]
        states = self.projector(inputs)
        distance = (states[:, :width] - query).norm(dim=1) - (truth[:, :width] - query).norm(dim=1)
        return {
            "features": WEIGHTS[0] * (states - truth)[:, :width].abs().mean(),
            "latents": WEIGHTS[1] * (states - truth)[:, width:].abs().mean(),
            "distance": WEIGHTS[2] * distance.abs().mean(),
        }

    def evaluate(self) -> Errors:
        """On recorded queries of a user that is not trained on, and on queries made like them at clips that
        are held out: ``error_cm`` of the pose that is found, median ``regret`` (distance of the answer / of
        the true neighbour, which is a frame that is trained on), and the ``latent`` error in units of the
        latents' spread."""
        return {part: self.errors(*judged) for part, judged in self.judged.items() if len(judged[0])}

    def errors(self, queries: Queries, frames: NDArray[np.int64]) -> dict[str, float]:
        """What `evaluate` says of one part: of queries and the frames that answer them."""
        width = self._data.features.shape[1]
        states, truth = self.projector.evaluate(self.inputs(queries)), self._states[frames]
        vectors = self._before.decompressor.evaluate(states)
        asked, best = states[:, :width], truth[:, :width]
        schema = self._data.database.schema
        regret = distances(schema, queries.features, asked) / np.maximum(
            distances(schema, queries.features, best), 1e-6
        )
        latents = self._states[:, width:]
        spread_of = np.linalg.norm(latents - latents.mean(axis=0), axis=1).mean()
        wrong = np.linalg.norm((states - truth)[:, width:], axis=1).mean()
        return {
            "error_cm": float(self._before.joint_errors(vectors, frames).mean()),
            "regret": float(np.median(regret)),
            "latent": float(wrong / max(spread_of, 1e-6)),
        }


def kinds(database: Database) -> dict[str, set[str]]:
    """By clip, which kinds of frames a search may answer with it has: crouched ones, upright ones."""
    tag = np.uint32(database.tag_mask(["crouch"]) if "crouch" in database.tag_names else 0)
    crouched = (database.tags & tag) != 0
    ends = np.maximum(database.stops - round(recorded.SETTINGS.ignore_end * database.fps), database.starts)
    found: dict[str, set[str]] = {name: set() for name in database.names}
    for name, start, stop in zip(database.names, database.starts, ends, strict=True):
        found[name] |= {KINDS[kind] for kind in np.unique(crouched[start:stop]).tolist()}
    return found


def anywhere(queries: Queries) -> Queries:
    """The same queries, whose answers may lie near the frame that played."""
    return replace(queries, current=np.full(len(queries), -1, np.int32))


def _crouch_tag(data: Data) -> int:
    from mm.description import Description

    return int(Description.of(data.database, rigs=False).crouch_tag)
