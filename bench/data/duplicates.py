"""What a database has twice, and what it has but once: how near each frame's nearest frame elsewhere is.

Near is what the search takes for near: the cost that it compares frames by. Two frames are the same to it
when they cost no more than a moment of ordinary motion does, `NEAR` seconds. Elsewhere is in another clip, or
more than `AWAY` seconds away in the same one, which sees the many alike steps of a long walk.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from features import normalise
from features.schema import Schema
from mm import queries, search
from mm.database import Database

from .clips import Clips, Ints

Array = NDArray[np.floating]

NEAR = 1 / 30  # seconds of ordinary motion
AWAY = 1.0  # seconds
ALIKE_CM = 5.0  # mean over joints: arms that do something else are no duplicate, whatever the feet do
SHORTEST = 0.2  # seconds of a stretch that is worth a line
ALONE = 99.0  # percentile of that cost from which a frame is told to be alone
SEARCHES = 1000  # of a random user, to try what it costs to leave spare frames out
TAGS = 32  # that a database can have


@dataclass(frozen=True, eq=False)
class Twice:
    """Of T frames of clips.

    Attributes
    ----------
    nearest : int64 [T], the nearest frame elsewhere (a place among the T), -1: there is none.
    cost : float64 [T] of it, infinite where there is none.
    apart_cm : float64 [T], mean distance of the two poses' joints in the root's space.
    bound : the cost from which two frames are different: the median cost of two frames `NEAR` seconds apart.
    near : bool [T], whether the nearest is the same: in features, pose and tags.
    spare : bool [T], frames that can be left out together: what each is the same as stays.
    """

    nearest: Ints
    cost: Array
    apart_cm: Array
    bound: float
    near: NDArray[np.bool_]
    spare: NDArray[np.bool_]

    @property
    def times(self) -> Array:
        """Costs [T] over the bound; infinite where nothing is the same."""
        return self.cost / self.bound if self.bound > 0 else np.full(len(self.cost), np.inf)


def find(database: Database, clips: Clips, local: Array, *, near: float = NEAR) -> Twice:
    """What a database has twice; local [T, J, 3] the joints of its clips' frames in the root's space."""
    features = np.ascontiguousarray(np.asarray(database.features)[clips.frames])
    nearest, cost = elsewhere(database.schema, features, clips, away=AWAY)
    bound = typical_cost(database.schema, features, clips, frames=max(1, round(near * clips.fps)))
    apart = 100 * np.linalg.norm(local - local[np.maximum(nearest, 0)], axis=-1).mean(axis=-1)
    same = (nearest >= 0) & (cost <= bound) & (apart <= ALIKE_CM)
    same &= database.tags[clips.frames] == database.tags[clips.frames[np.maximum(nearest, 0)]]
    return Twice(nearest, cost, apart, bound, same, spare(same, nearest, clips))


def elsewhere(schema: Schema, features: Array, clips: Clips, *, away: float) -> tuple[Ints, Array]:
    """The nearest frame elsewhere to each of features [T, F], normalised, and its cost; -1 and infinite
    where there is none. Exact, for any schema's cost."""
    radius = max(1, round(away * clips.fps))
    # Clips are set apart by frames that are never answers, so that a radius ends with its clip.
    rows, places = [], []
    for i, (start, stop) in enumerate(zip(clips.starts, clips.stops, strict=True)):
        rows += [features[start:stop], np.repeat(features[stop - 1 : stop], radius, axis=0)]
        places.append(np.arange(start, stop) + i * radius)
    place = np.concatenate(places)
    shift = radius * np.arange(len(clips.starts))
    starts, stops = clips.starts + shift, clips.stops + shift + radius
    index = search.build("exact", np.concatenate(rows), starts, stops, ignore_end=radius, schema=schema)
    exclude = search.Exclusions(current=place.astype(np.int32), radius=radius)
    frames, costs = index.search(features, exclude=exclude)
    found = frames[:, 0] >= 0
    nearest = np.where(found, np.searchsorted(place, frames[:, 0]), -1)
    return nearest, np.where(found, costs[:, 0], np.inf).astype(np.float64)


def typical_cost(schema: Schema, features: Array, clips: Clips, *, frames: int) -> float:
    """The median cost of two frames of one clip that are so many frames apart; 0 where none is as long."""
    before = np.concatenate(
        [np.arange(a, max(a, b - frames)) for a, b in zip(clips.starts, clips.stops, strict=True)]
    )
    if len(before) == 0:
        return 0.0
    return float(np.median(normalise.total_costs(schema, features[before], features[before + frames])))


def spare(same: NDArray[np.bool_], nearest: Ints, clips: Clips) -> NDArray[np.bool_]:
    """Frames that can be left out together, bool [T]: what each of them is the same as is not left out.

    Longest stretches first, each frame unless another one stands on it; stretches of less than `SHORTEST`
    stay. Not the most that could be left out, but all of it can.
    """
    out, needed = np.zeros(len(same), bool), np.zeros(len(same), bool)
    stretches = clips.passages(same, least=SHORTEST)
    for start, stop in stretches[np.argsort(stretches[:, 0] - stretches[:, 1], kind="stable")]:
        for frame in range(start, stop):
            if not needed[frame] and not out[nearest[frame]]:
                out[frame] = needed[nearest[frame]] = True
    kept = np.zeros(len(same), bool)
    for start, stop in clips.passages(out, least=SHORTEST):
        kept[start:stop] = True
    return kept


