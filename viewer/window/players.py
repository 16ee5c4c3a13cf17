"""Who is in the window: systems under one pilot, or clips and recorded runs; and what is drawn about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from features.terrain import Ground, flat
from mm import courses
from mm.runs import fitted
from motion.errors import UserError

from .. import cast, layers, moments, played, scene, shows
from ..cast import Member
from ..controls import Stick, on_course, speeds_of
from ..layers.terrain import Patch
from ..live import Live
from ..offscreen import marks_of
from ..played import Played
from ..replay import Replay
from ..session import Session
from ..sources import Sources
from ..stage import Stage
from ..timeline import EXACTLY
from ..tuning import Tuning, Workshop

SHOWN, UNEVEN = ("trajectory",), ("contacts",)  # uneven ground shows no shadows
LANE = 1.4  # metres between who stand side by side on one ground


class Players:
    """All that moves.

    Parameters
    ----------
    sources : what was given; runs and clips alone are replayed.
    systems, course, settings, ground : who is driven, see `viewer.cast.chosen`; without a course by a user's
        hands.
    start, stop : seconds of what is replayed.
    shown : of `viewer.offscreen.DRAWABLE`, what is drawn about them; None: the usual.
    ghost : whether the second of two stands in the first one's place, clear.
    names : whether their names stand above them, by default those of several.
    behind : whether the first of several is leftmost as seen from behind, by default where hands drive.

    Attributes
    ----------
    tunings : by name, of all systems that can be driven.
    names : of those that are.
    live : the session's thread; session belongs to it, `do` asks for changes.
    stage : with the scene that shows them.
    """

    def __init__(
        self,
        sources: Sources,
        *,
        systems: Sequence[str] | None = None,
        course: str | None = None,
        settings: Mapping[str, str] | None = None,
        ground: Ground | None = None,
        start: float = 0.0,
        stop: float | None = None,
        shown: Sequence[str] | None = None,
        ghost: bool = False,
        names: bool | None = None,
        behind: bool | None = None,
        theme: scene.Theme = scene.LIGHT,
        patience: float | None = None,
    ) -> None:
        parts = cast.chosen(sources, systems, course=course, settings=settings, ground=ground)
        self.recorded = cast.given(sources, ground=ground)
        if not parts and not self.recorded:
            raise UserError("nothing to show", remedy="give clips, a database, a model or a recorded run")
        if parts and (start or stop is not None):
            remedy = "leave --from and --to out, or draw a film: --offscreen OUT.mp4"
            raise UserError("who is driven in a window begins now, and goes on", remedy=remedy)
        tuned = cast.settings_of(parts, settings or {})
        self.tunings = {name: Tuning(part, tuned[name]) for name, part in parts.items()}
        self._course = None if course is None else courses.load(course)
        self._ground, self._theme, self._named, self._span = ground, theme, names, (start, stop)
        self._behind = bool(parts) and course is None if behind is None else behind
        self._patience: dict[str, float] = {} if patience is None else {"patience": patience, "budget": 1e9}
        usual = SHOWN + (UNEVEN if ground is not None else ())
        self.shown, self.ghost = set(usual if shown is None else shown), False
        self.workshop, self._aside = Workshop(), ThreadPoolExecutor(1, thread_name_prefix="explanations")
        self.live: Live | None = None
        self.choose(list(parts))
        self.set_ghost(ghost)

    def choose(self, names: Sequence[str]) -> None:
        """Let these systems begin together; none: the recordings alone."""
        self.close_live()
        self.names = [name for name in self.tunings if name in names]
        self.session: Session | Replay
        self.session = self._session() if self.names else Replay(self.recorded, *self._span)
        self.live = Live(self.session, **self._patience)
        self.members = [*self.recorded, *map(self._member, self.names)]
        for member in self.members:
            member.aside = self._aside
        self.ghost = self.ghost and len(self.members) == 2
        self.dress()

    def set_ghost(self, on: bool) -> None:
        """Put the second of two into the first one's place, or beside it; a UserError where there are not
        two."""
        if on:
            cast.check_ghost(len(self.members))
        self.ghost = on
        self.dress()

    def dress(self) -> None:
        """Put all on a stage, with what is drawn about them."""
        over = self.members[1] if self.ghost else None
        who = self.members[:1] if over is not None else self.members
        marks = [marks_of(each, [n for n in layers.DRAWN if n in self.shown], over=over) for each in who]
        names = len(who) > 1 if self._named is None else self._named
        uneven = next((each.ground for each in who if each.ground is not flat), None)
        self._patch = None if uneven is None else Patch(uneven)
        self.stage = Stage(
            [each.show for each in who],
            theme=self._theme,
            names=names,
            marks=marks,
            lanes=uneven is None,
            behind=self._behind,
        )

    def move_to(self, time: float) -> None:
        """Show the poses at a time, and the ground that they are on.

        What is to be drawn about them and cannot be is a UserError, after that.
        """
        try:
            self.stage.move_to(time)
        finally:  # what is drawn about them may be what their run does not tell
            ground = None if self._patch is None else self._patch.around(self.stage.roots[:, [0, 2]])
            if ground is not None:
                self.stage.lay(0, ground)

    def do(self, wish: Any) -> None:
        """Have something done to the session."""
        assert self.live is not None
        self.live.do(wish)

    @property
    def stick(self) -> Stick | None:
        """The user's hands, where they command."""
        pilot = getattr(self.session, "pilot", None)
        return pilot if isinstance(pilot, Stick) else None

    @property
    def first(self) -> Member:
        """Whom the camera follows: the first one who is driven."""
        return self.members[len(self.recorded) if self.names else 0]

    @property
    def searching(self) -> Member:
        """Whose searches are explained: the first one who makes any."""
        who = (self.first, *self.members)
        return next((each for each in who if "searched" in each.timeline.names), self.first)

    def jump(self, kind: str, now: float, *, back: bool = False) -> float | None:
        """When the next moment of a kind (`viewer.moments.KINDS`) of anyone is, or when the last one was, of
        those that can be looked at."""
        found, session = [], self.session
        for member in self.members:
            timeline = member.timeline
            steps = moments.of(timeline, member.contact_roles)[kind]
            until, since = timeline.steps_around(now)
            step = moments.before(steps, since) if back else moments.after(steps, until)
            if step is not None and session.begin <= step / timeline.fps <= session.time + EXACTLY:
                found.append(step / timeline.fps)
        return (max if back else min)(found, default=None)

    def remembered(self, member: Member) -> Member:
        """One with the run and the poses that its timeline remembers, of who is driven."""
        if member in self.recorded:
            return member
        run = member.timeline.recording()
        show = shows.of_recording(run, name=member.name, shape=member.show.body)
        return cast.of_run(member.name, run, member.data, show=show)

    def tune(self, name: str, rebuilds: bool) -> None:
        """Let a driven system go by what its sliders are at."""
        tuning = self.tunings[name]
        if name not in self.names:
            return
        if rebuilds or name in self.workshop or name in self.session.fixed:
            self.workshop.start(name, tuning, **self._about(name))
        else:
            settings = tuning.settings
            self.do(lambda session: session.retune(name, settings))

    def take_made(self) -> None:
        """Let systems that are ready take the places of those that they are made from."""
        for name, system in self.workshop.ready().items():
            if name in self.names:
                tuning = self.tunings[name]
                self.do(lambda session, t=tuning, n=name, s=system: t.take(session, n, s))

    def close_live(self) -> None:
        if self.live is not None:
            self.live.close()

    def close(self) -> None:
        self.close_live()
        self.workshop.close()
        self._aside.shutdown(wait=True, cancel_futures=True)

    def _session(self) -> Session:
        first = self.tunings[self.names[0]].part.driven.description
        self._asked = None if self._course is None else fitted(self._course, first)
        systems = {name: self.tunings[name].make(**self._about(name)) for name in self.names}
        if self._asked is not None:
            driver = on_course(self._asked, len(systems))
            driver.know(*systems.values())
            return Session(systems, driver)
        starts = np.zeros((len(systems), 2))
        if self._ground is not None:  # in one world, and not each at the beginning of its own
            starts[:, 0] = (-LANE if self._behind else LANE) * (
                np.arange(len(systems)) - (len(systems) - 1) / 2
            )
        return Session(systems, Stick(len(systems), speeds=speeds_of(first), starts=starts))

    def _about(self, name: str) -> dict[str, Any]:
        obstacles = () if self._asked is None else self._asked.obstacles()
        return {"ground": self._ground, "obstacles": obstacles}

    def _member(self, name: str) -> Member:
        part, actor = self.tunings[name].part, self.session.actors[name]
        description = part.driven.description
        return Member(
            Played(name, actor.timeline, played.shape_of(description, part.data)),
            actor.timeline,
            data=part.data,
            system=getattr(actor, "system", None),
            contact_roles=description.contact_roles,
            ground=self._ground or flat,
        )
