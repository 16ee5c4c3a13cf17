"""What every search index takes and returns, and the checks that they share."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.errors import NotFinite, UserError
from motion.plain import plain

from .rows import sound


@dataclass(eq=False)
class Exclusions:
    """Frames that a search must not return, besides the ends of ranges; every part is optional.

    Attributes
    ----------
    current : int32 [N], the frame each query comes from; frames f with |f - current| < radius are skipped.
        -1 skips nothing.
    radius : frames.
    required_tags, forbidden_tags : uint32 [N], tag bits that a frame must all bear, must none of bear.
    """

    current: NDArray[np.int32] | None = None
    radius: int = 20
    required_tags: NDArray[np.uint32] | None = None
    forbidden_tags: NDArray[np.uint32] | None = None


class Index(Protocol):
    """A search structure over the normalised features of a database.

    `nbytes` is the memory that the index holds beyond the feature matrix it was built from.
    """

    name: str
    nbytes: int

    def search(
        self,
        queries: ArrayLike,
        *,
        k: int = 1,
        bound: ArrayLike | None = None,
        exclude: Exclusions | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """The k cheapest allowed frames of each query, cheapest first.

        Parameters
        ----------
        queries : float32 [N, F], normalised features; one query [F] counts as a batch of one.
        k : answers per query.
        bound : float32 [N], only frames cheaper than this are returned (the cost of playing on, say).
        exclude : frames not to return.

        Returns
        -------
        frames : int32 [N, k], -1 where no frame is cheap enough.
        costs : float32 [N, k], squared Euclidean distance in normalised space (or the schema's own cost);
            where frame is -1, the bound, or infinity without one.
        """
        ...


@dataclass(eq=False, slots=True)
class Request:
    """A checked search: contiguous arrays of the right type and length, ready for a kernel."""

    queries: NDArray[np.float32]
    k: int
    bound: NDArray[np.float32]
    current: NDArray[np.int32]
    radius: int
    required: NDArray[np.uint32]
    forbidden: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.queries)

    def empty(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """The answer before anything is found: frames [N, k] of -1, costs [N, k] of the bound."""
        frames = np.empty((len(self), self.k), np.int32)
        frames.fill(-1)
        return frames, self.bound.repeat(self.k).reshape(frames.shape)


def check(
    width: int,
    queries: ArrayLike,
    k: int = 1,
    bound: ArrayLike | None = None,
    exclude: Exclusions | None = None,
) -> Request:
    """Coerce the arguments of a search over features of a width; a UserError says what does not fit."""
    queries = np.ascontiguousarray(queries, np.float32)
    if not queries.flags.writeable:  # rows of a database, say: kernels are compiled for a controller's own
        queries = queries.copy()
    if queries.ndim == 1:
        queries = queries[None]
    if queries.ndim != 2 or queries.shape[1] != width:
        raise UserError(
            f"query of shape {list(queries.shape)}, expected [N, {width}]",
            remedy="build the query with the schema of the database",
        )
    if k < 1:
        raise UserError(f"k is {k}, expected 1 or more")
    count, exclude = len(queries), exclude or Exclusions()
    limits = _column("bound", bound, np.inf, np.float32, count)
    if not sound(queries, limits):
        wrong = np.argwhere(~np.isfinite(queries))
        if len(wrong) == 0:
            raise NotFinite("a bound is NaN", remedy="give it a number, or infinity for none")
        row, column = wrong[0]
        raise NotFinite(
            f"query {row} is {queries[row, column]} in column {column}", remedy="give it finite numbers"
        )
    return Request(
        queries,
        int(k),
        limits,
        _column("current", exclude.current, -1, np.int32, count),
        int(exclude.radius),
        _column("required_tags", exclude.required_tags, 0, np.uint32, count),
        _column("forbidden_tags", exclude.forbidden_tags, 0, np.uint32, count),
    )


def _column(name: str, values: ArrayLike | None, default: float, dtype: type, count: int) -> NDArray:
    """values, or one for all, as [count]."""
    if values is None:
        return _filled(count, default, dtype)
    if type(values) is np.ndarray and values.dtype.type is dtype and values.shape == (count,):
        return values if values.flags.carray else values.copy()
    array: NDArray = np.asarray(values, dtype)
    if array.shape not in ((), (1,), (count,)):
        raise UserError(f"{name} of shape {list(array.shape)}, expected [{count}]")
    return np.array(np.broadcast_to(array, count))


@functools.lru_cache(64)
def _filled(count: int, value: float, dtype: type) -> NDArray:
    """An array that nobody writes to, made once."""
    return np.full(count, value, dtype)


def spans(
    count: int, starts: ArrayLike, stops: ArrayLike, ignore_end: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """First frame, and one past the last that may ever be returned, of each range, int32 [R] each."""
    starts, stops = np.ascontiguousarray(starts, np.int32), np.ascontiguousarray(stops, np.int32)
    if starts.shape != stops.shape or starts.ndim != 1:
        raise UserError(f"range starts {list(starts.shape)} and stops {list(stops.shape)} differ in shape")
    if np.any(starts < 0) or np.any(stops > count) or np.any(stops < starts):
        raise UserError(f"a range lies outside the {count} frames, or ends before it starts")
    return starts, np.maximum(starts, stops - np.int32(max(0, ignore_end)))


def searchable(count: int, starts: ArrayLike, stops: ArrayLike, ignore_end: int) -> NDArray[np.int32]:
    """Frames that may ever be returned, int32, ascending: all ranges without each one's last ignore_end."""
    allowed = np.zeros(count, bool)
    for start, end in zip(*spans(count, starts, stops, ignore_end), strict=True):
        allowed[start:end] = True
    return np.flatnonzero(allowed).astype(np.int32)


def matrix(features: ArrayLike) -> NDArray[np.float32]:
    """Features as a contiguous float32 [T, F] of finite numbers, or a UserError."""
    features = np.ascontiguousarray(features, np.float32)
    if features.ndim != 2 or features.shape[1] == 0:
        raise UserError(f"features of shape {list(features.shape)}, expected [T, F]")
    if not np.isfinite(features).all():
        frame, column = np.argwhere(~np.isfinite(features))[0]
        raise UserError(
            f"features hold {features[frame, column]} at frame {frame}, column {column}",
            remedy="build the database again from clips without broken frames",
        )
    return plain(features)


def tag_bits(tags: ArrayLike | None, count: int) -> NDArray[np.uint32]:
    """Tags as contiguous uint32 [T], none if not given."""
    bits = np.zeros(count, np.uint32) if tags is None else np.ascontiguousarray(tags, np.uint32)
    if bits.shape != (count,):
        raise UserError(f"tags of shape {list(bits.shape)}, expected [{count}]")
    return plain(bits)
