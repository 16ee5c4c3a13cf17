"""Why a search ended as it did: what it chose from, what each candidate cost by feature, why it was left out.

What is explained is what was recorded: the query, around what frames were left out, which tags were asked
for, what playing on cost. All frames are costed again as the exact search costs them, and judged by the rules
that it has; so the winner is the engine's, where the engine is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from features import normalise
from lmm.mixtures import GuessedFrames
from lmm.stages import ProjectorProjection
from mm.database import Database
from mm.search.protocol import searchable
from mm.search.rows import costs_of
from mm.search.terms import of_schema
from mm.settings import Settings
from motion import config
from motion.errors import UserError

from .sources import Data
from .timeline import Timeline

if TYPE_CHECKING:
    import pandas as pd

NEEDED = ("query", "source", "required_tags", "forbidden_tags", "candidate", "cost_current", "transition")
COUNT = 12  # candidates that are shown
DISTINCT = 0.2  # seconds: frames of a clip that are nearer to each other show the same moment

CHOSEN, LEFT, PLAYING, NEAR, END, TAGS, DEARER, BIAS, BEATEN, MISSED, ANSWER = (
    "chosen",
    "just left",
    "playing",
    "too near",
    "clip's end",
    "tags",
    "dearer",
    "bias",
    "beaten",
    "missed",
    "answer",
)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A frame that a search might have chosen.

    Attributes
    ----------
    frame : of the database, -1 for what is no frame: a network's answer.
    clip, seconds, mirrored : the clip that it is of, and how far in that.
    cost : for the query; costs float32 [features], its parts.
    verdict : one word of those above; reason : for people.
    others : frames within 0.2 s of it that stand for the same moment.
    """

    frame: int
    clip: str
    seconds: float
    mirrored: bool
    cost: float
    costs: NDArray[np.float32]
    verdict: str
    reason: str
    others: int = 0


@dataclass(frozen=True, eq=False)
class Explanation:
    """A search.

    Attributes
    ----------
    features : names of the schema's features; query float32 [F], normalised.
    playing : the frame that played; None where what played is no frame.
    playing_cost : of playing on, infinite where the clip ended or what played was not what was asked for.
    bound : what a candidate had to beat: that, less the bias.
    candidates : the best ones, cheapest first, the chosen and the playing one among them.
    winner : the frame that the rules choose, -1 for none; winner_cost : its cost, or the bound.
    found, found_cost : the engine's own.
    answer : what the Projector made of the query, where there is one.
    """

    features: tuple[str, ...]
    query: NDArray[np.float32]
    playing: Candidate | None
    playing_cost: float
    bound: float
    candidates: tuple[Candidate, ...]
    winner: int
    winner_cost: float
    found: int
    found_cost: float
    answer: Candidate | None = None

    @property
    def chosen(self) -> Candidate | None:
        """Where the engine jumped to; None where it played on."""
        return next((each for each in self.candidates if each.verdict == CHOSEN), None)

    @property
    def agrees(self) -> bool:
        """Whether the engine found what the rules choose; of frames that cost the same, any.

        It does not where its index is approximate, or a network.
        """
        return self.found == self.winner or (self.found >= 0 and self.found_cost == self.winner_cost)

    def table(self) -> pd.DataFrame:
        """A row a candidate: where it is, its cost, that of each feature, the verdict and why."""
        import pandas as pd

        rows = [*self.candidates, *([self.answer] if self.answer else [])]
        table = pd.DataFrame(
            {
                "frame": [row.frame for row in rows],
                "clip": [row.clip for row in rows],
                "seconds": [row.seconds for row in rows],
                "mirrored": [row.mirrored for row in rows],
                "cost": [row.cost for row in rows],
                "verdict": [row.verdict for row in rows],
                "reason": [row.reason for row in rows],
                "others": [row.others for row in rows],
            }
        )
        parts = np.array([row.costs for row in rows], np.float32).reshape(len(rows), len(self.features))
        return table.join(pd.DataFrame(parts, columns=list(self.features)))


def step_of(timeline: Timeline, time: float) -> int | None:
    """The step that made the last search until a time; None without one."""
    if "searched" not in timeline.names:
        return None
    until = timeline.step_at(time) + 1 - timeline.first
    found = np.flatnonzero(timeline.stack("searched")[:until])
    return timeline.first + int(found[-1]) if len(found) else None


