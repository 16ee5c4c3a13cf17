"""Who is in the window: systems under one pilot, or clips and recorded runs; and what is drawn about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from features.terrain import Ground, flat
from mm import courses
from mm.runs import fitted
from motion import config
from motion.errors import UserError

from .. import cast, layers, moments, played, scene
from ..cast import Member
from ..controls import Stick, on_course, speeds_of
from ..live import Live
from ..offscreen import marks_of
from ..played import Played
from ..replay import Replay
from ..session import Session
from ..sources import Sources
from ..stage import Stage
from ..tuning import Tuning, Workshop

SHOWN = ("trajectory",)


class Players:
    """All that moves.

    Parameters
    ----------
    sources : what was given; runs and clips alone are replayed.
    systems : who is driven, by default all that can be.
    course : what they are asked; None for a user's hands.
    settings : TOML files by the names of systems, under "" that of the others.
    shown : of `viewer.layers.DRAWN`, what is drawn about them.

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
        shown: Sequence[str] = SHOWN,
        ghost: bool = False,
        theme: scene.Theme = scene.LIGHT,
        patience: float | None = None,
    ) -> None:
        self.recorded = cast.given(sources)
        replays = bool(self.recorded) and systems is None and course is None
        parts = {} if replays and not (sources.clips and sources.models) else sources.parts(systems)
        files = settings or {}
        self.tunings = {}
        for name, part in parts.items():
            path = files.get(name, files.get(""))
            self.tunings[name] = Tuning(
                part, None if path is None else config.load(part.driven.settings, path)
            )
        if not parts and not self.recorded:
            raise UserError("nothing to show", remedy="give clips, a database, a model or a recorded run")
        self._course = None if course is None else courses.load(course)
        self._ground, self._theme = ground, theme
        self._patience: dict[str, float] = {} if patience is None else {"patience": patience, "budget": 1e9}
        self.shown, self.ghost = set(shown), ghost
        self.workshop = Workshop()
        self.live: Live | None = None
        self.choose(list(parts))

    def choose(self, names: Sequence[str]) -> None:
        """Let these systems begin together; none: the recordings alone."""
        self.close_live()
        self.names = [name for name in self.tunings if name in names]
        self.session: Session | Replay = self._session() if self.names else Replay(self.recorded)
        self.live = Live(self.session, **self._patience)
        self.members = [*self.recorded, *map(self._member, self.names)]
        self.dress()

    def dress(self) -> None:
        """Put all on a stage, with what is drawn about them."""
        over = self.members[1] if self.ghost and len(self.members) == 2 else None
        who = self.members[:1] if over is not None else self.members
        marks = [marks_of(each, [n for n in layers.DRAWN if n in self.shown], over=over) for each in who]
        self.stage = Stage([each.show for each in who], theme=self._theme, names=len(who) > 1, marks=marks)

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

    def jump(self, kind: str, now: float, *, back: bool = False) -> float | None:
        """When the next moment of a kind (`viewer.moments.KINDS`) of anyone is, or when the last one was."""
        found = []
        for member in self.members:
            timeline = member.timeline
            steps = moments.of(timeline, member.contact_roles)[kind]
            step = (moments.before if back else moments.after)(steps, timeline.step_at(now))
            if step is not None:
                found.append(step / timeline.fps)
        return (max if back else min)(found, default=None)

    def tune(self, name: str, rebuilds: bool) -> None:
        """Let a driven system go by what its sliders are at."""
        tuning = self.tunings[name]
        if name not in self.names:
            return
        if rebuilds or name in self.session.fixed:
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

    def _session(self) -> Session:
        first = self.tunings[self.names[0]].part.driven.description
        self._asked = None if self._course is None else fitted(self._course, first)
        systems = {name: self.tunings[name].make(**self._about(name)) for name in self.names}
        if self._asked is not None:
            return Session(systems, on_course(self._asked, len(systems)))
        return Session(systems, Stick(len(systems), speeds=speeds_of(first)))

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
