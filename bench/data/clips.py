"""Frames of a database as captures: mirrored copies left out, each frame with its clip's name and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm.database import Database

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Clips:
    """T frames in R clips.

    frames [T] of the database, one clip after another; starts, stops [R] say where each begins and ends among
    them; names R.
    """

    frames: Ints
    starts: Ints
    stops: Ints
    names: tuple[str, ...]
    fps: float

    @staticmethod
    def of(database: Database) -> Clips:
        """Without mirrored copies, where there is anything else."""
        own = np.flatnonzero(~database.mirrored)
        own = own if len(own) else np.arange(len(database.starts))
        frames = [np.arange(database.starts[r], database.stops[r], dtype=np.int64) for r in own]
        stops = np.cumsum([len(part) for part in frames])
        starts = stops - [len(part) for part in frames]
        names = tuple(database.names[r] for r in own)
        return Clips(np.concatenate(frames), starts, stops, names, database.fps)

    @staticmethod
    def one(frames: int, fps: float) -> Clips:
        """A single clip of so many frames, such as a run."""
        return Clips(np.arange(frames), np.zeros(1, np.int64), np.array([frames]), ("",), fps)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def seconds(self) -> float:
        return len(self) / self.fps

    def at(self, places: ArrayLike) -> Ints:
        """Which clip each place among the T frames lies in."""
        return np.searchsorted(self.stops, np.asarray(places), side="right")

    def passages(self, mask: NDArray[np.bool_], *, join: float = 0.0, least: float = 0.0) -> Ints:
        """Where mask [T] holds: places [K, 2], the first and one past the last; none goes across clips.

        Those with at most join seconds between them are one; those shorter than least seconds are left out.
        """
        found = []
        for start, stop in zip(self.starts, self.stops, strict=True):
            edges = np.flatnonzero(np.diff(mask[start:stop].astype(np.int8), prepend=0, append=0)) + start
            begins, ends = edges[::2], edges[1::2]
            apart = begins[1:] - ends[:-1] > round(join * self.fps)
            own = np.ones(min(len(begins), 1), bool)
            begins, ends = begins[np.append(own, apart)], ends[np.append(apart, own)]
            long = ends - begins >= least * self.fps
            found.append(np.stack([begins[long], ends[long]], axis=-1))
        return np.concatenate(found)

    def where(self, start: int, stop: int) -> dict[str, Any]:
        """Cells of a table that tell where a passage is: the clip, its seconds there, its first frame."""
        clip = int(self.at(start))
        first = self.starts[clip]
        return {
            "clip": self.names[clip],
            "from_s": float((start - first) / self.fps),
            "to_s": float((stop - first) / self.fps),
            "frame": int(self.frames[start]),
        }
