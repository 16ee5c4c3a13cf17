"""A compressed database in the engine: the classical stages, of which Decompression decodes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.pose import Poses

from .. import search
from ..controller import Controller, build_index
from ..settings import Settings
from ..stages import Frames, FrameState, FrameStepping, SearchProjection, Stages, last_frames, plain
from . import kernels, kernels_numpy
from .compressed import Compressed
from .search import Coded


class DecodedPoses:
    """Poses of frames, decoded; implements `mm.stages.Decompression` for classical states.

    Takes two kilobytes or so to decode in, whatever the count of characters.
    """

    def __init__(self, compressed: Compressed, *, compiled: bool = True) -> None:
        self._decode = (kernels if compiled else kernels_numpy).decode
        self._tables = compressed.tables
        self._spare = Poses.empty(kernels.SPARE, len(compressed.skeleton))

    def decompress(self, state: FrameState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        self._decode(
            state.index, self._tables, self._spare.positions, self._spare.rotations,
            poses.positions, poses.rotations, poses.velocities, poses.angular_velocities, contacts,
        )  # fmt: skip

    def memory(self) -> dict[str, int]:
        spare = sum(array.nbytes for array in self._spare.arrays().values())
        return self._tables.memory() | {"workspace": spare}


def stages(
    compressed: Compressed,
    *,
    index: str | search.Index = "exact",
    settings: Settings | None = None,
    compiled: bool = True,
) -> Stages:
    """The classical stages on a compressed database.

    The index, by its name or built by `index_of`, searches the features decoded; "coded" those of 8 bits as
    they are stored (`mm.codecs.search`), which takes longer, and far less memory.
    """
    settings = settings or Settings()
    index = index_of(compressed, index, settings) if isinstance(index, str) else index
    data = None
    if isinstance(index, Coded):
        rows: Any = index.rows  # has of an array what states ask for
        data = Frames(rows, plain(compressed.tags), last_frames(compressed))
    return Stages(
        SearchProjection(
            index, compressed.tags, ignore_radius=round(settings.ignore_radius * compressed.fps)
        ),
        FrameStepping(compressed, ignore_end=round(settings.ignore_end * compressed.fps), data=data),
        DecodedPoses(compressed, compiled=compiled),
    )


def index_of(compressed: Compressed, name: str, settings: Settings) -> search.Index:
    """A search index over a compressed database; "coded", or one that `mm.search` knows."""
    if name == Coded.name:
        return Coded(compressed, ignore_end=round(settings.ignore_end * compressed.fps))
    return build_index(compressed, name, settings)


def controller(
    compressed: Compressed,
    *,
    count: int = 1,
    settings: Settings | None = None,
    index: str | search.Index = "exact",
    obstacles: ArrayLike = (),
    compiled: bool = True,
    name: str | None = None,
) -> Controller:
    """Motion matching on a compressed database; parameters as `mm.controller.Controller` has them."""
    index = index_of(compressed, index, settings or Settings()) if isinstance(index, str) else index
    return Controller(
        compressed.description,
        count=count,
        settings=settings,
        three_stages=stages(compressed, index=index, settings=settings, compiled=compiled),
        obstacles=obstacles,
        compiled=compiled,
        name=name or f"mm {index.name} {compressed.codec.name}",
    )
