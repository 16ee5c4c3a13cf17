"""What a character is asked over a stretch of time: waypoints, a stick's script, a velocity's script.

What a user once did is a script, too (`mm.recorded`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from motion import config
from motion.config import ConfigError
from motion.errors import UserError

from .speeds import Speeds

Vector = tuple[float, float]
FAR = 1e5  # metres, seconds, degrees a second: beyond it 32-bit numbers lose the millimetres
Gait = Literal["walk", "run", "crouch"]


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A place to go to. Speed, gait and facing hold on the way to it.

    Attributes
    ----------
    position : x, z, metres.
    speed : m/s.
    gait : walk, run or crouch; which of the data's speeds `Course.scaled` puts in place of speed.
    facing : x, z direction to face on the way (to strafe); None faces the way.
    radius : metres within which it counts as reached; None is 0.35 s of speed, at least 0.3 m.
    """

    position: Vector
    speed: float
    gait: Gait = "walk"
    facing: Vector | None = None
    radius: float | None = None

    def __post_init__(self) -> None:
        _check(self, positive=("speed", "radius"))
        _check_direction(self.facing)

    @property
    def reach(self) -> float:
        """Radius in force, metres."""
        return self.radius if self.radius is not None else max(0.3, 0.35 * self.speed)


@dataclass(frozen=True, kw_only=True)
class StickKey:
    """The stick and the camera from a time on (see `mm.commands.from_stick`).

    Attributes
    ----------
    time : seconds.
    move : tilt x (right), z (away from the camera), in [-1, 1].
    camera_deg : where the camera looks, degrees; None: where it has turned to until now.
    camera_rate_deg : degrees a second at which the camera turns from now on.
    strafe : face where the camera looks.
    gait : walk, run or crouch; a crouch goes at walking speeds.
    """

    time: float
    move: Vector = (0.0, 0.0)
    camera_deg: float | None = None
    camera_rate_deg: float = 0.0
    strafe: bool = False
    gait: Gait = "walk"

    def __post_init__(self) -> None:
        _check(self)
        if max(map(abs, self.move)) > 1:
            raise ConfigError("move", f"tilt {list(self.move)}", remedy="give two numbers from -1 to 1")


@dataclass(frozen=True, kw_only=True)
class VelocityKey:
    """The velocity asked for from a time on.

    Attributes
    ----------
    time : seconds.
    velocity : x, z, m/s.
    gait : which of the data's speeds `Course.scaled` scales it by.
    facing : x, z direction to face; None faces the way, and keeps the last facing at rest.
    """

    time: float
    velocity: Vector
    gait: Gait = "walk"
    facing: Vector | None = None

    def __post_init__(self) -> None:
        _check(self)
        _check_direction(self.facing)

    @property
    def speed(self) -> float:
        return math.hypot(*self.velocity)


@dataclass(frozen=True, kw_only=True)
class RandomUser:
    """A user who plays about with stick and camera.

    Attributes
    ----------
    seed : same seed, same user.
    hold : shortest and longest time between two changes, seconds.
    run, strafe, stop : shares of the changes that run, strafe and let go of the stick.
    crouch : share of the changes that crouch, running or not.
    camera_rate_deg : fastest turn of the camera, degrees a second.
    """

    seed: int = 0
    hold: Vector = (0.4, 3.0)
    run: float = 0.4
    strafe: float = 0.2
    stop: float = 0.15
    crouch: float = 0.0
    camera_rate_deg: float = 60.0

    def __post_init__(self) -> None:
        _check(self)
        if self.seed < 0:
            raise ConfigError("seed", f"{self.seed}", remedy="give a whole number of at least 0")
        if not 0.05 <= self.hold[0] <= self.hold[1]:
            raise ConfigError(
                "hold", f"times {list(self.hold)}", remedy="give the shorter one first, at least 0.05"
            )
        for name in ("run", "strafe", "stop", "crouch"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(name, f"share {getattr(self, name)}", remedy="give a number from 0 to 1")

    def keys(self, seconds: float) -> tuple[StickKey, ...]:
        """A stick script of that length."""
        rng = np.random.default_rng(self.seed)
        keys, time = [], 0.0
        while time < seconds:
            angle, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 1.0)
            if rng.random() < self.stop:
                tilt = 0.0
            key = StickKey(
                time=time,
                move=(tilt * math.sin(angle), tilt * math.cos(angle)),
                camera_rate_deg=self.camera_rate_deg * rng.uniform(-1, 1) * (rng.random() < 0.5),
                strafe=bool(rng.random() < self.strafe),
                gait="run" if rng.random() < self.run else "walk",
            )
            if self.crouch and rng.random() < self.crouch:  # who never crouches draws no number for it
                key = replace(key, gait="crouch")
            keys.append(key)
            time += rng.uniform(*self.hold)
        return tuple(keys)


@dataclass(frozen=True, kw_only=True)
class Circle:
    """A round obstacle: center x, z and radius, metres."""

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        _check(self, positive=("radius",))


