"""Who is shown, and what is known of what they do: clips, recorded runs, and systems driven over a course."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema
from features.terrain import Ground, flat
from mm import recording
from mm.course import Course
from mm.driver import Driver
from mm.recording import Recording
from mm.runs import fitted
from motion import config, console, contacts
from motion.errors import UserError

from . import explain, played, shows
from .explain import Explanation
from .shows import Recorded, Show
from .sources import Data, Part, Sources
from .timeline import Timeline


class Member:
    """One who is shown.

    Attributes
    ----------
    show : its poses.
    timeline : what its first character did, and why; of a clip only poses and contacts.
    run : the run that this is, as it is written to a file; None for clips.
    data : the database that its searches are explained by, or None.
    contact_roles : what its contacts are of; None for those that are told by default.
    ground : what it walks on.
    aside : a thread that explains searches, so that nobody waits; None: who asks does.
    """

    def __init__(
        self,
        show: Show,
        timeline: Timeline,
        *,
        run: Recording | None = None,
        data: Data | None = None,
        system: Any = None,
        contact_roles: tuple[str, ...] | None = None,
        ground: Ground = flat,
    ) -> None:
        self.show, self.timeline, self.run, self.data = show, timeline, run, data
        self.contact_roles, self.ground = contact_roles, ground
        self._system = system
        self.aside: Executor | None = None
        self._explained: tuple[int, Explanation | None] = (-1, None)
        self._asked: tuple[int, Future[Explanation | None]] | None = None
        self._schema: tuple[Any, Schema | None] = (None, None)

    def __repr__(self) -> str:
        return f"Member({self.show.name!r}, {len(self.timeline)} steps)"

    @property
    def name(self) -> str:
        return self.show.name

    @property
    def schema(self) -> Schema | None:
        """Of the features that are searched for; None where it is not known."""
        if self.data is not None:
            return self.data.schema
        told = self.timeline.about.get("schema")
        if told is not self._schema[0]:
            self._schema = told, None if told is None else Schema.from_dict(told)
        return self._schema[1]

    def explanation(self, time: float) -> Explanation | None:
        """The last search until a time; None without one, or without its database (see `viewer.explain`).

        Where there is a thread `aside`, the one that was found last, until this one is found.
        """
        step = explain.step_of(self.timeline, time)
        if step is None or self.data is None:
            return None
        if self.aside is None:
            if self._explained[0] != step:
                self._explained = step, self._explain(time)
        elif self._asked is None:
            if self._explained[0] != step:
                self._asked = step, self.aside.submit(self._explain, time)
        elif self._asked[1].done():
            (asked, work), self._asked = self._asked, None
            self._explained = asked, work.result()
        return self._explained[1]

    def _explain(self, time: float) -> Explanation | None:
        return explain.at(self.timeline, time, self.data, system=self._system)


def given(sources: Sources, *, ground: Ground | None = None) -> list[Member]:
    """The clips and the runs of what was given; ground is what the runs went on."""
    found = [of_clip(clip) for clip in sources.clips.values()]
    known = {"ground": ground or flat}
    return found + [of_run(name, run, sources.data_of(run), **known) for name, run in sources.runs.items()]


def check_ghost(count: int) -> None:
    """A UserError unless so many characters are one and its ghost."""
    if count != 2:
        here = "is one" if count == 1 else f"are {count}"
        raise UserError(f"a ghost needs two characters, here {here}", remedy="choose two: --systems mm,lmm")


def chosen(
    sources: Sources,
    systems: Sequence[str] | None = None,
    *,
    course: str | None = None,
    settings: Mapping[str, str] | None = None,
    ground: Ground | None = None,
) -> dict[str, Part]:
    """Who is driven, by name: these systems, by default all that there are; beside runs, which they explain,
    only where systems or a course are named.

    course, settings and ground are for them: a UserError where there is nobody who takes them.
    """
    explained = bool(sources.runs) and systems is None and course is None
    found = {} if explained else sources.parts(systems)
    wanted = {
        "over a course": course,
        "by settings": settings,
        "on heights": None if sources.runs else ground,
    }
    for what, asked in wanted.items():
        if asked and not found:
            remedy = (
                "name who is: --systems"
                if sources.databases or sources.models
                else "give a database or a model"
            )
            raise UserError(f"nobody is driven {what}", remedy=remedy)
    for name in settings or ():
        if name and name not in found:
            raise UserError(f"settings for {name!r}, which is not driven", remedy=config.choices(found))
    return found


def of_clip(show: Recorded) -> Member:
    """A clip's show; its contacts are those that its motion tells."""
    arrays: dict[str, NDArray] = {"positions": show.positions, "rotations": show.rotations}
    touching = _contacts(show)
    if touching is not None:
        arrays["contacts"] = touching[:, None]
    run = Recording(
        "clip", show.skeleton, show.fps, arrays, step_seconds=np.full(len(show.positions), np.nan)
    )
    return Member(show, Timeline.of_recording(run))


def of_run(name: str, run: Recording, data: Data | None = None, **known: Any) -> Member:
    """A recorded run; known is what else a `Member` knows."""
    show = known.pop("show", None) or shows.of_recording(run, name=name)
    return Member(show, Timeline.of_recording(run), run=run, data=data, **known)


def driven(
    parts: Mapping[str, Part],
    course: Course,
    *,
    seconds: float | None = None,
    settings: Mapping[str, str] | None = None,
    ground: Ground | None = None,
    progress: Callable[..., Iterator[int]] = console.progress,
) -> list[Member]:
    """Systems driven over one course, each from its start, until it is done or seconds are over.

    The course is scaled to the data of the first one, so that all are asked the same. settings: see
    `settings_of`.
    """
    first = next(iter(parts.values()))
    asked = fitted(course, first.driven.description)
    tuned = settings_of(parts, settings or {})
    found = []
    for name, part in parts.items():
        system = part.make(tuned[name], ground=ground, obstacles=asked.obstacles())
        driver = Driver(asked, 1, system.fps)
        until = None if seconds is None else seconds + 1 / system.fps  # a step is there at that time, too
        run = recording.record(system, asked, seconds=until, driver=driver, progress=progress)
        description = part.driven.description
        show = shows.of_recording(run, name=name, shape=played.shape_of(description, part.data))
        known = {"contact_roles": description.contact_roles, "ground": ground or flat}
        found.append(of_run(name, run, part.data, show=show, system=system, **known))
    return found


def settings_of(parts: Mapping[str, Part], files: Mapping[str, str]) -> dict[str, Any]:
    """Settings by the names of systems, None for the usual ones; files are TOML ones by these names, under ""
    that of the others. One of another kind's settings is a UserError."""
    paths = {name: files.get(name, files.get("")) for name in parts}
    return {
        name: None if path is None else config.load(parts[name].driven.settings, path)
        for name, path in paths.items()
    }


def _contacts(show: Recorded) -> NDArray[np.uint8] | None:
    """What touches the ground in a clip [T, C]; None where it has no feet."""
    try:
        return contacts.contacts(show.clip())
    except UserError:
        return None