def projector_of(system: Any) -> ProjectorProjection | None:
    """The network that projects for a system, if one does."""
    projection = getattr(getattr(system, "stages", None), "projection", None)
    if isinstance(projection, GuessedFrames):
        return projection.projector
    return projection if isinstance(projection, ProjectorProjection) else None


def at(timeline: Timeline, time: float, data: Data | None, *, system: Any = None) -> Explanation | None:
    """The last search until a time; None without one, or without its database.

    data : the database of the system, or of the run that the timeline is of (`viewer.sources.Sources` finds
        it); it may differ in rounding, so that fingerprints are not compared again.
    system : what may have a network to ask.

    A run with other features, or of an earlier version that tells too little, is a UserError.
    """
    step = step_of(timeline, time)
    if step is None:
        return None
    settings, made_on = timeline.made_by(step)
    if settings is None:
        settings = config.from_dict(Settings, timeline.about.get("settings", {}))
    data = made_on or data
    if data is None:
        return None
    record = timeline.record(step)
    missing = [name for name in NEEDED if name not in record]
    if missing:
        raise UserError(f"the run does not tell {missing[0]} of its searches", remedy="record it again")
    if len(record["query"]) != data.schema.size:
        raise UserError("the run was not made from this database", remedy="give the one it was made from")
    return explain(data, record, settings, projector=projector_of(system))


def explain(
    data: Data,
    record: Mapping[str, NDArray],
    settings: Settings,
    *,
    count: int = COUNT,
    projector: ProjectorProjection | None = None,
) -> Explanation:
    """Explain a search by the record of the step that made it (`Timeline.record`).

    data : what was searched, or what the network that answered was trained from.
    settings : those of that step.
    count : candidates to show.
    """
    return _Search(data, record, settings).explain(count, projector)


