"""From keys, sticks and buttons to what characters are asked; other pilots are courses and earlier runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm.commands import from_stick, from_velocity
from mm.control import Command
from mm.course import Course
from mm.description import Description
from mm.driver import GAIT_HALFLIFE, Driver
from mm.recording import Recording
from mm.speeds import Speeds
from motion import springs

TURN = 2.0  # rad/s at which keys and a full stick turn the camera
STICK_HALFLIFE = 0.05  # seconds in which the stick goes half the way: keys know no tilt in between
LAPS = 1000  # of a course that is to go on


class Binding(NamedTuple):
    """What a key does while it is held, as words for people, and what it adds to the hands."""

    about: str
    move: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    run: bool = False
    strafe: bool = False
    crouch: bool = False


# By names of keys: letters as on the key, others in words.
KEYS: dict[str, Binding] = {
    "W": Binding("ahead", move=(0, 1)),
    "S": Binding("back", move=(0, -1)),
    "A": Binding("to the left", move=(-1, 0)),
    "D": Binding("to the right", move=(1, 0)),
    "UP": Binding("ahead", move=(0, 1)),
    "DOWN": Binding("back", move=(0, -1)),
    "LEFT": Binding("to the left", move=(-1, 0)),
    "RIGHT": Binding("to the right", move=(1, 0)),
    "Q": Binding("turn the camera to the left", turn=1),
    "E": Binding("turn the camera to the right", turn=-1),
    "SHIFT": Binding("run", run=True),
    "CTRL": Binding("face where the camera looks", strafe=True),
    "C": Binding("crouch", crouch=True),
}


@dataclass(frozen=True)
class Hands:
    """What a user holds down at an instant.

    Attributes
    ----------
    move : tilt x to the right, z away from the camera, in [-1, 1].
    turn, tilt : how fast the camera turns to the left and rises, in [-1, 1].
    run, strafe, crouch : which buttons are held.
    """

    move: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    tilt: float = 0.0
    run: bool = False
    strafe: bool = False
    crouch: bool = False

    def __or__(self, other: Hands) -> Hands:
        """Both at once: of the sticks the one that is tilted further."""
        mine, its = np.hypot(*self.move), np.hypot(*other.move)
        return Hands(
            self.move if mine >= its else other.move,
            max(self.turn, other.turn, key=abs),
            max(self.tilt, other.tilt, key=abs),
            self.run or other.run,
            self.strafe or other.strafe,
            self.crouch or other.crouch,
        )


def of_keys(held: Iterable[str]) -> Hands:
    """The hands that hold keys; unknown ones do nothing, opposite ones cancel out."""
    keys = [KEYS[key] for key in held if key in KEYS]
    x, z = (float(np.clip(sum(key.move[i] for key in keys), -1, 1)) for i in (0, 1))
    length = max(1.0, float(np.hypot(x, z)))
    return Hands(
        (x / length, z / length),
        float(np.clip(sum(key.turn for key in keys), -1, 1)),
        0.0,
        *(any(getattr(key, name) for key in keys) for name in ("run", "strafe", "crouch")),
    )


class Stick:
    """A user who stands behind a camera; a `viewer.session.Pilot`.

    All characters are asked the same: speeds ahead, aside and back are those of the first one's facing.

    Parameters
    ----------
    count : N.
    speeds : at full tilt.
    starts, yaws : where a reset puts the characters, x and z [N, 2], and how they face, [N].

    Attributes
    ----------
    hands : what is held now; set it whenever that changes.
    camera_yaw : where the camera looks, radians, 0 is +Z; it turns by the hands, and may be set.
    """

    def __init__(
        self,
        count: int = 1,
        *,
        speeds: Speeds | None = None,
        starts: ArrayLike = (0.0, 0.0),
        yaws: ArrayLike = 0.0,
        halflife: float = STICK_HALFLIFE,
    ) -> None:
        self._count, self.speeds, self.halflife = count, speeds or Speeds(), halflife
        self.starts = np.array(np.broadcast_to(np.asarray(starts, np.float32), (count, 2)))
        self.yaws = np.array(np.broadcast_to(np.asarray(yaws, np.float32), (count,)))
        self.hands = Hands()
        self.reset()

    def reset(self) -> None:
        self.camera_yaw = float(self.yaws[0])
        self._facing = self.camera_yaw
        self._tilt, self._gait, self._time = np.zeros(2), 0.0, 0.0

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        hands, passed = self.hands, max(0.0, time - self._time)
        self._time = time
        left, slow = (
            0.5 ** (passed / halflife) if halflife > 0 else 0.0 for halflife in (self.halflife, GAIT_HALFLIFE)
        )
        self._tilt = np.asarray(hands.move) + (self._tilt - hands.move) * left
        run = float(hands.run and not hands.crouch)
        self._gait = run + (self._gait - run) * slow
        self.camera_yaw = float(springs.wrap(self.camera_yaw + hands.turn * TURN * passed))
        one = from_stick(
            self._tilt,
            [self.camera_yaw],
            yaw=yaws[:1],
            last_yaw=[self._facing],
            camera_rate=[hands.turn * TURN],
            strafe=[hands.strafe],
            gait=[self._gait],
            speeds=self.speeds,
        )
        self._facing = float(one.yaw[0])
        one.crouch[:] = hands.crouch
        return _for_all(one, self._count)

    def remember(self) -> Any:
        return self.camera_yaw, self._facing, self._tilt, self._gait, self._time

    def recall(self, remembered: Any) -> None:
        self.camera_yaw, self._facing, self._tilt, self._gait, self._time = remembered


class Again:
    """Asks of N characters what one was asked in an earlier run; when that ends, to stand.

    A `viewer.session.Pilot`; they start where that one stood at its first frame.
    """

    def __init__(self, recording: Recording, count: int = 1, *, character: int = 0) -> None:
        self._velocity = np.asarray(recording["command_velocity"][:, character])
        self._yaw = np.asarray(recording["command_yaw"][:, character])
        self._crouch = np.zeros(len(recording), bool)
        if "command_crouch" in recording.arrays:
            self._crouch = np.asarray(recording["command_crouch"][:, character])
        self._fps, self._count = recording.fps, count
        positions, yaws = recording.roots()
        self.starts = np.tile(positions[0, character], (count, 1)).astype(np.float32)
        self.yaws = np.full(count, yaws[0, character], np.float32)

    @property
    def seconds(self) -> float:
        """How long the run lasts."""
        return len(self._yaw) / self._fps

    def reset(self) -> None:
        pass

    def command(self, time: float, positions: NDArray, yaws: NDArray) -> Command:
        row = min(max(int(time * self._fps + 1e-6), 0), len(self._yaw) - 1)
        velocity = self._velocity[row] if time < self.seconds else np.zeros(2)
        one = from_velocity(velocity, last_yaw=self._yaw[row])
        one.yaw[:], one.crouch[:] = self._yaw[row], self._crouch[row]
        return _for_all(one, self._count)

    def remember(self) -> Any:
        return None  # all follows from the time

    def recall(self, remembered: Any) -> None:
        pass


def on_course(course: Course, count: int = 1, fps: float = 60.0) -> Driver:
    """Whoever drives N characters over a course without an end: a closed way or a script again and again."""
    if course.closed or not course.waypoints:
        course = replace(course, laps=max(course.laps, LAPS), seconds=course.seconds)
    return Driver(course, count, fps)


def speeds_of(description: Description) -> Speeds:
    """Speeds of a stick at full tilt at those of the data, ahead, aside and back in the usual proportions."""
    usual, walk, run = Speeds(), description.walk_mps, description.run_mps
    if not walk > 0:
        return usual
    return usual.scaled(walk / usual.walk[0], (run or walk) / usual.run[0])


def _for_all(one: Command, count: int) -> Command:
    rows = np.zeros(count, np.int64)
    return Command(*(getattr(one, part.name)[rows] for part in fields(Command)))
