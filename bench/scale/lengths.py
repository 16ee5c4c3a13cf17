"""Data of any length: the built-in generator's, or growing random parts of a database; and what is unseen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from features import presets
from mm import build, parts, quality, speeds
from mm.database import Database
from motion import console, dancecard, files
from motion.clip import Clip
from motion.errors import UserError

UNSEEN_SECONDS, UNSEEN_SEED = 300.0, 2**32  # of another dancer, whom no seed of a user's gives
UNSEEN_SHARE, UNSEEN_FRAMES = 0.1, 300  # of given data that no length has; frames that are tried
LEAST_SECONDS = 1.0  # of a clip's piece that fills a length up

Array = NDArray[np.floating]
Progress = Callable[..., Iterator[Any]]


class Lengths(Protocol):
    """Data of any length up to the longest, in minutes of capture: mirrored copies do not count.

    name says what it is; joints, features, copies (2 with mirrored ones) and fps what a frame of it takes.
    """

    @property
    def name(self) -> str: ...
    @property
    def longest(self) -> float: ...
    @property
    def joints(self) -> int: ...
    @property
    def features(self) -> int: ...
    @property
    def copies(self) -> int: ...
    @property
    def fps(self) -> float: ...

    def facts(self) -> dict[str, Any]:
        """All that the data of a length follows from besides the length, as plain data."""
        ...

    def of(self, minutes: float, progress: Progress = console.silent) -> Database:
        """The data of a length; a longer one has all of a shorter one."""
        ...

    def unseen(self) -> Array | None:
        """Joints [S, J-1, 3] in the ground root's space, of poses that no length has; None without any."""
        ...

    def speeds(self) -> tuple[float, float]:
        """Walking and running speed, m/s, that all lengths are asked for."""
        ...


@dataclass(frozen=True)
class Danced:
    """Motion of the built-in generator, without tags; what is not seen is another dancer's."""

    seed: int = 0
    schema: str = "mm27"
    mirror: bool = True

    name = "built-in data"
    longest = float("inf")
    joints = len(dancecard.FIGURE.names) + 1
    fps = dancecard.FPS

    @property
    def features(self) -> int:
        return presets.load(self.schema).size

    @property
    def copies(self) -> int:
        return 1 + self.mirror

    def facts(self) -> dict[str, Any]:
        """With a hash of how a dance begins, which another generator would dance otherwise."""
        clip = next(dancecard.dances(10.0, seed=self.seed)).clip
        begins = files.fingerprint({"positions": clip.positions, "rotations": clip.rotations}, {})
        return {"dance": begins, "seed": self.seed, "schema": self.schema, "mirror": self.mirror}

    def of(self, minutes: float, progress: Progress = console.silent) -> Database:
        return self._build(minutes * 60, self.seed, self.mirror, progress)

    def _build(self, seconds: float, seed: int, mirror: bool, progress: Progress) -> Database:
        count = len(dancecard.names(seconds, seed=seed))
        passages = progress(dancecard.dances(seconds, seed=seed), label="dance", total=count, unit="clips")
        clips: Iterator[Clip] = (passage.clip for passage in passages)
        return build.of_clips(clips, schema=self.schema, mirror=mirror)

    @cached_property
    def _unseen(self) -> Database:
        return self._build(UNSEEN_SECONDS, UNSEEN_SEED + self.seed, False, console.silent)

    def unseen(self) -> Array | None:
        return _some_poses(self._unseen, np.arange(len(self._unseen)))

    def speeds(self) -> tuple[float, float]:
        return speeds.of_database(self._unseen)