class _Search:
    """All frames of a database, costed and judged."""

    def __init__(self, data: Data, record: Mapping[str, NDArray], settings: Settings) -> None:
        self.data, self.settings = data, settings
        self.tag_names = data.tag_names if isinstance(data, Database) else data.description.tag_names
        self.query = np.ascontiguousarray(record["query"], np.float32)
        self.source = int(record["source"])
        self.required, self.forbidden = (np.uint32(record[f"{n}_tags"]) for n in ("required", "forbidden"))
        self.found, self.found_cost = int(record["candidate"]), float(record["cost_candidate"])
        self.jumped = bool(record["transition"])
        current = np.float32(record["cost_current"])
        self.current, self.bound = float(current), float(current * np.float32(1 - settings.continuing_bias))

        frames = np.arange(len(data), dtype=np.int32)
        self.ranges = data.ranges()
        self.costs = costs_of(data.features, frames, self.query, of_schema(data.schema))
        self.radius = round(settings.ignore_radius * data.fps)
        self.near = (self.source >= 0) & (np.abs(frames - self.source) < self.radius)
        self.end = np.ones(len(data), bool)
        ignored = round(settings.ignore_end * data.fps)
        self.end[searchable(len(data), data.starts, data.stops, ignored)] = False
        self.lacking, self.bearing = self.required & ~data.tags, self.forbidden & data.tags
        self.barred = (self.lacking | self.bearing) != 0
        self.allowed = ~(self.near | self.end | self.barred)

    def explain(self, count: int, projector: ProjectorProjection | None) -> Explanation:
        winner, cost = self.winner()
        shown = sorted(self.candidates(count), key=lambda each: each.cost)
        return Explanation(
            features=tuple(feature.name for feature in self.data.schema.features),
            query=self.query,
            playing=self.candidate(self.source) if self.source >= 0 else None,
            playing_cost=self.current,
            bound=self.bound,
            candidates=tuple(shown),
            winner=winner,
            winner_cost=cost,
            found=self.found,
            found_cost=self.found_cost,
            answer=None if projector is None else self.answer(projector),
        )

    def winner(self) -> tuple[int, float]:
        """The cheapest frame that is allowed and beats the bound, -1 for none, and its cost."""
        costs = np.where(self.allowed, self.costs, np.inf)
        best = int(np.argmin(costs))
        return (best, float(costs[best])) if costs[best] < self.bound else (-1, self.bound)

    def candidates(self, count: int) -> Iterator[Candidate]:
        """The frame found, the frame that plays, and the cheapest others, each for the frames around it."""
        left = self.costs.astype(np.float64)
        group = self.near + 2 * self.end + 4 * self.barred  # frames that are left out alike
        reach = max(1, round(DISTINCT * self.data.fps))
        first = [frame for frame in dict.fromkeys((self.found, self.source)) if frame >= 0]
        for k in range(count):
            frame = first[k] if k < len(first) else int(np.argmin(left))
            if not np.isfinite(left[frame]) and k >= len(first):
                return
            r = self.ranges[frame]
            around = slice(
                max(frame - reach, int(self.data.starts[r])), min(frame + reach + 1, int(self.data.stops[r]))
            )
            same = (group[around] == group[frame]) & np.isfinite(left[around])
            left[around][same] = np.inf
            yield self.candidate(frame, int(same.sum()) - 1)

    def candidate(self, frame: int, others: int = 0) -> Candidate:
        r = int(self.ranges[frame])
        return Candidate(
            frame,
            self.data.names[r],
            (frame - int(self.data.starts[r])) / self.data.fps,
            bool(self.data.mirrored[r]),
            float(self.costs[frame]),
            normalise.costs(self.data.schema, self.query, self.data.features[frame]),
            *self.verdict(frame),
            max(0, others),
        )

    def verdict(self, frame: int) -> tuple[str, str]:
        """In the order in which the engine asks: may the frame be had at all, does it beat what is known."""
        settings, cost = self.settings, self.costs[frame]
        if frame == self.found and self.jumped:
            return CHOSEN, f"the character jumped here: {self._why()}"
        if frame == self.found and self.found_cost < self.bound:
            return LEFT, f"the character left it less than {settings.reselect_time:.2g} s ago"
        if frame == self.source:
            if np.isfinite(self.current):
                return PLAYING, f"it plays: to play on costs {self.current:.3g}"
            if self.barred[frame]:
                return PLAYING, f"it plays, and is not what was asked for: {self._tags(frame)}"
            return PLAYING, "it plays, and is the last of its clip"
        if self.near[frame]:
            return NEAR, f"within {settings.ignore_radius:.2g} s of the frame that plays"
        if self.end[frame]:
            return END, f"in the last {settings.ignore_end:.2g} s of its clip"
        if self.barred[frame]:
            return TAGS, self._tags(frame)
        if cost >= self.current:
            return DEARER, f"to play on costs {self.current:.3g}"
        if cost >= self.bound:
            share = f"{settings.continuing_bias:.0%}"
            return BIAS, f"not cheaper by {share} than to play on, which takes {self.bound:.3g}"
        if cost < self.found_cost:
            return MISSED, f"it beats {self.found_cost:.3g}, but was not found: the search is not exact"
        return BEATEN, f"what was found costs {self.found_cost:.3g}"

    def answer(self, projector: ProjectorProjection) -> Candidate:
        """What a network answers, judged as it was when it answered."""
        values = projector.guess(self.query[None], np.array([self.required], np.uint32))
        row = values[0, : projector.width]
        cost = float(normalise.total_costs(projector.schema, self.query, row))
        best = float(np.where(self.allowed, self.costs, np.inf).min())
        costs = normalise.costs(projector.schema, self.query, row)
        reason = f"{self._taken()}; the nearest frame that may be had costs {best:.3g}"
        return Candidate(-1, "", float("nan"), False, cost, costs, ANSWER, reason)

    def _taken(self) -> str:
        """What became of a network's answer, or of the frame that it led to."""
        if self.jumped:
            return f"taken: {self._why()}"
        if self.found_cost >= self.current:
            return f"not taken: to play on costs {self.current:.3g}, this {self.found_cost:.3g}"
        if self.found_cost >= self.bound:
            return f"not taken: to be cheaper enough takes {self.bound:.3g}, it costs {self.found_cost:.3g}"
        return "not taken: it is what was answered last, or what was left just now"

    def _why(self) -> str:
        """Why there was a jump."""
        if np.isfinite(self.current):
            return f"{self.found_cost:.3g} beats {self.bound:.3g}"
        asked = self.source < 0 or bool(self.barred[self.source])
        return "what played was not what was asked for" if asked else "the clip ended"

    def _tags(self, frame: int) -> str:
        for bits, how in ((self.lacking[frame], "lacks the tag"), (self.bearing[frame], "bears the tag")):
            names = [name for bit, name in enumerate(self.tag_names) if int(bits) >> bit & 1]
            if names:
                return f"{how} {', '.join(names)}"
        return "bears tags without a name"
