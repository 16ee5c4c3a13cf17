"""The searches that a controller really makes while users drive it: what learned projections must answer.

`record` has a crowd of characters driven by a random user and writes down what is searched for; `neighbours`
answers such queries exactly, with the exclusions of a controller; `residuals` and `noise` say how far they
lie from the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import search, stages
from .controller import Controller
from .course import Course, RandomUser
from .database import Database
from .driving import Clock, at_data_speeds, drive
from .settings import Settings

SETTINGS = Settings(foot_lock=False)  # locking changes no query, and needs whole legs
EACH = 100  # queries of a character when their number is left open: about ten seconds
MOST_CHARACTERS = 1024
CROUCH = 0.15  # share of a random user's changes that crouch, where the data can
LONGEST = 86_400.0  # seconds of a course
# Added to seeds, which those of courses are below: who trains and judges learned stages is no user of theirs.
USERS = 2**32


@dataclass(eq=False)
class Queries:
    """M searches as a controller made them.

    features [M, F] normalised; current int32 [M], the frames that played (-1: no frame of the database);
    bound [M], what playing on costs less the bias (infinite where a clip ended, or what plays is not what
    was asked for); required, forbidden uint32 [M], the tags asked for; radius of frames around the current
    one, and number of frames at the end of each range, that are left out.
    """

    features: NDArray[np.float32]
    current: NDArray[np.int32]
    bound: NDArray[np.float32]
    required: NDArray[np.uint32]
    forbidden: NDArray[np.uint32]
    radius: int
    ignore_end: int

    def __len__(self) -> int:
        return len(self.features)

    def take(self, which: Any) -> Queries:
        """Some of them: a slice, a mask or indices."""
        parts = self.features, self.current, self.bound, self.required, self.forbidden
        features, current, bound, required, forbidden = (part[which] for part in parts)
        return Queries(features, current, bound, required, forbidden, self.radius, self.ignore_end)

    def exclusions(self) -> search.Exclusions:
        """What an index must leave out, ends of ranges aside."""
        tagged = self.required.any() or self.forbidden.any()
        tags = (self.required, self.forbidden) if tagged else (None, None)
        return search.Exclusions(self.current, self.radius, *tags)


class _Listener:
    """A projection that writes down what it is asked."""

    def __init__(self, projection: stages.Projection) -> None:
        self._projection = projection
        self.asked: list[tuple[NDArray, ...]] = []
        self.count = 0

    def project(
        self, queries: NDArray, state: Any, bound: NDArray, required_tags: NDArray, forbidden_tags: NDArray
    ) -> Any:
        self.count += len(queries)
        asked = queries, state.frames(), np.asarray(bound, np.float32), required_tags, forbidden_tags
        self.asked.append(tuple(part.copy() for part in asked))
        return self._projection.project(queries, state, bound, required_tags, forbidden_tags)

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return self._projection.possible(required_tags, forbidden_tags)

    def memory(self) -> dict[str, int]:
        return self._projection.memory()


def listen(controller: Controller, course: Course, count: int) -> Queries:
    """The first count searches of a controller whose characters are spread over a course.

    In the order of frames, and in each frame of characters. The first frame's are left out, where all stand
    alike. The controller is left where it then is.
    """
    steps = drive(controller, Clock(course, controller.count, controller.fps, spread=True))
    next(steps)
    projection = controller.stages.projection
    controller.stages.projection = listener = _Listener(projection)
    try:
        while listener.count < count:
            next(steps)
    finally:
        controller.stages.projection = projection
    asked = (np.concatenate(part)[:count] for part in zip(*listener.asked, strict=True))
    features, current, bound, required, forbidden = asked
    radius, ignore_end = (
        round(seconds * controller.fps)
        for seconds in (controller.settings.ignore_radius, controller.settings.ignore_end)
    )
    return Queries(features, current, bound, required, forbidden, radius, ignore_end)


def record(
    database: Database,
    count: int = 1000,
    *,
    seed: int = 0,
    characters: int | None = None,
    index: str | search.Index = "exact",
    course: Course | None = None,
    settings: Settings = SETTINGS,
) -> Queries:
    """The first count searches of a crowd that motion matching drives over a course.

    By default the course is a random user's of that seed at the speeds of the data, long enough that no two
    characters do the same: walks, runs, strafes, sharp turns, stops, and crouches where some frames bear the
    tag "crouch". As many characters as make about 100 searches each, at most 1,024, unless given. With an
    index over some ranges (`index_of`) nothing else is played.
    """
    if characters is None:
        characters = min(MOST_CHARACTERS, -(-count // EACH))
    if course is None:
        course = random_user(database, count * settings.search_interval, seed=seed)
    controller = Controller(database, count=characters, settings=settings, index=index)
    return listen(controller, course, count)


def random_user(database: Database, seconds: float, *, seed: int = 0) -> Course:
    """A random user's course at the speeds of a database, who crouches where the database has the tag.

    No other course has this user, whatever its seed (below 2^32).
    """
    crouch = CROUCH if "crouch" in database.tag_names else 0.0
    user = RandomUser(seed=USERS + seed, crouch=crouch)
    seconds = min(max(seconds, 60.0), LONGEST)
    return at_data_speeds(Course(name=f"random {seed}", random=user, seconds=seconds), database)


def index_of(
    database: Database,
    *,
    ignore_end: int | None = None,
    ranges: ArrayLike | None = None,
    name: str = "exact",
    threads: int = 1,
) -> search.Index:
    """A search index over some ranges of a database: a mask or indices into its R ranges; all by default.

    ignore_end: frames at the end of each range that are no answers, a controller's by default.
    """
    which: slice | NDArray = slice(None)
    if ranges is not None:
        which = np.asarray(ranges)
        which = np.flatnonzero(which) if which.dtype == bool else which.astype(np.int64)
    if ignore_end is None:
        ignore_end = round(SETTINGS.ignore_end * database.fps)
    options = {"threads": threads} if threads > 1 else {}
    return search.build(
        name,
        stages.plain(database.features),
        database.starts[which],
        database.stops[which],
        ignore_end=ignore_end,
        tags=database.tags,
        schema=database.schema,
        **options,
    )


def neighbours(
    index: search.Index | Database, queries: Queries, *, bounded: bool = False, **options: Any
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The best frame of each query and its cost, [M] each, as a controller would find it.

    index: one made by `index_of` (for many batches), or a database, of which one is made with the options.
    Left out are the ends of ranges, frames near the current one, and those without the tags asked for.
    bounded: only what beats playing on; elsewhere the frame is -1 and the cost the bound. Unbounded, it is
    the nearest frame however far, -1 and infinity only where none is allowed.
    """
    if isinstance(index, Database):
        index = index_of(index, **({"ignore_end": queries.ignore_end} | options))
    bound = queries.bound if bounded else None
    frames, costs = index.search(queries.features, bound=bound, exclude=queries.exclusions())
    return frames[:, 0], costs[:, 0]


