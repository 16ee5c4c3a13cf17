"""How good the Projector's answers are beside those of exact search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features import normalise
from features.schema import Schema
from lmm.frames import projector_inputs
from lmm.model import Model
from mm import queries as recorded
from mm.database import Database
from mm.queries import Queries

Array = NDArray[np.floating]

CHUNK = 4096
BINS = np.linspace(0, 3, 61)  # of the histogram of regret; what is more goes into the last one


def answers(model: Model, queries: Queries) -> NDArray[np.float32]:
    """States [M, F + L] that the projector gives for queries."""
    inputs = projector_inputs(queries.features, model.description.crouch_tag, queries.required)
    parts = [model.projector.evaluate(inputs[i : i + CHUNK]) for i in range(0, len(inputs), CHUNK)]
    return np.concatenate(parts) if parts else np.zeros((0, model.F + model.L), np.float32)


def distances(schema: Schema, queries: Array, rows: Array) -> NDArray[np.float64]:
    """Distance [M] of pairs of normalised features [M, F]: the root of the cost where that is a square."""
    costs = normalise.total_costs(schema, queries, rows).astype(np.float64)
    return np.sqrt(costs) if schema.euclidean else costs


def answer_errors(
    schema: Schema,
    queries: Array,
    answer: Array,
    answer_latents: Array,
    neighbour: Array,
    neighbour_latents: Array,
    latent_std: Array,
    bound: Array | None = None,
) -> dict[str, Any]:
    """How answers (features [M, F], latents [M, L]) compare with the true neighbours of queries [M, F].

    regret : distance of query and answer / distance of query and neighbour: median, mean and p95, and shares,
        the histogram over `BINS`. Below 1 the answer is no row of the data, but nearer to the query.
    latent_error, latent_error_median : root mean square, over queries (and median of each query's own),
        of the latents' difference in units of their standard deviation.
    feature_error : root mean square difference of answer and neighbour over columns that vary.
    decisions : where bound [M], what playing on costs less the bias, is given: the share of queries where
        answer and neighbour are both worth a jump or neither is, and the shares that jump.
    """
    truth = distances(schema, queries, neighbour)
    mine = distances(schema, queries, answer)
    ratio = mine[truth > 0] / truth[truth > 0]
    missed = (answer_latents - neighbour_latents) / np.where(latent_std > 0, latent_std, 1)
    each = np.sqrt((missed.astype(np.float64) ** 2).mean(axis=-1))
    found: dict[str, Any] = {
        "queries": len(queries),
        "regret": {
            "median": float(np.median(ratio)),
            "mean": float(ratio.mean()),
            "p95": float(np.percentile(ratio, 95)),
            "shares": (np.histogram(np.minimum(ratio, BINS[-1]), BINS)[0] / len(ratio)).tolist(),
        },
        "latent_error": float(np.sqrt((each**2).mean())),
        "latent_error_median": float(np.median(each)),
        "feature_error": float(np.sqrt(((answer - neighbour).astype(np.float64) ** 2).mean())),
    }
    if bound is not None:
        power = 2 if schema.euclidean else 1
        jumps, should = mine**power < bound, truth**power < bound
        found["decisions"] = {
            "as_search": float((jumps == should).mean()),
            "jumps": float(jumps.mean()),
            "search_jumps": float(should.mean()),
        }
    return found


def errors(
    model: Model,
    database: Database,
    queries: Queries,
    latents: Array | None = None,
    *,
    ranges: ArrayLike | None = None,
    index: Any = None,
) -> dict[str, Any]:
    """`answer_errors` of a model, the true neighbours being frames of some ranges (all by default).

    Decisions are left out where a query does not come from a frame that plays. Besides, off_data: how far the
    answers' features lie from the nearest row, and queries_off_data: how far the neighbours lie from the
    queries (medians). An answer that is no number is infinitely far from all. latents [T, L] and index
    (`mm.queries.index_of`) where they are made already.
    """
    latents = model.latents(database) if latents is None else latents
    index = recorded.index_of(database, ranges=ranges) if index is None else index
    frames, _ = recorded.neighbours(index, queries)
    asked = queries.take(frames >= 0)
    frames = frames[frames >= 0]
    states = answers(model, asked)
    known = np.isfinite(states).all(axis=1)
    states[~known] = np.inf
    found = answer_errors(
        database.schema,
        asked.features,
        states[:, : model.F],
        states[:, model.F :],
        database.features[frames],
        latents[frames],
        model.state_std[model.F :],
        asked.bound if np.all(asked.current >= 0) else None,
    )
    nearest, _ = recorded.index_of(database, ignore_end=0).search(states[known, : model.F])
    gaps = np.full(len(states), np.inf)
    gaps[known] = distances(database.schema, states[known, : model.F], database.features[nearest[:, 0]])
    asked_off = distances(database.schema, asked.features, database.features[frames])
    return found | {"off_data": float(np.median(gaps)), "queries_off_data": float(np.median(asked_off))}


def noisy_rows(
    database: Database, queries: Queries, *, ranges: ArrayLike | None = None, seed: int = 0
) -> Queries:
    """Rows of some ranges at random, each with a query's residual as noise, as many as there are queries.

    See `mm.queries.residuals`. They ask for the tags that the row bears, and leave no frames out.
    """
    rng = np.random.default_rng(seed)
    noise = recorded.residuals(database, queries)
    chosen = np.ones(len(database.starts), bool) if ranges is None else np.asarray(ranges, bool)
    rows = rng.choice(np.flatnonzero(chosen[database.ranges()]), len(queries))
    noise = noise[rng.integers(0, len(noise), len(rows))]
    asked = np.bitwise_or.reduce(queries.required | queries.forbidden, initial=0)
    return Queries(
        features=database.features[rows] + noise,
        current=np.full(len(rows), -1, np.int32),
        bound=np.full(len(rows), np.inf, np.float32),
        required=database.tags[rows] & asked,
        forbidden=~database.tags[rows] & asked,
        radius=queries.radius,
        ignore_end=queries.ignore_end,
    )
