"""What a controller asks of the data, and what of that the data has: speed, direction and turn rate.

What is asked is told by an object that obeys: it follows the commands of a course through the controller's
springs, as the controller's simulated object does, whose future every query asks for. So it does not depend
on the data. Direction is the angle from the facing to the travel, left is positive; it means nothing at rest.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mm import metrics
from mm.control import Command
from mm.course import Course
from mm.database import Database
from mm.driving import Clock, at_data_speeds, drive
from mm.settings import Settings
from motion import figures, files, quat, springs
from motion.pose import Poses
from motion.skeleton import Skeleton

Array = NDArray[np.floating]

NEAR = (0.25, 22.5, 30.0)  # m/s, degrees, degrees a second: data within these is like what is asked
FILES = ("coverage.png", "holes.csv", "courses.csv")
AXES = ("speed", "direction", "turn")
CELL = (0.5, 45.0, 60.0)  # in which holes are told
SLOW = 0.25  # m/s below which a direction means nothing
FEW = 30  # frames near to what is asked, from which there is a choice
EVERY = 0.05  # seconds between two samples of what is asked
CROUCH = 0.85  # share of the usual height of the hips


class Obedient:
    """A system of one point a character that does what it is asked, as fast as the springs allow."""

    name = "obedient"
    skeleton = Skeleton(("root",), np.array([-1], np.int32), np.zeros((1, 3)), {"root": 0})

    def __init__(self, count: int, fps: float, settings: Settings | None = None) -> None:
        self.count, self.fps = count, fps
        self._settings = settings or Settings()
        self.reset(np.zeros((count, 2), np.float32), np.zeros(count, np.float32))

    def reset(self, positions: NDArray[np.float32], yaws: NDArray[np.float32]) -> None:
        """At positions [N, 2], facing yaws [N], at rest."""
        self.position = np.array(positions, np.float64)
        self.velocity, self.acceleration = np.zeros_like(self.position), np.zeros_like(self.position)
        self.yaw = np.array(yaws, np.float64)
        self.rate = np.zeros(self.count)

    def step(self, command: Command) -> Poses:
        dt, settings = 1 / self.fps, self._settings
        self.position, self.velocity, self.acceleration = springs.simulate(
            *(self.position, self.velocity, self.acceleration),
            *(command.velocity.astype(np.float64), settings.velocity_halflife, dt),
        )
        offset, self.rate = springs.decay(
            springs.wrap(self.yaw - command.yaw), self.rate, settings.rotation_halflife, dt
        )
        self.yaw = springs.wrap(offset + command.yaw)
        poses = Poses.empty(self.count, 1)
        poses.positions[:, 0, [0, 2]] = self.position
        poses.rotations[:, 0] = quat.from_yaw(self.yaw)
        return poses

    def record(self) -> dict[str, NDArray]:
        return {}

    def memory(self) -> dict[str, int]:
        return {}

    def state(self) -> Array:
        """What it does now, [N, 3]: speed m/s, direction degrees, turn degrees a second."""
        return states(self.velocity, self.yaw, self.rate)


def states(velocity: Array, yaw: Array, rate: Array) -> Array:
    """Speed m/s, direction and turn rate in degrees, [N, 3], of ground velocities [N, 2], yaws, rad/s."""
    speed = np.linalg.norm(velocity, axis=-1)
    direction = metrics.wrap(np.arctan2(velocity[:, 0], velocity[:, 1]) - yaw)
    return np.stack([speed, np.degrees(direction), np.degrees(rate)], axis=-1)


def asked(course: Course, fps: float, *, seconds: float, settings: Settings | None = None) -> Array:
    """What a course asks for over so many seconds at most, a sample each `EVERY`, [M, 3] (see `states`)."""
    clock = Clock(course, 1, fps)
    system = Obedient(1, fps, settings)
    frames = min(round(seconds * fps), clock.frames)
    every = max(1, round(EVERY * fps))
    rows = [system.state()[0] for frame in islice(drive(system, clock), frames) if frame % every == 0]
    return np.array(rows).reshape(-1, 3)


def frames_of(database: Database, settings: Settings | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """What each frame of a database does, [T, 3] (see `states`), and which a search may find, bool [T]."""
    settings = settings or Settings()
    velocity = np.asarray(database.poses.velocities[:, 0][:, [0, 2]], np.float64)
    yaw = quat.yaw(np.asarray(database.poses.rotations[:, 0], np.float64))
    rate = np.asarray(database.poses.angular_velocities[:, 0, 1], np.float64)
    findable = np.zeros(len(database), bool)
    for start, stop in zip(database.starts, database.stops, strict=True):
        findable[start : stop - round(settings.ignore_end * database.fps)] = True
    return states(velocity, yaw, rate), findable


@dataclass(eq=False)
class Coverage:
    """How much of what is asked the data has.

    Attributes
    ----------
    data : [T, 3] speed, direction and turn rate of the frames that a search may find.
    asked : [M, 3] of what the courses ask, a sample each `EVERY` seconds; course [M] the index of its course.
    nearest : [M] how far the nearest frame is, 1 at the bounds of `NEAR` (the largest of the three shares).
    enough : bool [M], whether few or more frames are within `NEAR`.
    closest : [M, 3] what the nearest frame does.
    courses : their names.
    low : share of the data's frames with the hips low; crouches, the courses that ask for a crouch.
    """

    data: Array
    asked: Array
    course: NDArray[np.int64]
    nearest: Array
    enough: NDArray[np.bool_]
    closest: Array
    courses: list[str]
    fps: float
    low: float
    crouches: list[str]

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Which samples have a frame near, bool [M]."""
        return self.nearest <= 1

    @property
    def share(self) -> float:
        """Share of what is asked that has data near."""
        return float(self.covered.mean())

    def by_course(self) -> list[dict[str, Any]]:
        """A row a course and one for all: seconds asked, shares of them with a frame near, with enough."""
        groups = [(name, self.course == i) for i, name in enumerate(self.courses)]
        groups.append(("all", np.ones(len(self.asked), bool)))
        return [
            {
                "course": name,
                "seconds": float(EVERY * those.sum()),
                "covered": float(self.covered[those].mean()),
                "with a choice": float(self.enough[those].mean()),
                "fastest m/s": float(self.asked[those, 0].max()),
                "turn °/s": float(np.abs(self.asked[those, 2]).max()),
            }
            for name, those in groups
            if those.any()
        ]

    def notes(self) -> list[str]:
        """What else a reader must know."""
        if not self.crouches or not np.isfinite(self.low):
            return []
        names = ", ".join(self.crouches)
        return [f"a crouch is asked for ({names}); the hips are low in {100 * self.low:.1f} % of the frames"]

    def holes(self, count: int | None = None) -> list[dict[str, Any]]:
        """What is asked and not there, in cells of `CELL`, the longest asked first."""
        missing = np.flatnonzero(~self.covered)
        cells = np.round(self.asked[missing] / CELL).astype(np.int64)
        cells[:, 1] %= round(360 / CELL[1])
        cells[self.asked[missing, 0] <= SLOW, 1] = -1  # no direction
        rows: list[dict[str, Any]] = []
        for cell in np.unique(cells, axis=0):
            those = missing[(cells == cell).all(axis=1)]
            # The sample in the middle speaks for the cell: a mean of angles would not.
            middle = those[np.argsort(self.nearest[those])[len(those) // 2]]
            has = self.closest[middle]
            rows.append(
                {
                    "seconds": float(EVERY * len(those)),
                    "speed m/s": float(self.asked[middle, 0]),
                    "direction °": float(self.asked[middle, 1]) if cell[1] >= 0 else None,
                    "turn °/s": float(self.asked[middle, 2]),
                    "distance": float(self.nearest[middle]),
                    "nearest m/s": float(has[0]),
                    "nearest °": float(has[1]),
                    "nearest °/s": float(has[2]),
                    "courses": ", ".join(self.courses[i] for i in np.unique(self.course[those])),
                }
            )
        rows.sort(key=lambda row: -row["seconds"])
        return rows[:count]


def measure(
    database: Database,
    courses: Sequence[Course],
    *,
    seconds: float = 60.0,
    scale: bool = True,
    few: int = FEW,
    settings: Settings | None = None,
) -> Coverage:
    """Coverage of what courses ask by a database.

    seconds of each course at most; scale brings their speeds to the data's, as a comparison of systems does.
    """
    if scale:
        courses = [at_data_speeds(course, database) for course in courses]
    parts = [asked(course, database.fps, seconds=seconds, settings=settings) for course in courses]
    wanted = np.concatenate(parts)
    states_, findable = frames_of(database, settings)
    data = states_[findable]
    nearest, enough, closest = near(data, wanted, few)
    return Coverage(
        data=data,
        asked=wanted,
        course=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
        nearest=nearest,
        enough=enough,
        closest=closest,
        courses=[course.name for course in courses],
        fps=database.fps,
        low=_low(database),
        crouches=[course.name for course in courses if _crouches(course)],
    )


def _crouches(course: Course) -> bool:
    gaits = {key.gait for key in course.waypoints} | {key.gait for key in course.velocity}
    return "crouch" in gaits | {key.gait for key in course.script()}


def near(data: Array, wanted: Array, few: int = FEW) -> tuple[Array, NDArray[np.bool_], Array]:
    """The nearest of data [T, 3] to each of wanted [M, 3]: distance [M], whether few are near [M], it [M, 3].

    The distance is the largest of the three differences, each as a share of `NEAR`; directions go round and
    do not count where what is wanted is slower than `SLOW`. Infinite, and NaN, without data.
    """
    from scipy.spatial import cKDTree

    distance, enough = np.full(len(wanted), np.inf), np.zeros(len(wanted), bool)
    closest = np.full((len(wanted), 3), np.nan)
    if len(data) == 0:
        return distance, enough, closest
    slow = wanted[:, 0] <= SLOW
    few = min(few, len(data))
    for those, axes in ((slow, [0, 2]), (~slow, [0, 1, 2])):
        if those.any():
            unit = np.array(NEAR)[axes]
            period = np.where(np.array(axes) == 1, 360 / NEAR[1], 0.0)
            here, there = (_round(values[:, axes] / unit, period) for values in (data, wanted[those]))
            tree = cKDTree(here, boxsize=period)
            far, which = tree.query(there, k=sorted({1, few}), p=np.inf)
            distance[those], enough[those] = far[:, 0], far[:, -1] <= 1
            closest[those] = data[which[:, 0]]
    return distance, enough, closest


def _round(values: Array, period: Array) -> Array:
    """Values [N, A] brought into [0, period) on the axes that have one."""
    for axis in np.flatnonzero(period):
        values[:, axis] %= period[axis]
        values[values[:, axis] >= period[axis], axis] = 0  # a tiny negative number rounds up to the period
    return values


def _low(database: Database) -> float:
    """Share of frames with the hips below `CROUCH` of their usual height; NaN without hips."""
    hips = database.skeleton.roles.get("hips")
    if not hips:
        return float("nan")
    chain = database.skeleton.chain(hips)[1:]
    heights = database.poses.positions[:, chain, 1].sum(axis=1)
    return float((heights < CROUCH * np.percentile(heights, 75)).mean())


def figure(coverage: Coverage, title: str = "") -> Any:
    """Heat maps by speed and direction, speed and turn rate, turn rate and direction.

    Above, seconds of data; below, how much of what is asked there has data near, pale where little is asked.
    """
    from matplotlib.figure import Figure

    edges, names = _edges(coverage), ("speed, m/s", "direction, left > 0, °", "turn rate, left > 0, °/s")
    picture = Figure(figsize=(16, 9.4))
    grid = picture.subplots(2, 3)
    picture.subplots_adjust(0.04, 0.06, 1.0, 0.89, wspace=0.1, hspace=0.26)
    for column, (x, y) in enumerate(((1, 0), (2, 0), (1, 2))):
        _draw_data(picture, grid[0, column], coverage, edges, x, y)
        _draw_asked(picture, grid[1, column], coverage, edges, x, y)
        for axes in grid[:, column]:
            axes.set_xlabel(names[x])
            axes.set_ylabel(names[y], labelpad=1)
            axes.set_xlim(edges[x][0], edges[x][-1])
            axes.set_ylim(edges[y][0], edges[y][-1])
            if x == 1:
                axes.set_xticks(range(-180, 181, 45))
            axes.set_facecolor("#8882")
            axes.grid(True, color="#8884", linewidth=0.5)
    within = ", ".join(f"{n:g} {u}" for n, u in zip(NEAR, ("m/s", "°", "°/s"), strict=True))
    share = f"{100 * coverage.share:.1f} % of what the courses ask has data within {within}"
    picture.suptitle(f"{title}: {share}", x=0.01, ha="left")
    return picture


def _edges(coverage: Coverage) -> list[Array]:
    """Edges of the heat maps' cells on the three axes."""
    data, wanted = coverage.data, coverage.asked
    fastest = max(float(wanted[:, 0].max()), float(np.percentile(data[:, 0], 99.5)), 1.0)
    turns = np.ceil(np.clip(np.abs(np.concatenate([wanted[:, 2], data[:, 2]])).max(), 90, 400) / 30)
    return [
        np.arange(0, fastest + 0.25, 0.25),
        np.arange(-191.25, 192, 22.5),
        np.arange(-30 * turns - 15, 30 * turns + 16, 30.0),
    ]


def _draw_data(picture: Any, axes: Any, coverage: Coverage, edges: list[Array], x: int, y: int) -> None:
    from matplotlib.colors import LogNorm

    data = _directed(coverage.data, x)
    counts, _, _ = np.histogram2d(data[:, x], data[:, y], (edges[x], edges[y]))
    seconds = np.ma.masked_equal(counts.T / coverage.fps, 0)
    most = max(float(seconds.max()) if seconds.count() else 0.0, 0.2)
    mesh = axes.pcolormesh(
        edges[x], edges[y], seconds, norm=LogNorm(0.1, most), cmap="viridis", rasterized=True
    )
    picture.colorbar(mesh, ax=axes, pad=0.01)
    axes.set_title("data, seconds", loc="left", fontsize=10)


def _draw_asked(picture: Any, axes: Any, coverage: Coverage, edges: list[Array], x: int, y: int) -> None:
    rows = _directed(np.column_stack([coverage.asked, coverage.covered]), x)
    total, _, _ = np.histogram2d(rows[:, x], rows[:, y], (edges[x], edges[y]))
    found, _, _ = np.histogram2d(rows[:, x], rows[:, y], (edges[x], edges[y]), weights=rows[:, 3])
    share = np.ma.masked_where(total.T == 0, 100 * found.T / np.maximum(total.T, 1))
    strength = np.clip(0.35 + 0.65 * EVERY * total.T, 0, 1)  # a second and more in full colour
    colours: Any = {"vmin": 0, "vmax": 100, "cmap": "RdYlGn", "alpha": strength}
    mesh = axes.pcolormesh(edges[x], edges[y], share, rasterized=True, **colours)
    picture.colorbar(mesh, ax=axes, pad=0.01).solids.set_alpha(1)
    axes.set_title("asked, % that has data near (pale: under a second)", loc="left", fontsize=10)


def _directed(rows: Array, x: int) -> Array:
    """Rows that have a direction, where that is what is drawn."""
    return rows[rows[:, 0] > SLOW] if x == 1 else rows


def save(coverage: Coverage, folder: Path, name: str) -> list[Path]:
    """Write `FILES` into a folder."""
    tables = {"holes.csv": coverage.holes(), "courses.csv": coverage.by_course()}
    with contextlib.ExitStack() as stack:
        for file, rows in tables.items():
            stream = stack.enter_context(files.atomic(folder / file, "w"))
            stream.write(pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))
            stream.flush()
        stack.enter_context(files.atomic(folder / "coverage.png")).write(figures.png(figure(coverage, name)))
    return [folder / file for file in FILES]


def to_json(coverage: Coverage) -> dict[str, Any]:
    """All of it as plain data; None instead of what is not a number."""
    low = coverage.low if np.isfinite(coverage.low) else None
    holes = [
        {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in row.items()
        }
        for row in coverage.holes()
    ]
    within = dict(zip(AXES, NEAR, strict=True))
    return {
        "covered": coverage.share,
        "within": within,
        "courses": coverage.by_course(),
        "holes": holes,
        "low_hips_share": low,
        "notes": coverage.notes(),
    }