def residuals(
    database: Database, queries: Queries, *, ranges: ArrayLike | None = None, threads: int = 1
) -> NDArray[np.float32]:
    """What a controller asked less the nearest row that it may have, [M, F] normalised.

    Queries without any row that may be had are left out. A row plus the residual of another query is noise
    as real queries have it: of their sizes, and with columns that go together.
    """
    frames, _ = neighbours(database, queries, ranges=ranges, threads=threads)
    found = frames >= 0
    return queries.features[found] - database.features[frames[found]]


def noise(database: Database, queries: Queries, *, ranges: ArrayLike | None = None) -> NDArray[np.float32]:
    """How far real queries lie from the data by column, float32 [F]: the root mean square of `residuals`.

    The published noise, N(0, 1) x U(0, 1) x (column's standard deviation + 1) (REFERENCE 3.2), is far larger.
    Distances to the nearest row, of 100,000 real queries and of rows with the published noise (27 columns at
    60 frames a second; generated clips with crouching, and short ones of CMU):

                             real: median, 95 %, 99 %    published: median, 95 %, 99 %
        72,000 frames        1.57  3.74   6.01           4.75   9.72  11.42
        21,000, short clips  1.96  6.23  10.60           4.81   9.81  11.60

    Half of the published samples thus lie beyond 91 to 98 % of what is really asked. Normal noise of this
    scale has no far tail: for the first row the median is 1.9 and 99 % is 2.7; with other queries' residuals
    as noise they are 1.3 and 4.9. The pose's columns of a query are the playing frame's own and lie 0.1 to
    0.6 from the nearest row's; the trajectory's lie 0.2 to 1.8 from the playing frame's and 0.2 to 1.3 from
    the nearest row's.
    """
    difference = residuals(database, queries, ranges=ranges).astype(np.float64)
    return np.sqrt((difference**2).mean(axis=0)).astype(np.float32)
