"""A compressed database in the engine: the classical stages, of which Decompression decodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion.pose import Poses

from .. import search
from ..controller import Controller, build_index
from ..settings import Settings
from ..stages import FrameState, FrameStepping, SearchProjection, Stages
from . import kernels, kernels_numpy
from .compressed import Compressed


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
        return self._tables.memory()


def stages(
    compressed: Compressed,
    *,
    index: str | search.Index = "exact",
    settings: Settings | None = None,
    compiled: bool = True,
) -> Stages:
    """The classical stages on a compressed database; the index searches the features decoded."""
    settings = settings or Settings()
    index = build_index(compressed, index, settings) if isinstance(index, str) else index
    return Stages(
        SearchProjection(
            index, compressed.tags, ignore_radius=round(settings.ignore_radius * compressed.fps)
        ),
        FrameStepping(compressed, ignore_end=round(settings.ignore_end * compressed.fps)),
        DecodedPoses(compressed, compiled=compiled),
    )


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
    index = build_index(compressed, index, settings or Settings()) if isinstance(index, str) else index
    return Controller(
        compressed.description,
        count=count,
        settings=settings,
        three_stages=stages(compressed, index=index, settings=settings, compiled=compiled),
        obstacles=obstacles,
        compiled=compiled,
        name=name or f"mm {index.name} {compressed.codec.name}",
    )
