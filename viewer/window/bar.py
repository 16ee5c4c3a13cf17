"""The timeline below the scene: where one looks, pause and steps, slow motion, and what to jump to."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from open3d.visualization import gui

from motion.errors import UserError

from .players import Players

SLOW = 0.2  # of real time
_NOTCH = 0.02  # seconds by which the slider has to be moved
JUMPS = {"transition": "transition", "slide": "slide", "peak": "cost peak"}


class Bar:
    """Buttons and a slider over what is remembered."""

    def __init__(self, players: Players, em: float, *, tell: Callable[[str], None]) -> None:
        self._players, self._tell = players, tell
        self.widget = gui.Vert(0.2 * em, gui.Margins(0.5 * em, 0.2 * em, 0.5 * em, 0.2 * em))
        self.slider = gui.Slider(gui.Slider.DOUBLE)
        self.slider.set_on_value_changed(lambda moment: self._slid(float(moment)))
        buttons = gui.Horiz(0.2 * em)
        self._set = 0.0
        self._play = gui.Button("Pause")
        self._slow = gui.Button("Slow")
        clicks: list[tuple[Any, Callable[[], None]]] = [
            (self._play, self.pause_or_go_on),
            (gui.Button("< step"), lambda: self.step(back=True)),
            (gui.Button("step >"), self.step),
            (self._slow, self.slow_or_not),
            *((gui.Button(f"{words} >"), partial(self.jump, kind)) for kind, words in JUMPS.items()),
        ]
        for button, what in clicks:
            button.set_on_clicked(what)
            button.vertical_padding_em = 0.0
            buttons.add_child(button)
        self.widget.add_child(self.slider)
        self.widget.add_child(buttons)

    def refresh(self, now: float) -> None:
        """Tell of where one looks."""
        session = self._players.session
        begin, end = session.begin, max(session.time, session.begin + 1e-3)
        self.slider.set_limits(begin, end)
        self.slider.double_value = self._set = min(max(now, begin), end)
        self._play.text = "Go on" if session.paused else "Pause"
        self._slow.text = "Slow" if session.speed == 1 else "Not slow"

    def _slid(self, moment: float) -> None:
        # It also tells of values that it was set to.
        if abs(moment - self._set) > _NOTCH:
            self.scrub(moment)

    def scrub(self, moment: float) -> None:
        self._players.do(lambda session: session.scrub(moment))

    def step(self, *, back: bool = False) -> None:
        self._players.do(lambda session: session.single_step(back=back))

    def slow_or_not(self) -> None:
        self._players.do(lambda session: setattr(session, "speed", SLOW if session.speed == 1 else 1.0))

    def pause_or_go_on(self) -> None:
        def wish(session: Any) -> None:
            if not session.paused:
                session.paused = True
                return
            try:
                session.resume()
            except UserError:  # who cannot go back goes on from the present
                session.scrub(None)
                session.resume()

        self._players.do(wish)

    def jump(self, kind: str, *, back: bool = False) -> None:
        live = self._players.live
        assert live is not None
        moment = self._players.jump(kind, live.look.time, back=back)
        if moment is None:
            self._tell(f"no {JUMPS[kind]} {'before' if back else 'after'} this, of those remembered")
        else:
            self.scrub(moment)
