"""Four indexes of the library faiss: flat (exact), inverted file, HNSW graph, product quantisation."""

from __future__ import annotations

import copy
from typing import Any, Self

import faiss as library
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import brute, overfetch
from .protocol import Exclusions, check, matrix, searchable, tag_bits

faiss: Any = library  # its type stubs do not know the Python side's arguments
_ROWS_PER_CENTROID = 39  # faiss warns when its k-means gets fewer
_KEPT = 16  # selections of rows by tags, of a bit a row


class _Faiss:
    """What the four share. `nbytes` is the size of faiss's own structure, which holds its copy of the rows.

    Returned costs are true costs: the neighbours that faiss names are ranked again, `rerank` of them beyond
    those needed. Tags go to faiss as a selector, the current frame's neighbourhood is met by asking for more.
    Where an approximate index then runs out of neighbours (or takes no selector), all rows are looked at, so
    that rare tags are not missed.
    """

    name = ""
    OPTIONS: tuple[str, ...] = ("rerank",)
    SEARCHING: tuple[str, ...] = ("rerank",)  # options that nothing is built by
    SELECTS = True  # whether faiss's index takes a selector of rows

    def __init__(
        self,
        features: ArrayLike,
        starts: ArrayLike,
        stops: ArrayLike,
        *,
        ignore_end: int = 20,
        tags: ArrayLike | None = None,
        schema: Any = None,
        rerank: int = 0,
        **options: Any,
    ) -> None:
        self.features = matrix(features)
        self.frames = searchable(len(self.features), starts, stops, ignore_end)
        self.tags = tag_bits(tags, len(self.features))
        self.rerank = rerank
        rows = self.features[self.frames]
        self.faiss = self._make(rows, **options)
        self.width = self.faiss.d
        rows = self._pad(rows)
        if not self.faiss.is_trained:
            self.faiss.train(rows)
        self.faiss.add(rows)
        self.nbytes = faiss.serialize_index(self.faiss).nbytes + self.frames.nbytes
        self._by_tags: dict[tuple[int, int], Any] = {}

    def searching(self, **options: Any) -> Self:
        """The same index with other options of those in `SEARCHING`; what was built is shared."""
        if unknown := set(options) - set(self.SEARCHING):
            raise ValueError(f"{sorted(unknown)} of {self.SEARCHING}")
        other = copy.copy(self)
        vars(other).update(options, _by_tags={})
        return other

    def _make(self, rows: NDArray[np.float32], **options: Any) -> Any:
        raise NotImplementedError

    def _parameters(self, **selector: Any) -> Any:
        return faiss.SearchParameters(**selector)

    def _pad(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.pad(rows, ((0, 0), (0, self.width - rows.shape[1])))

    def search(
        self,
        queries: ArrayLike,
        *,
        k: int = 1,
        bound: ArrayLike | None = None,
        exclude: Exclusions | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """See `mm.search.Index`."""
        ask = check(self.features.shape[1], queries, k, bound, exclude)
        padded = self._pad(ask.queries) if self.width > ask.queries.shape[1] else ask.queries
        frames, costs = ask.empty()
        for n in range(len(ask)):
            limits = (ask.current[n], ask.radius, ask.required[n], ask.forbidden[n])
            tagged = bool(ask.required[n] or ask.forbidden[n])
            parameters = self._of_tags(int(ask.required[n]), int(ask.forbidden[n]))

            def nearest(count: int, n: int = n, parameters: Any = parameters) -> NDArray[np.integer]:
                if count == 0:
                    return np.zeros(0, np.int64)
                _, places = self.faiss.search(padded[n : n + 1], count, params=parameters)
                return places[0][places[0] >= 0]

            ran_out = (tagged and not self.SELECTS) or overfetch.answer(
                nearest, self.features, self.frames, self.tags, ask, n,
                self.rerank + self._neighbours(ask.current[n], ask.radius), frames[n], costs[n],
            )  # fmt: skip
            if ran_out and self.name != "faiss-flat":
                brute.scan(
                    self.features, self.frames, self.tags, ask.queries[n], overfetch.EUCLIDEAN, *limits,
                    frames[n], costs[n],
                )  # fmt: skip
        return frames, costs

    def _of_tags(self, required: int, forbidden: int) -> Any:
        """faiss's own parameters of a search for tags; kept, since most searches ask for what others did."""
        if not self.SELECTS:
            return None
        key = required, forbidden
        if key not in self._by_tags:
            if len(self._by_tags) == _KEPT:
                self._by_tags.clear()
            selector = {}
            if required or forbidden:
                bits = self.tags[self.frames]
                allowed = ((bits & required) == required) & ((bits & forbidden) == 0)
                selector = {"sel": faiss.IDSelectorBitmap(np.packbits(allowed, bitorder="little"))}
            self._by_tags[key] = self._parameters(**selector)
        return self._by_tags[key]

    def _neighbours(self, current: int, radius: int) -> int:
        """How many rows the exclusion of a current frame's neighbourhood can take out."""
        if current < 0:
            return 0
        low, high = np.searchsorted(self.frames, (current - radius + 1, current + radius))
        return int(high - low)


class Flat(_Faiss):
    """Exact: all rows, by faiss. Options: rerank."""

    name = "faiss-flat"

    def _make(self, rows: NDArray[np.float32], **options: Any) -> Any:
        return faiss.IndexFlatL2(rows.shape[1])


class Ivf(_Faiss):
    """Approximate: the `probes` nearest of `cells` k-means cells (default 4 sqrt(T)).

    Options: cells, probes, rerank.
    """

    name = "faiss-ivf"
    OPTIONS = ("cells", "probes", "rerank")
    SEARCHING = ("probes", "rerank")

    def _make(
        self, rows: NDArray[np.float32], cells: int | None = None, probes: int = 32, **options: Any
    ) -> Any:
        wanted = int(4 * len(rows) ** 0.5) if cells is None else cells
        cells = max(1, min(wanted, len(rows) // _ROWS_PER_CENTROID))
        if len(rows) < _ROWS_PER_CENTROID:
            return faiss.IndexFlatL2(rows.shape[1])
        index = faiss.IndexIVFFlat(faiss.IndexFlatL2(rows.shape[1]), rows.shape[1], cells)
        self.probes = probes
        return index

    def _parameters(self, **selector: Any) -> Any:
        if isinstance(self.faiss, faiss.IndexIVF):
            return faiss.SearchParametersIVF(nprobe=min(self.probes, self.faiss.nlist), **selector)
        return super()._parameters(**selector)


class Hnsw(_Faiss):
    """Approximate: a navigable graph of `links` neighbours a row, searched with `effort` candidates.

    Options: links, effort, rerank.
    """

    name = "faiss-hnsw"
    OPTIONS = ("links", "effort", "rerank")
    SEARCHING = ("effort", "rerank")

    def _make(self, rows: NDArray[np.float32], links: int = 32, effort: int = 64, **options: Any) -> Any:
        index = faiss.IndexHNSWFlat(rows.shape[1], links)
        self.effort = effort
        return index

    def _parameters(self, **selector: Any) -> Any:
        return faiss.SearchParametersHNSW(efSearch=self.effort, **selector)


class Pq(_Faiss):
    """Approximate: a code of 8 bits (fewer for few rows) for `columns` columns, `rerank` ranked by true cost.

    Fewer than 624 rows stay as they are. Options: columns, rerank.
    """

    name = "faiss-pq"
    OPTIONS = ("columns", "rerank")
    SELECTS = False

    def __init__(self, *args: Any, rerank: int = 64, **options: Any) -> None:
        super().__init__(*args, rerank=rerank, **options)

    def _make(self, rows: NDArray[np.float32], columns: int = 3, **options: Any) -> Any:
        bits = min(8, int(np.log2(max(1, len(rows) // _ROWS_PER_CENTROID))))
        if bits < 4:
            return faiss.IndexFlatL2(rows.shape[1])
        codes = -(-rows.shape[1] // columns)
        return faiss.IndexPQ(codes * columns, codes, bits)