def stretches(twice: Twice, clips: Clips) -> pd.DataFrame:
    """A row a stretch that is there twice, the longest first: where, how much of it is spare, and what it is
    like: the clip that most of its nearest frames lie in, where they lie, and how many of them do.

    times : the median cost over the bound; apart_cm : the median of the poses' distance.
    """
    rows = []
    for start, stop in clips.passages(twice.near, least=SHORTEST):
        there = twice.nearest[start:stop]
        those = clips.at(there)
        most = np.bincount(those).argmax()
        like = there[those == most] - clips.starts[most]
        rows.append(
            clips.where(start, stop)
            | {
                "seconds": float((stop - start) / clips.fps),
                "spare_s": float(twice.spare[start:stop].sum() / clips.fps),
                "like": clips.names[most],
                "like_from_s": float(like.min() / clips.fps),
                "like_to_s": float((like.max() + 1) / clips.fps),
                "like_share": float((those == most).mean()),
                "times": float(np.median(twice.times[start:stop])),
                "apart_cm": float(np.median(twice.apart_cm[start:stop])),
            }
        )
    names = ("seconds", "spare_s", "like", "like_from_s", "like_to_s", "like_share", "times", "apart_cm")
    return _sorted(rows, (*clips.where(0, 1), *names), "seconds")


def spares(twice: Twice, clips: Clips) -> pd.DataFrame:
    """A row a range that can be left out, all of them together, the longest first: frames of the database,
    from first to before last."""
    rows = []
    for start, stop in clips.passages(twice.spare):
        place = clips.where(start, stop)
        rows.append(
            place | {"to_frame": place["frame"] + int(stop - start), "seconds": (stop - start) / clips.fps}
        )
    return _sorted(rows, (*clips.where(0, 1), "to_frame", "seconds"), "seconds")


def alone(twice: Twice, clips: Clips) -> pd.DataFrame:
    """A row a passage that nothing else is like, the farthest first: beyond the percentile `ALONE` of the
    cost of the nearest frame elsewhere. times : of the bound of what is the same."""
    known = twice.cost[np.isfinite(twice.cost)]
    far = twice.cost > (np.percentile(known, ALONE) if len(known) else np.inf)
    rows = []
    for start, stop in clips.passages(far, join=SHORTEST):
        times = float(twice.times[start:stop].max())
        rows.append(clips.where(start, stop) | {"seconds": (stop - start) / clips.fps, "times": times})
    return _sorted(rows, (*clips.where(0, 1), "seconds", "times"), "times")


def by_clip(twice: Twice, clips: Clips) -> pd.DataFrame:
    """A row a clip, the most repeated first: its seconds, what share of it is there twice, in other clips,
    and is spare; the clip that it is most like; the median cost of its frames' nearest over the bound."""
    rows: list[dict[str, Any]] = []
    for name, start, stop in zip(clips.names, clips.starts, clips.stops, strict=True):
        there = twice.nearest[start:stop][twice.near[start:stop]]
        others = clips.at(there)
        own = len(rows)
        rows.append(
            {
                "clip": name,
                "seconds": (stop - start) / clips.fps,
                "twice": float(twice.near[start:stop].mean()),
                "in_others": float((others != own).sum() / (stop - start)),
                "spare": float(twice.spare[start:stop].mean()),
                "most_like": clips.names[np.bincount(others[others != own]).argmax()]
                if (others != own).any()
                else "",
                "times": float(np.median(twice.times[start:stop])),
            }
        )
    return _sorted(rows, tuple(rows[0]), "twice")


def _sorted(rows: list[dict[str, Any]], names: tuple[str, ...], by: str) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=list(names))
    return table.sort_values(by, ascending=False, kind="stable", ignore_index=True)


def price(database: Database, clips: Clips, twice: Twice, *, count: int = SEARCHES) -> float | None:
    """By what share the frames that searches find cost more without those that are spare.

    The searches are the first ones of characters that a random user drives (`mm.queries.record`); mirrored
    copies of what is spare are left out, too. Infinite where a search finds nothing any more, None where 32
    tags leave none to mark it by.
    """
    if len(database.tag_names) >= TAGS:
        return None
    asked = queries.record(database, count)
    _, before = queries.neighbours(database, asked)
    mark = np.uint32(1 << TAGS - 1)
    tags = np.where(with_copies(database, clips.frames[twice.spare]), mark, np.uint32(0)) | database.tags
    marked = replace(database, tags=tags)
    _, after = queries.neighbours(marked, replace(asked, forbidden=asked.forbidden | mark))
    known = np.isfinite(before)
    whole = float(before[known].sum(dtype=np.float64))
    return float(after[known].sum(dtype=np.float64)) / whole - 1 if whole > 0 else 0.0


def with_copies(database: Database, frames: Ints) -> NDArray[np.bool_]:
    """Frames of a database and their mirrored copies, bool [T]. A copy follows its original, by its name."""
    out = np.zeros(len(database), bool)
    out[frames] = True
    for r in np.flatnonzero(database.mirrored[1:] & ~database.mirrored[:-1]):
        here, copy = (slice(database.starts[i], database.stops[i]) for i in (r, r + 1))
        if database.names[r] == database.names[r + 1] and out[here].shape == out[copy].shape:
            out[copy] |= out[here]
    return out
