"""Drives the window by real keys of an X display, and says what came of it; tests run it as a program."""

from __future__ import annotations

import ctypes
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageGrab

from viewer import sources, window
from viewer.raster import Renderer

FRAME = 1 / 30  # seconds that go by from frame to frame, however long they take
DRAWN = 1.0  # seconds between frames that are drawn
LATEST = 40.0  # seconds until the picture has to be there


class Keyboard:
    """Keys of the display, as a user holds them."""

    def __init__(self) -> None:
        self._x, self._test = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(None))

    def hold(self, key: str, down: bool) -> None:
        code = self._x.XKeysymToKeycode(self._display, ctypes.c_ulong(ord(key)))
        self._test.XTestFakeKeyEvent(self._display, code, int(down), ctypes.c_ulong(0))
        self._x.XFlush(self._display)


class Script:
    """What is done frame by frame, and what it led to."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.told, self.time = folder, {}, 0.0  # type: ignore[var-annotated]
        self.keys, self._todo, self._wait = Keyboard(), self.steps(), 0
        self._window: Any = None
        self.ended = False

    def frame(self, shown: Any) -> bool:
        self.time += FRAME
        self._window = shown
        if self._wait > 0:
            self._wait -= 1
            return False
        found = next(self._todo, None)
        if found is None:
            if not self.ended:
                shown.close()
            self.ended = True
            return False
        self._wait = found if found > 0 else 0
        return found == 0

    def where(self) -> dict[str, float]:
        stage = self._window.players.stage
        x, _, z = stage.roots[0].tolist()
        return {"x": x, "z": z, "yaw": float(stage.yaws[0]), "time": self._window.players.session.time}

    def held(self, key: str, seconds: float) -> Any:
        """Hold a key until the window knows of it, and for a while."""
        self.keys.hold(key, True)
        until = time.time() + 10
        while key.upper() not in self._window.held and time.time() < until:
            yield 1
        self.told[f"{key} known"] = key.upper() in self._window.held
        yield round(seconds / FRAME)
        self.keys.hold(key, False)
        while key.upper() in self._window.held and time.time() < until:
            yield 1

    def steps(self) -> Any:
        """Numbers of frames to let go by undrawn; 0 for one that is drawn."""
        told = self.told
        yield 1
        shown, players = self._window, self._window.players
        for _ in range(3):  # who is not drawn yet has no keys
            yield 0
        told["start"] = self.where()
        yield from self.held("w", 2.0)
        told["ahead"] = self.where()
        yield from self.held("a", 1.5)
        told["left"] = self.where()
        yield 45
        told["before"] = self.where()
        yield from self.held("w", 1.0)
        steady = shown.side.sliders
        told["sliders"] = sorted(steady)
        name = players.names[0]
        told["setting before"] = players.session.actors[name].system.settings.velocity_halflife
        players.tunings[name].set("velocity_halflife", 0.9)
        players.tune(name, False)
        yield 2
        told["setting after"] = players.session.actors[name].system.settings.velocity_halflife
        shown.bar.scrub(told["ahead"]["time"])
        yield 3
        told["scrubbed"] = self.where()
        told["paused"] = players.session.paused
        shown.eye.distance, shown.eye.azimuth = 4.0, np.pi + told["ahead"]["yaw"]
        yield 30  # for the camera to come along
        begun, size = time.time(), (shown.scene.frame.width, shown.scene.frame.height)
        plain = Renderer(*size).render(players.stage.scene, shown.camera)
        Image.fromarray(plain).save(self.folder / "plain.png")
        while time.time() < begun + LATEST:
            time.sleep(DRAWN)
            yield 0
            picture = np.asarray(ImageGrab.grab())[: size[1], : size[0]]
            apart = np.abs(picture.astype(int) - plain).mean()
            told["apart"] = float(apart)
            if apart < 12:
                break
        Image.fromarray(picture).save(self.folder / "window.png")
        ImageGrab.grab().save(self.folder / "whole.png")
        told["late"] = time.time() - begun
        (self.folder / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    script = Script(Path(sys.argv[1]))
    window.run(
        sources.read([]), size=(800, 520), patience=20.0, clock=lambda: script.time, on_frame=script.frame
    )
    print("closed")
