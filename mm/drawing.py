"""Pictures of courses."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import files, springs

from .course import Course
from .driver import Driver
from .settings import Settings

RATE = 60.0
MOST_SECONDS = 600.0


def follow(course: Course, settings: Settings | None = None) -> dict[str, NDArray]:
    """How an object that follows the commands by springs, as a simulated character does, takes a course.

    It walks through obstacles.

    Returns times [T], positions [T, 2], yaws [T], speeds [T] and the speeds asked for, asked [T].
    """
    settings = settings or Settings()
    driver = Driver(course, 1, RATE)
    position, yaw = driver.starts.astype(np.float64), driver.yaws.astype(np.float64)
    velocity, acceleration, turning = np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1)
    rows = []
    for frame in range(min(driver.frames, round(MOST_SECONDS * RATE))):
        command = driver.command(frame / RATE, position, yaw)
        position, velocity, acceleration = springs.simulate(
            position, velocity, acceleration, command.velocity, settings.velocity_halflife, 1 / RATE
        )
        goal = yaw + springs.wrap(command.yaw - yaw)
        yaw, turning = springs.damp(yaw, turning, goal, settings.rotation_halflife, 1 / RATE)
        speeds = (np.hypot(*velocity[0]), np.hypot(*command.velocity[0]))
        rows.append((frame / RATE, *position[0], yaw[0], *speeds))
        if driver.done:
            break
    table = np.array(rows)
    return {
        "times": table[:, 0],
        "positions": table[:, 1:3],
        "yaws": table[:, 3],
        "speeds": table[:, 4],
        "asked": table[:, 5],
    }


def draw(course: Course, path: str | os.PathLike[str]) -> None:
    """Write a PNG: the ground from above (+Z up, +X to the left), and speed and facing over time."""
    from matplotlib.figure import Figure

    trace = follow(course)
    figure = Figure(figsize=(12, 6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1))
    ground, speed, facing = (figure.add_subplot(part) for part in (grid[:, 0], grid[0, 1], grid[1, 1]))
    figure.suptitle(f"{course.name}: {course.description}", fontsize=10, wrap=True)
    _draw_ground(ground, course, trace)
    times = trace["times"]
    speed.plot(times, trace["asked"], "k", lw=1, label="asked")
    speed.plot(times, trace["speeds"], lw=1.5, label="followed")
    speed.set(ylabel="speed, m/s", ylim=(0, 1.1 * max(trace["asked"].max(), 0.1)))
    speed.legend(loc="lower right", fontsize=8)
    facing.plot(times, np.degrees(np.unwrap(trace["yaws"])), lw=1.5)
    facing.set(xlabel="seconds", ylabel="facing, degrees (+ left)")
    for axes in (speed, facing):
        axes.grid(alpha=0.3)
    with files.atomic(path) as stream:
        figure.savefig(stream, format="png", dpi=100)


def _draw_ground(axes: Any, course: Course, trace: dict[str, NDArray]) -> None:
    from matplotlib.patches import Circle, Rectangle

    for c in course.circles:
        axes.add_patch(Circle(c.center, c.radius, color="0.7"))
    for b in course.boxes:
        corner = (b.center[0] - b.size[0] / 2, b.center[1] - b.size[1] / 2)
        axes.add_patch(Rectangle(corner, *b.size, color="0.7"))
    path = Driver(course).path
    if path is not None:
        axes.plot(*path.T, "k--", lw=1)
    for i, waypoint in enumerate(() if course.smooth else course.waypoints):
        axes.add_patch(Circle(waypoint.position, waypoint.reach, fill=False, color="0.5", lw=0.5))
        note = f"{i}: {waypoint.gait} {waypoint.speed:.3g}"
        axes.annotate(note, waypoint.position, (4, 4), textcoords="offset points", fontsize=8)
    positions, yaws = trace["positions"], trace["yaws"]
    points = axes.scatter(*positions.T, c=trace["speeds"], s=3, vmin=0)
    some = np.linspace(0, len(yaws) - 1, 40).astype(int)
    # Arrows are drawn in the directions of the paper, where +X goes left.
    axes.quiver(*positions[some].T, -np.sin(yaws[some]), np.cos(yaws[some]), width=0.003)
    axes.plot(*positions[0], "o", color="tab:red", ms=5)
    axes.figure.colorbar(points, ax=axes, label="m/s", shrink=0.7)
    middle, half = (positions.max(0) + positions.min(0)) / 2, max(1.0, 0.55 * np.ptp(positions, axis=0).max())
    axes.set(xlim=(middle[0] + half, middle[0] - half), ylim=(middle[1] - half, middle[1] + half))
    axes.set(aspect="equal", xlabel="x, m (left)", ylabel="z, m")
    axes.grid(alpha=0.3)
