"""A database whose features weigh otherwise: for who tries weights before building with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from features import normalise
from features.schema import Schema
from motion.config import choices
from motion.errors import UserError

from .database import Database


def with_weights(schema: Schema, weights: Mapping[str, float]) -> Schema:
    """A schema with other weights of some features, by name; unknown names are a UserError."""
    for name in weights:
        if name not in schema.slices:
            raise UserError(f"no feature {name!r} in schema {schema.name!r}", remedy=choices(schema.slices))
    features = (replace(f, weight=float(weights.get(f.name, f.weight))) for f in schema.features)
    return replace(schema, features=tuple(features))


def reweighted(database: Database, weights: Mapping[str, float]) -> Database:
    """The database with other weights of some features; all else stays.

    It is what building it with a schema of these weights gives, but for rounding. What was made by the old
    weights, indexes and networks, does not know of the new ones. Errors: see `with_weights`.
    """
    schema = with_weights(database.schema, weights)
    raw = normalise.denormalise(database.features, database.offset, database.scale)
    offset, scale = normalise.fit(schema, raw)
    found = normalise.normalise(raw, offset, scale)
    return replace(database, schema=schema, features=found, offset=offset, scale=scale, fingerprint="")