@dataclass(frozen=True, kw_only=True)
class Box:
    """A box-shaped obstacle: center x, z and full size along x, z, metres."""

    center: Vector
    size: Vector

    def __post_init__(self) -> None:
        _check(self)
        if min(self.size) <= 0:
            raise ConfigError("size", f"{list(self.size)}", remedy="give two numbers above 0")


@dataclass(frozen=True, kw_only=True)
class Course:
    """Exactly one of waypoints, stick, velocity and random, and what surrounds it.

    Attributes
    ----------
    waypoints : at least two; the first is the start.
    closed : the way leads from the last waypoint back to the first, which ends a lap.
    smooth : waypoints are joined by a cubic spline, else by straight lines.
    corner_speed : share of the speed that is left at a turn on the spot; turns below 45 degrees keep all.
        Smooth ways are not slowed.
    stick, velocity : keys at rising times, the first at 0.
    speeds : what the stick's full tilt means.
    interpolate : velocities and tilts hold until the next key, or go there linearly.
    laps : rounds of a closed way, or times that a script is played.
    seconds : length of a script; laps of a way take at most as long.
    start, facing : where characters start, x, z, and the direction they face; None: at the first waypoint and
        along the way, or at the origin and along +Z.
    circles, boxes : obstacles.
    size : by how much lengths of the way should be multiplied when speeds are scaled to data.
    scale : what was multiplied already, empty where nothing was: walk, run, size.
    """

    name: str = ""
    description: str = ""
    waypoints: tuple[Waypoint, ...] = ()
    closed: bool = False
    smooth: bool = False
    corner_speed: float = 0.4
    stick: tuple[StickKey, ...] = ()
    velocity: tuple[VelocityKey, ...] = ()
    random: RandomUser | None = None
    speeds: Speeds = field(default_factory=Speeds)
    interpolate: Literal["hold", "linear"] = "hold"
    laps: int = 1
    seconds: float | None = None
    start: Vector | None = None
    facing: Vector | None = None
    circles: tuple[Circle, ...] = ()
    boxes: tuple[Box, ...] = ()
    size: float = 1.0
    scale: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self, positive=("seconds", "size"))
        _check_direction(self.facing)
        limits = {"seconds": (self.seconds or 0, 86_400), "laps": (self.laps, 10_000)}
        limits |= {name: (len(getattr(self, name)), 1_000) for name in ("waypoints", "circles", "boxes")}
        limits |= {name: (len(getattr(self, name)), 100_000) for name in ("stick", "velocity")}
        for name, (value, most) in limits.items():
            if value > most:
                raise ConfigError(name, f"{value:,g}", remedy=f"at most {most:,}")
        if not 0 < self.corner_speed <= 1:
            raise ConfigError(
                "corner_speed", f"share {self.corner_speed}", remedy="give a number above 0, at most 1"
            )
        if self.laps < 1:
            raise ConfigError("laps", f"{self.laps}", remedy="give a whole number of at least 1")
        kinds = [k for k in ("waypoints", "stick", "velocity", "random") if getattr(self, k)]
        if len(kinds) != 1:
            raise ConfigError(
                (),
                f"a course of {' and '.join(kinds) or 'nothing'}",
                remedy="give one of waypoints, stick, velocity and random, not empty",
            )
        if self.waypoints:
            self._check_waypoints()
            return
        if self.seconds is None:
            raise ConfigError("seconds", "missing key", remedy="say how long the script is")
        for kind in ("stick", "velocity"):
            times = [key.time for key in getattr(self, kind)]
            if times and times[0] != 0:
                raise ConfigError((kind, 0, "time"), f"{times[0]}", remedy="the first key's time is 0")
            for i in range(1, len(times)):
                if times[i] <= times[i - 1]:
                    raise ConfigError(
                        (kind, i, "time"), f"{times[i]} after {times[i - 1]}", remedy="times rise"
                    )

    def _check_waypoints(self) -> None:
        least = 3 if self.closed and self.smooth else 2
        if len(self.waypoints) < least:
            raise ConfigError("waypoints", f"{len(self.waypoints)} of them", remedy=f"give at least {least}")
        if not self.closed and self.laps > 1:
            raise ConfigError("laps", f"{self.laps} on an open way", remedy="set closed = true")
        for i, waypoint in enumerate(self.waypoints):
            after = self.waypoints[(i + 1) % len(self.waypoints)]
            last = i + 1 == len(self.waypoints)
            if math.dist(waypoint.position, after.position) < 1e-3 and (self.closed or not last):
                remedy = "closed = true leads back by itself" if last else "leave one out"
                raise ConfigError(("waypoints", i), "in the same place as the next", remedy=remedy)

    def script(self) -> tuple[StickKey, ...]:
        """The stick's keys, those of a random user spelt out."""
        return self.random.keys(self.seconds or 0) if self.random else self.stick

    def obstacles(self) -> NDArray[np.float32]:
        """Obstacles [M, 5] for a controller: center x, z, half sizes x, z, radius of the rounding."""
        rows = [(*c.center, 0.0, 0.0, c.radius) for c in self.circles]
        rows += [(*b.center, b.size[0] / 2, b.size[1] / 2, 0.0) for b in self.boxes]
        return np.array(rows, np.float32).reshape(-1, 5)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; `config.from_dict(Course, data)` reads it back."""
        return config.to_dict(self)

    def scaled(
        self,
        *,
        walk: float | None = None,
        run: float | None = None,
        size: float | None = None,
        max_speed: float | None = None,
    ) -> Course:
        """The same course at the speeds that some data has.

        The fastest walking key goes at walk (m/s), the fastest running one at run, others in proportion; a
        stick's full tilt forward goes at them. A crouch is slowed as a walk is. One of the two left out is
        taken from the other; with both left out speeds stay. Lengths of a way, obstacles and the start are
        multiplied by size, which is the course's own `size` when speeds are scaled and 1 when not. Then
        everything faster than max_speed is slowed to it. The description and `scale` say what was done.
        """
        for name, value in (("walk", walk), ("run", run), ("size", size), ("max_speed", max_speed)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UserError(
                    f"cannot scale course {self.name!r} to {name} {value}", remedy="give a number above 0"
                )
        scaling = walk is not None or run is not None
        size = size if size is not None else self.size if scaling else 1.0
        walk, run = walk or run, run or walk
        factors = {gait: self._factor(gait, speed) for gait, speed in (("walk", walk), ("run", run))}
        factors["crouch"] = factors["walk"]
        cap = max_speed or math.inf

        def speed_of(key: Waypoint | VelocityKey) -> float:
            return min(key.speed * factors[key.gait], cap)

        def place(point: Vector) -> Vector:
            return point[0] * size, point[1] * size

        def slowed(key: VelocityKey) -> VelocityKey:
            share = speed_of(key) / key.speed if key.speed else 1.0
            return replace(key, velocity=(key.velocity[0] * share, key.velocity[1] * share))

        speeds = self.speeds.scaled(factors["walk"], factors["run"])
        capped = Speeds(*(tuple(min(v, cap) for v in triple) for triple in (speeds.walk, speeds.run)))  # type: ignore
        scale = {
            "walk": factors["walk"] * self.scale.get("walk", 1.0),
            "run": factors["run"] * self.scale.get("run", 1.0),
            "size": size * self.scale.get("size", 1.0),
        }
        return replace(
            self,
            waypoints=tuple(
                replace(w, position=place(w.position), speed=speed_of(w), radius=w.radius and w.radius * size)
                for w in self.waypoints
            ),
            velocity=tuple(map(slowed, self.velocity)),
            speeds=capped,
            start=self.start and place(self.start),
            circles=tuple(replace(c, center=place(c.center), radius=c.radius * size) for c in self.circles),
            boxes=tuple(replace(b, center=place(b.center), size=place(b.size)) for b in self.boxes),
            size=1.0 if scaling or size != 1 else self.size,
            scale=scale,
            description=f"{self.description.split(' [', 1)[0]} [{_describe_scale(scale, cap)}]".strip(),
        )

    def _factor(self, gait: str, speed: float | None) -> float:
        """What turns this course's own speed of a gait into speed."""
        if speed is None:
            return 1.0
        if self.stick or self.random:
            full = (self.speeds.walk if gait == "walk" else self.speeds.run)[0]
            return speed / full if full > 0 else 1.0
        keys: tuple[Waypoint | VelocityKey, ...] = (*self.waypoints, *self.velocity)
        own = [k.speed for k in keys if k.gait == gait] or [
            k.speed for k in keys if k.gait == "crouch" and gait == "walk"
        ]
        return speed / max(own) if own and max(own) > 0 else 1.0


