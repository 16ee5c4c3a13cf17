"""Search indexes: find the database frames nearest to a query. A registry by name, one file an index."""

from __future__ import annotations

import importlib
from typing import Any

from numpy.typing import ArrayLike

from motion.errors import UserError

from .protocol import Exclusions, Index

__all__ = ["Exclusions", "Index", "build", "names"]

# Imported on first use: numba, SciPy and faiss each take a while to load.
_REGISTRY = {
    "brute": ("brute", "Brute"),
    "aabb": ("aabb", "Aabb"),
    "exact": ("exact", "Exact"),
    "kdtree": ("kdtree", "KdTree"),
    "two-phase": ("two_phase", "TwoPhase"),
    "faiss-flat": ("faiss_indexes", "Flat"),
    "faiss-ivf": ("faiss_indexes", "Ivf"),
    "faiss-hnsw": ("faiss_indexes", "Hnsw"),
    "faiss-pq": ("faiss_indexes", "Pq"),
}
_ANY_COST = ("brute", "exact", "two-phase")


def names(schema: Any = None) -> list[str]:
    """Names of the indexes that `build` knows; given a schema, of those that can search its cost."""
    return [name for name in _REGISTRY if schema is None or schema.euclidean or name in _ANY_COST]


def build(
    name: str,
    features: ArrayLike,
    starts: ArrayLike,
    stops: ArrayLike,
    *,
    ignore_end: int = 20,
    tags: ArrayLike | None = None,
    schema: Any = None,
    **options: Any,
) -> Index:
    """Build an index over normalised features.

    Parameters
    ----------
    name : one of `names`.
    features : float32 [T, F], normalised.
    starts, stops : int32 [R], first frame of each range and one past its last.
    ignore_end : last frames of each range that are never returned.
    tags : uint32 [T], tag bits of each frame.
    schema : `features.schema.Schema`; where its cost is not the squared Euclidean distance, only some indexes
        can search it. None: squared Euclidean.
    options : the index's own keyword options, see its class.

    An unknown name or option, or a cost that the index cannot search, is a UserError that lists the choices.
    """
    if name not in _REGISTRY:
        raise UserError(f"no search index {name!r}", remedy=f"choose one of {', '.join(_REGISTRY)}")
    if name not in names(schema):
        raise UserError(
            f"search index {name!r} cannot search the cost of this schema, which is not squared Euclidean",
            remedy=f"use one of {', '.join(_ANY_COST)}, or make all residuals squared",
        )
    module, kind = _REGISTRY[name]
    index_class = getattr(importlib.import_module(f"{__name__}.{module}"), kind)
    unknown = [option for option in options if option not in index_class.OPTIONS]
    if unknown:
        raise UserError(
            f"search index {name!r} has no option {unknown[0]!r}",
            remedy=f"its options are {', '.join(index_class.OPTIONS) or 'none'}",
        )
    return index_class(features, starts, stops, ignore_end=ignore_end, tags=tags, schema=schema, **options)
