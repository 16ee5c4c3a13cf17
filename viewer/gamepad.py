"""A gamepad as Linux tells of it: the events of /dev/input/js*; elsewhere, and without one, there is none.

An event is 8 bytes: time in ms, uint32; value, int16; type, uint8: 1 a button, 2 an axis, with 0x80 where it
tells the state at the beginning; number, uint8 (the kernel's documentation of its joystick interface).
"""

from __future__ import annotations

import glob
import math
import os
import struct
import time
from collections.abc import Callable

from mm.commands import DEADZONE

from .controls import Hands

EVENT = struct.Struct("<IhBB")
BUTTON, AXIS = 1, 2
FULL = 32767
# Axes and buttons as the drivers of the usual pads number them (xpad, hid-playstation).
LEFT_X, LEFT_Y, LEFT_TRIGGER, RIGHT_X, RIGHT_Y, RIGHT_TRIGGER, CROSS_X, CROSS_Y = range(8)
A, B = 0, 1
AGAIN = 1.0  # seconds between two looks for a pad
# What it does, for people.
CONTROLS = {
    "left stick, cross": "where to go",
    "right stick": "turn the camera",
    "right trigger, A": "run",
    "left trigger": "face where the camera looks",
    "B": "crouch",
}


class Gamepad:
    """The first gamepad there is: looked for when there is none, and let go of when it is pulled out.

    What its sticks and buttons do is told by `CONTROLS`.

    state : what there is, for people.
    """

    def __init__(
        self, pattern: str = "/dev/input/js*", *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._pattern, self._clock = pattern, clock
        self._file: int | None = None
        self._path, self._rest, self._looked = "", b"", -float("inf")
        self._axes: dict[int, float] = {}
        self._buttons: dict[int, bool] = {}
        self._find()

    @property
    def state(self) -> str:
        return "no gamepad" if self._file is None else f"gamepad {self._path}"

    def hands(self) -> Hands:
        """What it is held like now; never waits."""
        if self._file is None:
            self._find()
        self._read()
        axes, held = self._axes, self._buttons
        right, down = (axes.get(i, 0.0) for i in (LEFT_X, LEFT_Y))
        if abs(right) < DEADZONE and abs(down) < DEADZONE:
            right, down = (axes.get(i, 0.0) for i in (CROSS_X, CROSS_Y))
        return Hands(
            (right, 0.0 - down),
            turn=0.0 - _beyond(axes.get(RIGHT_X, 0.0)),
            tilt=0.0 - _beyond(axes.get(RIGHT_Y, 0.0)),
            run=axes.get(RIGHT_TRIGGER, -1.0) > 0 or held.get(A, False),
            strafe=axes.get(LEFT_TRIGGER, -1.0) > 0,
            crouch=held.get(B, False),
        )

    def close(self) -> None:
        if self._file is not None:
            os.close(self._file)
        self._file, self._rest = None, b""
        self._axes.clear()
        self._buttons.clear()

    def _find(self) -> None:
        if self._clock() - self._looked < AGAIN:
            return
        self._looked = self._clock()
        for path in sorted(glob.glob(self._pattern)):
            try:
                self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            except OSError:  # of another user, or gone again
                continue
            self._path = path
            return

    def _read(self) -> None:
        while self._file is not None:
            try:
                data = os.read(self._file, EVENT.size * 64)
            except BlockingIOError:
                return
            except OSError:  # pulled out
                data = b""
            if not data:
                self.close()
                return
            data = self._rest + data
            whole = len(data) - len(data) % EVENT.size
            self._rest = data[whole:]
            for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
                if kind & 0x7F == AXIS:
                    self._axes[number] = max(-1.0, value / FULL)
                elif kind & 0x7F == BUTTON:
                    self._buttons[number] = bool(value)


def _beyond(value: float) -> float:
    """An axis whose first part counts as none."""
    return math.copysign(max(0.0, abs(value) - DEADZONE) / (1 - DEADZONE), value)
