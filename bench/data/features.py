"""Each column of the features: how it is spread, where it lies far out, what says the same as another one."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from features import normalise
from features.schema import Schema
from mm.database import Database

from .clips import Clips

Array = NDArray[np.floating]

PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "trajectory_position": "m",
    "height": "m",
}
FAR = 3.0  # spreads beyond the quartiles from which a value is far out, as box plots have it (Tukey)
NORMAL = 1.349  # quartiles of a normal distribution lie so many standard deviations apart
STILL = 0.01  # metres, m/s, rad/s or lengths of directions: what varies less hardly varies
FAINT = 0.05  # share of the deviation that the columns of a block share their scale by
SAME = 0.98  # correlation from which two columns say the same
JOINED = 0.2  # seconds between two passages that are one
PAIRS = 20_000


def raw(database: Database) -> NDArray[np.float32]:
    """Features in their units, float32 [T, F]."""
    return normalise.denormalise(np.asarray(database.features), database.offset, database.scale)


def columns(schema: Schema, values: Array) -> pd.DataFrame:
    """A row a column of raw values [T, F]: mean, deviation, quantiles, skewness, what is far out, whether it
    is nearly constant: it deviates by less than `STILL`, or by a small share, `FAINT`, of what the block does
    whose scale it has, so that it hardly counts."""
    values = np.asarray(values, np.float64)
    mean, std = values.mean(axis=0), values.std(axis=0)
    spread = np.where(std > 0, std, 1)
    quantiles = np.percentile(values, PERCENTILES, axis=0)
    table = pd.DataFrame(
        {
            "column": schema.columns,
            "feature": [f.name for f in schema.features for _ in f.column_names()],
            "unit": [UNITS.get(f.kind, "") for f in schema.features for _ in f.column_names()],
            "mean": mean,
            "std": std,
            "min": values.min(axis=0),
            **{f"p{p}": row for p, row in zip(PERCENTILES, quantiles, strict=True)},
            "max": values.max(axis=0),
            "skewness": np.where(std > 0, (((values - mean) / spread) ** 3).mean(axis=0), 0.0),
        }
    )
    table["far_out"] = (far(table, values) > FAR).mean(axis=0)
    table["constant"] = (std < STILL) | (std < FAINT * _of_blocks(schema, std))
    return table


def _of_blocks(schema: Schema, std: Array) -> Array:
    """The mean deviation [F] of the block that each column shares its scale with."""
    out = np.zeros(schema.size)
    for members in schema.groups().values():
        which = np.concatenate([np.arange(schema.size)[schema.slices[f.name]] for f in members])
        out[which] = std[which].mean()
    return out


def far(table: pd.DataFrame, values: Array) -> Array:
    """How far beyond its quartiles each value [T, F] lies, in spreads: between them it is negative or 0.

    The spread is what lies between the quartiles, or would if the column were as normal as its deviation
    says: feet that stand most of the time have their quartiles close together.
    """
    low, high = table["p25"].to_numpy(), table["p75"].to_numpy()
    spread = np.maximum(high - low, NORMAL * table["std"].to_numpy())
    return np.maximum(low - values, values - high) / np.where(spread > 0, spread, np.inf)


def outliers(table: pd.DataFrame, values: Array, clips: Clips) -> pd.DataFrame:
    """A row a passage of clips in which some column lies far out, the farthest first; values [T, F] of them.

    far : how far beyond the quartiles at the worst, in spreads; at_s : when; columns : how many at some time.
    """
    beyond = far(table, values)
    most = beyond.max(axis=1)
    rows = []
    for start, stop in clips.passages(most > FAR, join=JOINED):
        at = int(start + np.argmax(most[start:stop]))
        column = int(np.argmax(beyond[at]))
        place = clips.where(start, stop)
        rows.append(
            place
            | {
                "at_s": place["from_s"] + float((at - start) / clips.fps),
                "column": table["column"][column],
                "value": float(values[at, column]),
                "unit": table["unit"][column],
                "far": float(most[at]),
                "columns": int((beyond[start:stop] > FAR).any(axis=0).sum()),
            }
        )
    names = (*clips.where(0, 1), "at_s", "column", "value", "unit", "far", "columns")
    found = pd.DataFrame(rows, columns=names)
    return found.sort_values("far", ascending=False, kind="stable", ignore_index=True)


def correlation(schema: Schema, values: Array) -> pd.DataFrame:
    """Pearson's correlation of every two columns [F, F]; 0 with what does not vary at all."""
    values = np.asarray(values, np.float64)
    values = values - values.mean(axis=0)
    length = np.sqrt((values * values).sum(axis=0))
    values /= np.where(length > 0, length, 1)
    found = np.clip(values.T @ values, -1, 1)
    return pd.DataFrame(found, index=list(schema.columns), columns=list(schema.columns))


def redundant(correlations: pd.DataFrame, *, bound: float = SAME) -> pd.DataFrame:
    """A row a pair of columns that say the same: |correlation| above a bound, the strongest first."""
    values, names = correlations.to_numpy(), correlations.columns
    one, other = np.nonzero(np.triu(np.abs(values) > bound, k=1))
    order = np.argsort(-np.abs(values[one, other]), kind="stable")
    rows = [(names[i], names[j], float(values[i, j])) for i, j in zip(one[order], other[order], strict=True)]
    return pd.DataFrame(rows, columns=["column", "other", "correlation"])


def weights(schema: Schema, features: Array, nearest: Array, other: Array, *, seed: int = 0) -> pd.DataFrame:
    """A row a feature: its share of what the search compares frames by.

    any_share : of the cost of two frames at random, of features [T, F], normalised; near_share : of the cost
    of pairs that lie near each other, rows [M, F] nearest and other, which is what a search decides by.
    """
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, len(features), (2, PAIRS))
    shares = []
    for one, two in ((features[pairs[0]], features[pairs[1]]), (nearest, other)):
        costs = normalise.costs(schema, one, two).astype(np.float64).sum(axis=0)
        shares.append(costs / costs.sum() if costs.sum() > 0 else np.zeros_like(costs))
    return pd.DataFrame(
        {
            "feature": [f.name for f in schema.features],
            "kind": [f.kind for f in schema.features],
            "columns": [len(f.column_names()) for f in schema.features],
            "weight": [f.weight for f in schema.features],
            "any_share": shares[0],
            "near_share": shares[1],
        }
    )
