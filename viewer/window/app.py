"""The window: what happens in a frame, and what keys and the mouse do."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from open3d.visualization import gui, rendering

from motion.errors import UserError

from .. import views
from ..controls import KEYS, TURN, of_keys
from ..gamepad import Gamepad
from ..raster.renderer import STANDARD
from ..session import Look
from .bar import Bar
from .drawing import Drawing
from .eye import Eye
from .players import Players
from .side import Side
from .watch import Watch

SIDE, BELOW = 24, 4  # letters' heights that the tabs are wide, and the timeline is high
BUTTONS = 34  # likewise, that the timeline's buttons take
TITLES = 21  # likewise, that the tabs' titles take beside a scroll bar
REFRESH = 0.1  # seconds after which numbers and pictures at the side are new
_LOOKS, _ROOM = 40, 1.5  # instants at which one looks what has to be seen; room for who is driven
AHEAD = 6.0  # seconds of several recordings that are seen from where one looks at first
TOLD = 4.0  # seconds for which a line is told
RATE = 15.0  # pictures a second where a processor draws
TURN_ABOUT = 5e-4  # seconds that another thread's Python may keep a frame waiting; by default it is 5e-3


class Window:
    """An open window.

    Parameters
    ----------
    players : whom it shows.
    size : pixels.
    view : how they are seen at first.
    clock : gives the time, seconds, by which frames follow one another.
    on_frame : called in each frame, with the window; it may tell whether the frame is drawn.
    software : whether a processor draws, for want of a graphics card.
    """

    def __init__(
        self,
        players: Players,
        *,
        size: tuple[int, int] = (1280, 800),
        view: views.View | None = None,
        clock: Callable[[], float] = time.perf_counter,
        on_frame: Callable[[Window], bool | None] | None = None,
        software: bool = False,
    ) -> None:
        self.players, self._clock, self._on_frame = players, clock, on_frame
        self._app = gui.Application.instance
        self._app.initialize()
        self.window = self._app.create_window("motion matching", *size)
        em = self.window.theme.font_size
        self.scene = gui.SceneWidget()
        self.scene.scene = rendering.Open3DScene(self.window.renderer)
        self.scene.set_on_mouse(self._on_mouse)
        self._line = gui.Label("")
        self._line.visible = False
        self.bar = Bar(players, em, tell=self.tell)
        self.watch, self.pad = Watch(), Gamepad()
        self._view = view or views.View(azimuth=np.pi)
        self.side = Side(
            self.window,
            players,
            em,
            watch=self.watch,
            pad=self.pad,
            camera=self._view.kind,
            on_players=self._begin,
            on_camera=self._set_camera,
            tell=self.tell,
        )
        for child in (self.scene, self.bar.widget, self.side.widget, self._line):
            self.window.add_child(child)
        self.window.set_on_layout(self._lay_out)
        self.window.set_on_key(self.on_key)
        self.window.set_on_tick_event(self._tick)
        self._software, self._drawn = software, -np.inf
        self.drawing = Drawing(self.scene, pixels=size[1] / STANDARD, smooth=not software)
        self.held: set[str] = set()
        self.frames = 0
        self._before, self._told, self._refreshed = clock(), -np.inf, -np.inf
        self._mouse: tuple[int, int] | None = None
        self._error: BaseException | None = None
        self._begin()

    def run(self) -> None:
        """Until it is closed; what a frame raises is raised here, and an interrupt from the keyboard, too."""
        before, turns = signal.signal(signal.SIGINT, self._interrupt), sys.getswitchinterval()
        sys.setswitchinterval(TURN_ABOUT)
        try:
            self._app.run()
        finally:
            sys.setswitchinterval(turns)
            signal.signal(signal.SIGINT, before)
            self.players.close()
            self.pad.close()
        if self._error is not None:
            raise self._error

    def _interrupt(self, *_: Any) -> None:
        # Raised among Open3D's own calls it would end the program while others still draw.
        self._error = KeyboardInterrupt()

    def close(self) -> None:
        # Open3D crashes where a window closes in its own tick.
        self._app.post_to_main_thread(self.window, self.window.close)

    def tell(self, words: str) -> None:
        """Show a line for a while."""
        self._line.text, self._told = words, self._clock()
        self._line.visible = True

    # A frame

    def _tick(self) -> bool:
        """A frame; whether it is to be drawn."""
        begin = time.perf_counter()
        if self._error is not None:
            self.close()
            return False
        try:
            self._frame()
            self.watch.take(begin, time.perf_counter())
            drawn = None if self._on_frame is None else self._on_frame(self)
        except Exception as error:  # Open3D would print it and go on
            self._error, drawn = error, False
        return self._in_time() if drawn is None else drawn

    def _in_time(self) -> bool:
        """Whether a picture is to be drawn: a processor that draws has the motion to think of, too."""
        now = time.perf_counter()
        if self._software and now - self._drawn < 1 / RATE:
            return False
        self._drawn = now
        return True

    def _frame(self) -> None:
        now = self._clock()
        passed, self._before = now - self._before, now
        players, hands = self.players, of_keys(self.held) | self.pad.hands()
        stick = players.stick
        if stick is not None:
            stick.hands = replace(hands, turn=0.0)  # the window's camera turns, and the stick's is set to it
            stick.camera_yaw = self.eye.yaw
        assert players.live is not None
        try:
            look = players.live.frame(passed)
        except UserError as error:  # what was asked of it cannot be
            self.tell(str(error))
            look = players.live.look
        self.eye.azimuth += hands.turn * TURN * passed
        self.eye.tilt(hands.tilt, passed)
        self._show(look, passed)
        if now - self._refreshed >= REFRESH:
            self._refreshed = now
            try:
                players.take_made()
            except UserError as error:
                self.tell(str(error))
            self.bar.refresh(look.time)
            self.side.refresh(look.time, look.errors)
            self._line.visible = now - self._told < TOLD
        self.frames += 1

    def _show(self, look: Look, passed: float) -> None:
        stage = self.players.stage
        try:
            self.players.move_to(look.time)
        except UserError as error:  # they are there, but not all that was to be drawn about them
            self.tell(str(error))
        self.camera = self.eye.move(views.goal(stage), passed)
        views.light(stage, self.camera)
        self.drawing.show(stage.scene, self.camera)

    def _begin(self) -> None:
        """Look at those who play now."""
        session, driven = self.players.session, bool(self.players.names)
        begin = session.time if driven else session.begin
        # Who is driven goes nobody knows where; several clips may go apart, so that none would be seen well.
        seconds = 0.0 if driven else AHEAD if len(self.players.members) > 1 else np.inf
        span = begin, min(session.time, begin + seconds)
        frame, view = self.window.content_rect, self._view
        seen = views.first_camera(
            self.players.stage, np.linspace(*span, _LOOKS).tolist(), (frame.width, frame.height), view
        )
        offset = seen.position - seen.target
        self.eye = Eye(
            seen.target,
            azimuth=float(np.arctan2(offset[0], offset[2])),
            elevation=view.elevation,
            distance=view.distance or seen.distance * (_ROOM if driven else 1.0),
            kind=view.kind,
            turn=view.turn,
        )

    def _set_camera(self, kind: str) -> None:
        self._view = replace(self._view, kind=kind)
        self.eye.kind = kind

    # Hands

    def on_key(self, event: Any) -> bool:
        """A key went down or up; whether that was for the window."""
        name, down = _NAMES.get(int(event.key)), event.type == gui.KeyEvent.Type.DOWN
        if self.side.asking and down:
            return False  # a file's name is written
        if name in KEYS:
            (self.held.add if down else self.held.discard)(name)
            return True
        if name is None or not down or event.is_repeat:
            return False
        bar = self.bar
        {
            "SPACE": bar.pause_or_go_on,
            "PERIOD": bar.step,
            "COMMA": lambda: bar.step(back=True),
            "M": bar.slow_or_not,
            "R": lambda: self.players.do(lambda session: session.reset()),
            "ONE": lambda: bar.jump("transition"),
            "TWO": lambda: bar.jump("slide"),
            "THREE": lambda: bar.jump("peak"),
        }[name]()
        return True

    def _on_mouse(self, event: Any) -> Any:
        kinds = gui.MouseEvent.Type
        if event.type == kinds.WHEEL:
            self.eye.zoom(float(np.sign(event.wheel_dy)))
        elif event.type == kinds.DRAG and self._mouse is not None:
            self.eye.drag(event.x - self._mouse[0], event.y - self._mouse[1])
        self._mouse = (event.x, event.y) if event.type in (kinds.DRAG, kinds.BUTTON_DOWN) else None
        return gui.SceneWidget.EventCallbackResult.CONSUMED

    # Around

    def _lay_out(self, _: Any) -> None:
        room, em = self.window.content_rect, self.window.theme.font_size
        titles = min(TITLES * em, 2 * room.width // 3)
        wide, high = min(SIDE * em, max(room.width // 2, titles)), BELOW * em
        left, top = room.width - wide, room.height - high
        beneath = left < BUTTONS * em  # the timeline lies beneath the tabs, too
        self.scene.frame = gui.Rect(room.x, room.y, left, top)
        self.bar.widget.frame = gui.Rect(room.x, room.y + top, room.width if beneath else left, high)
        self.side.widget.frame = gui.Rect(room.x + left, room.y, wide, top if beneath else room.height)
        self._line.frame = gui.Rect(room.x + em, room.y + em // 2, left - 2 * em, 2 * em)


_NAMES: dict[int, str] = {
    int(getattr(gui.KeyName, name)): name
    for name in [*(set(KEYS) - {"SHIFT", "CTRL"}), *"SPACE PERIOD COMMA M R ONE TWO THREE".split()]
} | {
    int(getattr(gui.KeyName, f"{side}_{key}")): name
    for side in ("LEFT", "RIGHT")
    for key, name in (("SHIFT", "SHIFT"), ("CONTROL", "CTRL"))
}