class Taken:
    """Growing random parts of a database: clips in a random order, the last one of a length cut to fit.

    A tenth of the data, whole clips, is in none of them, and tells how they do with what they have not seen;
    it is held_out where that is given (names of clips).
    """

    def __init__(
        self, database: Database, *, seed: int = 0, held_out: set[str] | None = None, name: str = ""
    ) -> None:
        self.database, self.seed, self.name = database, seed, name or "the database"
        self.joints, self.features, self.fps = len(database.skeleton), database.schema.size, database.fps
        self.copies = 1 + bool(database.mirrored.any())
        names = np.array(database.names)
        known = list(dict.fromkeys(names[~database.mirrored].tolist())) or list(dict.fromkeys(names.tolist()))
        order = [known[i] for i in np.random.default_rng([seed, 2]).permutation(len(known))]
        self._ranges = {clip: np.flatnonzero(names == clip) for clip in order}
        lengths = {clip: self._frames(clip) for clip in order}
        if held_out is None:
            from_end = np.cumsum([lengths[clip] for clip in reversed(order)])
            count = int(np.searchsorted(from_end, UNSEEN_SHARE * from_end[-1])) + 1
            held_out = set(order[-count:]) if count < len(order) else set()
        self.held_out = held_out
        self._order = [clip for clip in order if clip not in held_out]
        if not self._order:
            raise UserError("no clips remain beside those held out", remedy="give more clips")
        self.longest = sum(lengths[clip] for clip in self._order) / self.fps / 60

    def _frames(self, clip: str) -> int:
        """Frames of a clip without its mirrored copy."""
        database, ranges = self.database, self._ranges[clip]
        own = ranges[~database.mirrored[ranges]] if not database.mirrored[ranges].all() else ranges
        return int((database.stops[own] - database.starts[own]).sum())

    def facts(self) -> dict[str, Any]:
        return {
            "database": self.database.fingerprint or _content(self.database),
            "seed": self.seed,
            "held_out": sorted(self.held_out),
        }

    def of(self, minutes: float, progress: Progress = console.silent) -> Database:
        database, left = self.database, round(minutes * 60 * self.fps)
        least = round(LEAST_SECONDS * self.fps)
        chosen: list[tuple[int, int, int]] = []
        for clip in self._order:
            taken = 0
            for i in self._ranges[clip]:
                start, stop = int(database.starts[i]), int(database.stops[i])
                stop = min(stop, start + left)
                if stop - start >= min(least, int(database.stops[i]) - start):
                    chosen.append((int(i), start, stop))
                    taken = max(taken, stop - start)
            left -= taken
            if left < least:
                break
        return _part(database, chosen)

    def unseen(self) -> Array | None:
        ranges = [i for clip in self._ranges if clip in self.held_out for i in self._ranges[clip]]
        ranges = [i for i in ranges if not self.database.mirrored[i]] or ranges
        if not ranges:
            return None
        spans = [np.arange(self.database.starts[i], self.database.stops[i]) for i in ranges]
        return _some_poses(self.database, np.concatenate(spans))

    def speeds(self) -> tuple[float, float]:
        return speeds.of_database(self.database)


def _content(database: Database) -> str:
    """The fingerprint of a database that no file holds."""
    arrays = {name: getattr(database, name) for name in ("features", "contacts", "starts", "stops", "tags")}
    return files.fingerprint(database.poses.arrays() | arrays, {"names": database.names, "fps": database.fps})


def _part(database: Database, pieces: list[tuple[int, int, int]]) -> Database:
    """Pieces (range, first frame, one past its last) of a database as a database of their own."""
    if not pieces:
        raise UserError("no clip is as short", remedy="ask for more minutes")
    frames = np.concatenate([np.arange(start, stop) for _, start, stop in pieces])
    lengths = np.array([stop - start for _, start, stop in pieces])
    stops = np.cumsum(lengths).astype(np.int32)
    starts = (stops - lengths).astype(np.int32)
    poses = database.poses[frames]
    features, offset, scale = parts.compute_features(
        database.schema, database.skeleton, database.fps, poses, starts, stops
    )
    which = [i for i, _, _ in pieces]
    return replace(
        database,
        poses=poses,
        contacts=database.contacts[frames],
        features=features,
        offset=offset,
        scale=scale,
        starts=starts,
        stops=stops,
        names=tuple(database.names[i] for i in which),
        mirrored=database.mirrored[which],
        tags=database.tags[frames],
        fingerprint="",
    )


def _some_poses(database: Database, frames: NDArray[np.integer]) -> Array:
    """Poses of evenly spread frames of some."""
    some = frames[np.linspace(0, len(frames) - 1, min(UNSEEN_FRAMES, len(frames))).astype(np.int64)]
    poses = database.poses[some]
    return quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