def _describe_scale(scale: Mapping[str, float], cap: float) -> str:
    parts = f"walk x {scale['walk']:.3g}, run x {scale['run']:.3g}, lengths x {scale['size']:.3g}"
    return f"scaled: {parts}" + (f", at most {cap:.3g} m/s" if math.isfinite(cap) else "")


def _check(obj: Any, *, positive: tuple[str, ...] = ()) -> None:
    """Types, finite numbers, and numbers of at least 0."""
    config.validate(obj)
    for name, value in vars(obj).items():
        numbers = value if isinstance(value, tuple) else (value,)
        if any(isinstance(v, float) and not math.isfinite(v) for v in numbers):
            raise ConfigError(name, f"{value} is not finite", remedy="give finite numbers")
        if any(isinstance(v, float) and abs(v) > FAR for v in numbers):
            raise ConfigError(name, f"{value} is out of range", remedy=f"give numbers up to {FAR:,.0f}")
        if name in positive and value is not None and value <= 0:
            raise ConfigError(name, f"{value} is not above 0", remedy="give a number above 0")
    if getattr(obj, "time", 0) < 0:
        raise ConfigError("time", f"{obj.time} is negative", remedy="times begin at 0")


def _check_direction(facing: Vector | None) -> None:
    if facing is not None and math.hypot(*facing) < 1e-6:
        raise ConfigError("facing", "a direction of length 0", remedy="give x, z of where to face")
