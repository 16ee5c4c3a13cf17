"""Drives the window by real keys and a real mouse of an X display, and says what came of it.

Tests run it as a program, with a folder for what it tells (`told.json`) and for pictures.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from open3d.visualization import rendering
from PIL import Image, ImageGrab

from mm.build import build
from motion import bvh, console, dancecard
from viewer import camera, moments, sources, window
from viewer.raster import Renderer
from viewer.scene import Arrows, Points
from viewer.window.side import TABS

SIZE = (640, 440)
WHEEL = 4  # the mouse's button that is its wheel, towards what is seen
FRAME = 1 / 30  # seconds that go by from frame to frame of what is asked for, however long they take
LATEST = 60.0  # real seconds until something has to be there

Steps = Iterator[bool]  # whether a frame is drawn, for each


class Hand:
    """Keys and mouse of the display, as a user moves them."""

    def __init__(self) -> None:
        self._x, self._test = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(None))
        self._x.XAutoRepeatOff(self._display)

    def key(self, key: str, down: bool) -> None:
        code = self._x.XKeysymToKeycode(self._display, ctypes.c_ulong(ord(key)))
        self._test.XTestFakeKeyEvent(self._display, code, int(down), ctypes.c_ulong(0))
        self._x.XFlush(self._display)

    def point(self, x: float, y: float) -> None:
        self._test.XTestFakeMotionEvent(self._display, -1, round(x), round(y), ctypes.c_ulong(0))
        self._x.XFlush(self._display)

    def button(self, down: bool, number: int = 1) -> None:
        self._test.XTestFakeButtonEvent(self._display, number, int(down), ctypes.c_ulong(0))
        self._x.XFlush(self._display)


class Script:
    """What is done frame by frame, and what it led to."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.time, self.told = folder, 0.0, dict[str, Any]()
        self.hand, self._todo, self.shown = Hand(), self.steps(), None
        self.nothing: Any = None

    def frame(self, shown: Any) -> bool:
        if self.shown is None:
            self.shown, self.nothing = shown, rendering.Open3DScene(shown.window.renderer)
            self.nothing.set_view_size(1, 1)
        drawn = next(self._todo, None)
        if drawn is None:
            self._todo = iter(lambda: False, None)
            signal.raise_signal(signal.SIGINT)  # as by Ctrl-C
        return bool(drawn)

    # What a user does

    def go(self, seconds: float) -> Steps:
        """Let time go by, in which nothing is drawn; else it stands."""
        for _ in range(round(seconds / FRAME)):
            self.time += FRAME
            yield False

    def until(self, there: Callable[[], bool], *, drawn: bool = False) -> Steps:
        end = time.time() + LATEST
        while not there():
            if time.time() > end:
                raise TimeoutError
            yield drawn

    def hold(self, key: str, seconds: float) -> Steps:
        """Hold a key for a while that begins when the window knows of it."""
        self.hand.key(key, True)
        yield from self.until(lambda: key.upper() in self.shown.held)
        yield from self.go(seconds)
        self.hand.key(key, False)
        yield from self.until(lambda: key.upper() not in self.shown.held)

    def draw(self, frames: int = 2) -> Steps:
        """Let frames be drawn, and wait for all but the last: Open3D makes a picture that is asked for when
        those before are done."""
        for _ in range(frames):
            made: list[Any] = []
            self.nothing.scene.render_to_image(made.append)
            yield from self.until(lambda made=made: bool(made), drawn=True)

    def press(self, x: float, y: float, *way: tuple[float, float]) -> Steps:
        """Press the mouse's button at a place, and let go of it there, or at the end of a way."""
        self.hand.point(x, y)
        yield from self.draw()
        self.hand.button(True)
        yield from self.draw()
        for place in way:
            self.hand.point(*place)
            yield from self.draw()
        self.hand.button(False)
        yield from self.draw()

    def click(self, widget: Any, share: float = 0.5) -> Steps:
        """Click on a widget, in its middle or elsewhere along it."""
        yield from self.draw()  # it may have no place yet
        frame = widget.frame
        yield from self.press(frame.x + share * frame.width, frame.y + frame.height / 2)

    def open(self, name: str) -> Steps:
        """Click on a tab; all are about equally wide."""
        tabs, em = self.shown.side.widget, self.shown.window.theme.font_size
        yield from self.press(tabs.frame.x + (2.5 + 4.4 * TABS.index(name)) * em, tabs.frame.y + 0.9 * em)

    # What is seen of it

    def where(self) -> dict[str, float]:
        stage = self.shown.players.stage
        x, _, z = stage.roots[0].tolist()
        return {"x": x, "z": z, "yaw": float(stage.yaws[0]), "time": self.shown.players.session.time}

    def settled(self) -> Steps:
        """Draw until the picture of the display stays as it is; keep it."""
        end, before = time.time() + LATEST, np.zeros(0)
        while time.time() < end:
            yield from self.draw(3)
            self.picture = np.asarray(ImageGrab.grab().convert("RGB"))
            if np.array_equal(self.picture, before):
                return
            before = self.picture
        raise TimeoutError

    def keep(self, name: str) -> None:
        Image.fromarray(self.picture).save(self.folder / f"{name}.png")

    def steps(self) -> Steps:
        told = self.told
        yield True
        shown = self.shown
        session, eye, side = shown.players.session, shown.eye, shown.side
        system = session.actors["mm"].system

        yield from self.draw()
        told["start"] = self.where()
        yield from self.hold("w", 1.5)
        told["ahead"] = self.where()
        yield from self.hold("a", 1.5)
        told["left"] = self.where()

        told["eye"] = [eye.azimuth, eye.elevation, eye.distance]
        yield from self.press(200, 200, (250, 200), (300, 220))
        for down in (True, False):
            self.hand.button(down, WHEEL)
        yield from self.draw()
        told["turned eye"] = [eye.azimuth, eye.elevation, eye.distance]

        yield from self.open("Settings")
        yield from self.click(side.sliders["velocity_halflife"], 0.62)
        told["set"] = system.settings.velocity_halflife
        told["begun"] = session.time
        self.hand.key("r", True)
        yield from self.until(lambda: self.where()["time"] > told["begun"])
        self.hand.key("r", False)
        yield from self.hold("w", 1.5)
        told["slowly"] = self.where()
        yield from self.click(side.buttons["Save..."])
        yield from self.press(350, 70)  # where the dialog has the file's name, and below what saves
        self.hand.key("w", True)
        yield from self.draw()
        told["held while a name is written"] = list(shown.held)
        self.hand.key("w", False)
        yield from self.draw()
        yield from self.press(478, 361)
        yield from self.until(lambda: not side.asking)
        yield from self.click(side.buttons["Reset"])
        told["reset"] = system.settings.velocity_halflife

        bar, end = shown.bar.slider, session.time
        yield from self.click(bar, told["ahead"]["time"] / end)
        told["paused"] = session.paused
        told["scrubbed"] = self.where() | {"time": session.shown}
        self.hand.key("1", True)
        yield from self.until(lambda: session.shown != told["scrubbed"]["time"])
        self.hand.key("1", False)
        told["jumped"] = session.shown
        told["transitions"] = moments.of(session.actors["mm"].timeline)["transition"].tolist()

        eye.distance, eye.azimuth, eye.elevation = 4.0, np.pi + told["ahead"]["yaw"], 0.2
        yield from self.go(4.5)  # for the camera to come along, and what is told to go
        yield from self.settled()
        self.keep("window")
        size = shown.scene.frame.width, shown.scene.frame.height
        self.picture = Renderer(*size).render(shown.players.stage.scene, shown.camera)
        self.keep("plain")
        layers, place = shown.players.stage.scene.layers, np.array(shown.camera.target)
        for name, shade, dot in (("large", (1, 0.8, 0), 40.0), ("small", (0.8, 0, 0), 20.0)):
            there = np.array(shade, np.float32)
            layers[name] = Points(positions=place[None], colours=there, size=dot, through=0.9)
        layers["arrows"] = Arrows(
            origins=place + np.array([[0.5, 0.2, 0.3], [0.4, -0.4, 0.0]]),
            vectors=np.array([[0.1, 0.5, 0.2], [0.1, 0.0, -0.04]]),
            colours=np.array([0, 0.7, 0], np.float32),
            radius=0.03,
        )
        told["marked"] = camera.project(shown.camera, place, *size)[0].tolist()
        yield from self.settled()
        self.keep("marked window")
        self.picture = Renderer(*size).render(shown.players.stage.scene, shown.camera)
        self.keep("marked plain")
        told["work"] = float(np.median(shown.watch.work))
        (self.folder / "told.json").write_text(json.dumps(told))


def dances(seconds: float = 60.0) -> sources.Sources:
    """A minute of the built-in data to be driven."""
    with tempfile.TemporaryDirectory() as folder:
        for passage in dancecard.generate(seconds):
            bvh.write(Path(folder, f"{passage.clip.name}.bvh"), passage.clip)
        data = build(folder, jobs=1, progress=console.silent)
    return sources.Sources(databases={"dances": data})


if __name__ == "__main__":
    script = Script(Path(sys.argv[1]).resolve())
    os.chdir(script.folder)  # where dialogs begin
    try:
        window.run(
            dances(),
            size=SIZE,
            shown=[],
            patience=LATEST,
            clock=lambda: script.time,
            on_frame=script.frame,
        )
    except KeyboardInterrupt:
        print("interrupted")
