"""How far the poses that a system's Decompression makes of frames are from those of the data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lmm.evaluation.decompressor import pose_errors
from mm.database import Database

from .entry import Decoder

MOST, STRETCH = 30_000, 1.0  # frames that are looked at of a part of the data, seconds of one stretch of them
PARTS = {"training": "pose", "held_out": "pose_held"}  # how names of columns begin
COLUMNS = {  # how they end, by what `lmm.evaluation.decompressor.pose_errors` tells
    "cm": ("position_cm", "mean"),
    "p99_cm": ("position_cm", "p99"),
    "worst_cm": ("position_cm", "worst"),
    "deg": ("rotation_deg", "mean"),
    "cm_s": ("velocity_cm_s", "mean"),
}


@dataclass(eq=False)
class PoseErrors:
    """Measures decoders on the same frames, each once.

    held_out : names of clips that no model was trained on. The others are the part "training", which is all
    of the data where there are none. Of a part of more than 30,000 frames stretches of a second are looked
    at, evenly spread.
    """

    database: Database
    held_out: Iterable[str] = ()
    _known: dict[Decoder, dict[str, float]] = field(default_factory=dict)

    def of(self, decoder: Decoder | None) -> dict[str, float]:
        """pose_cm, pose_p99_cm, pose_worst_cm (the mean of the worst joint), pose_deg and pose_cm_s by
        REFERENCE 6, and pose_held_cm and so on, where clips are held out; nothing without a decoder."""
        if decoder is None:
            return {}
        if decoder not in self._known:
            self._known[decoder] = self._measured(decoder)
        return self._known[decoder]

    def _measured(self, decoder: Decoder) -> dict[str, float]:
        database = self.database
        out: dict[str, float] = {}
        held = np.isin(database.names, list(self.held_out))
        for part, ranges in (("training", ~held), ("held_out", held)):
            if not ranges.any():
                continue
            frames, starts = stretches(
                database.starts[ranges], database.stops[ranges], round(STRETCH * database.fps), MOST
            )
            truth, found = database.poses[frames], decoder(database, frames)
            errors = pose_errors(
                truth.positions,
                truth.rotations,
                found.positions,
                found.rotations,
                database.skeleton,
                fps=database.fps,
                starts=starts,
            )
            out |= {f"{PARTS[part]}_{end}": errors[what][which] for end, (what, which) in COLUMNS.items()}
        return out


def stretches(
    starts: NDArray[np.int32], stops: NDArray[np.int32], length: int, most: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Frames [N] of ranges [starts, stops), and which of the N begin a stretch.

    All of them if that is at most most; else evenly spread stretches of so many frames, or to a range's end.
    """
    total = int((stops - starts).sum())
    if total <= most:
        edges = list(zip(starts.tolist(), stops.tolist(), strict=True))
    else:
        begins = [np.arange(start, stop, length) for start, stop in zip(starts, stops, strict=True)]
        edges = [
            (int(at), min(int(at) + length, int(stop)))
            for at_once, stop in zip(begins, stops, strict=True)
            for at in at_once
        ]
        count = max(1, most // length)
        edges = [edges[i] for i in np.unique(np.linspace(0, len(edges) - 1, count).round().astype(int))]
    frames = np.concatenate([np.arange(start, stop, dtype=np.int32) for start, stop in edges])
    lengths = np.array([stop - start for start, stop in edges])
    return frames, np.cumsum(lengths) - lengths


def held_by_all(held: Iterable[Iterable[str]]) -> set[str]:
    """Names of the clips that all of some models were not trained on; none of no models."""
    sets = [set(names) for names in held]
    return set.intersection(*sets) if sets else set()
