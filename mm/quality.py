"""How well a recorded walk was done: one row of metrics, and what its plots need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.contacts import SHORT, heel
from features.terrain import Ground, flat
from motion import contacts, kinematics, quat
from motion.skeleton import Skeleton

from . import metrics

Array = NDArray[np.floating]

STRIP_POSES = 14
SAMPLED_FRAMES, HEEL_FRAMES = 30_000, 2_000


@dataclass(frozen=True, eq=False)
class Feet:
    """What touches the ground, left first (`motion.contacts.touching_points`), and how high it rests.

    heels : the same of the heels behind it; a foot without one, as a paw, is its own heel. Heels have none.
    """

    joints: list[int]
    points: Array
    rest: Array
    heels: Feet | None = None

    @staticmethod
    def of(database: Any) -> Feet:
        """The contact joints of a database; heights from up to 30,000 of its frames (`resting_heights`)."""
        joints, points = contacts.touching_points(database.skeleton, database.contact_roles)
        frames = np.linspace(0, len(database) - 1, min(len(database), SAMPLED_FRAMES)).astype(np.int64)
        poses = database.poses[frames]
        world = world_transforms(database.skeleton, poses.positions, poses.rotations)
        speed = np.linalg.norm(poses.velocities[:, 0][:, [0, 2]], axis=-1)

        def resting(joints: list[int], points: Array) -> tuple[list[int], Array, Array]:
            touches = contacts.place_points(*world, joints, points)
            return joints, points, metrics.resting_heights(touches, database.contacts[frames], speed)

        return Feet(*resting(joints, points), Feet(*resting(*_heels(database, joints, points))))

    def place(self, world: Array, turned: Array) -> Array:
        """World positions [..., C, 3] of what touches, by the joints' world transforms [..., J, ..]."""
        return contacts.place_points(world, turned, self.joints, self.points)


def _heels(database: Any, joints: list[int], points: Array) -> tuple[list[int], Array]:
    """Joints [C] and points in their frames [C, 3] of the heels behind what touches the ground."""
    joints, points, skeleton = list(joints), np.array(points), database.skeleton
    frames = np.unique(np.linspace(0, len(database) - 1, HEEL_FRAMES).astype(np.int64))
    arrays = database.poses[frames].arrays().values()
    places, turns, velocities, spins = kinematics.forward_velocities(
        skeleton, *(np.asarray(array, np.float64) for array in arrays)
    )
    fours = any(role.endswith("hand") for role in database.contact_roles)
    for c, role in enumerate(database.contact_roles):
        side, _, part = role.partition("_")
        foot, touching = skeleton.roles.get(f"{side}_foot"), joints[c]
        if foot is None or not (part == "toe" or (part == "foot" and not fours)):
            continue
        arm = quat.rotate(turns[:, touching], points[c])
        tip, moved = places[:, touching] + arm, velocities[:, touching] + np.cross(spins[:, touching], arm)
        if np.linalg.norm(tip - places[:, foot], axis=-1).mean() > SHORT:
            speed = sum(np.linalg.norm(each, axis=-1) for each in (velocities[:, foot], moved))
            joints[c], points[c] = foot, heel(places[:, foot], turns[:, foot], tip, np.asarray(speed))
    return joints, points


def world_transforms(skeleton: Skeleton, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """World positions [..., J, 3] and rotations [..., J, 4] of local transforms, float64."""
    return kinematics.forward(skeleton, np.asarray(positions, np.float64), np.asarray(rotations, np.float64))


def in_root_space(skeleton: Skeleton, positions: Array, rotations: Array) -> Array:
    """Positions [..., J-1, 3] of all joints but the ground root, in the ground root's space."""
    positions, rotations = np.array(positions, np.float64), np.array(rotations, np.float64)
    positions[..., 0, :], rotations[..., 0, :] = 0, [1, 0, 0, 0]
    return kinematics.forward(skeleton, positions, rotations)[0][..., 1:, :]


@dataclass(eq=False)
class Trace:
    """What the plots show of one system on one course: the first character.

    path [P, 2] is what was commanded (None: only velocities were), asked [T, 2] where obeying the velocities
    to the letter would have led; walked [T, 2]; speeds [T] in m/s; skate [T-1] in cm/s, the mean of the feet
    over half a second; poses [S, J, 3] world positions at the frames of the film strip, low [S, C] which
    feet rest on the ground.
    """

    system: str
    course: str
    fps: float
    path: Array | None
    asked: Array
    walked: Array
    asked_speed: Array
    speed: Array
    skate: Array
    skeleton: Skeleton
    frames: NDArray[np.int64]
    poses: Array
    yaws: Array
    low: NDArray[np.bool_]

    def same(self, other: Trace, *, poses: bool = True) -> bool:
        """Whether two systems did the very same: the way they went, and also their poses."""
        names = ("walked", "poses", "skate") if poses else ("walked",)
        return self.course == other.course and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )


def judge(
    arrays: Mapping[str, NDArray],
    skeleton: Skeleton,
    fps: float,
    feet: Feet,
    path: Array | None,
    *,
    system: str = "",
    course: str = "",
    ground: Ground | None = None,
) -> tuple[dict[str, float], Trace]:
    """Metrics and trace of a recording's arrays [T, N, ...] (see `mm.recording`); path [P, 2] or None.

    Without transitions, which not all systems have, the metrics of them are NaN. On a ground heights of feet
    are those over it, and how feet stand on it is told, too; ways and speeds are those of the plane.
    """
    world, turned = world_transforms(skeleton, arrays["positions"], arrays["rotations"])
    root = world[:, :, 0][..., [0, 2]]
    yaws = quat.yaw(np.asarray(arrays["rotations"][:, :, 0], np.float64))
    asked = np.asarray(arrays["command_velocity"], np.float64)
    jumps = arrays.get("transition")
    transition = np.zeros(world.shape[:2], bool) if jumps is None else np.asarray(jumps, bool)
    stood, standing = _of_feet(feet, world, turned, fps, arrays.get("contacts"), ground)
    local = in_root_space(skeleton, arrays["positions"], arrays["rotations"])
    pops = metrics.pops(local)
    errors = metrics.trajectory_error(root, yaws, arrays["command_yaw"], path)
    response = metrics.responsiveness(asked, arrays["command_yaw"], root, yaws, fps)
    row = {
        **stood,
        "path_cm": errors.mean_cm,
        "path_p95_cm": errors.p95_cm,
        "path_max_cm": errors.max_cm,
        "heading_deg": errors.heading_deg,
        "speed_response_s": response.speed_s,
        "heading_response_s": response.heading_s,
        "response_steps": float(response.speed_steps + response.heading_steps),
        "unanswered_share": 1 - response.answered,
        "jerk_m_s3": metrics.jerk(world, fps),
        "pop_cm": metrics.largest_pop(local, transition),
        "ordinary_pop_cm": float(np.percentile(pops[~transition], 99))
        if (~transition).any()
        else float("nan"),
        "transitions_per_s": float("nan") if jumps is None else float(transition.mean() * fps),
        "speed_mps": float(metrics.root_speed(root, fps).mean()),
        "speed_ratio": metrics.speed_ratio(root, asked, fps),
        "stall_s": metrics.longest_stall(standing, root, asked, fps),
    }
    skate = metrics.skate(standing, fps, feet.rest)[:, 0]
    skate = skate.mean(axis=-1) if feet.joints else np.full(len(skate), np.nan)
    frames = np.linspace(0, len(world) - 1, min(STRIP_POSES, len(world))).astype(np.int64)
    trace = Trace(
        system,
        course,
        fps,
        path,
        metrics.command_path(asked[:, 0], root[0, 0], fps),
        root[:, 0],
        np.linalg.norm(asked[:, 0], axis=-1),
        metrics.root_speed(root[:, 0], fps),
        metrics.smooth(skate, fps, 0.5),
        skeleton,
        frames,
        world[frames, 0],
        yaws[frames, 0],
        standing[frames, 0, :, 1] - feet.rest < metrics.SKATE_HEIGHT,
    )
    return row, trace


def _of_feet(
    feet: Feet, world: Array, turned: Array, fps: float, planted: NDArray | None, ground: Ground | None
) -> tuple[dict[str, float], Array]:
    """Metrics of feet by world transforms [T, ..., J, ..], and what touches [T, ..., C, 3], over the ground.

    planted [T, ..., C] are the feet that are to be on the ground, if that is known.
    """
    toes, root = feet.place(world, turned), world[..., 0, [0, 2]]
    standing = toes if ground is None else metrics.over_ground(toes, ground)
    row = {
        "skate_cm_s": metrics.foot_skate(standing, fps, feet.rest),
        "skate_ratio": metrics.skate_ratio(standing, fps, feet.rest),
        "glide_share": metrics.glide_share(standing, root, fps),
        "airborne_share": metrics.airborne_share(standing, feet.rest),
    }
    if ground is not None and feet.heels is not None:
        soles = np.stack([toes, feet.heels.place(world, turned)], axis=-2)
        rest = np.stack([feet.rest, feet.heels.rest], axis=-1)
        sunk = metrics.sink(soles, ground, rest)
        row |= {
            "sink_cm": metrics.mean(sunk),
            "sink_p99_cm": float(np.percentile(sunk, 99)),
            "hover_cm": float("nan") if planted is None else metrics.hover(soles, ground, planted, rest),
        }
    return row, standing


def of_data(database: Any, feet: Feet, *, on_ground: bool = False) -> dict[str, float]:
    """The same metrics, where they mean something, of the database's own clips: the yardstick.

    on_ground : with how feet stand on a ground, which is the level one that they were captured on.

    Up to 30,000 frames, whole ranges, spread over the database; metrics are weighted by length.
    """
    lengths = database.stops - database.starts
    stride = max(1, round(float(lengths.sum()) / SAMPLED_FRAMES))
    rows, weights = [], []
    for start, stop in zip(database.starts[::stride], database.stops[::stride], strict=True):
        if stop - start < 4:
            continue
        poses = database.poses[start:stop]
        world, turned = world_transforms(database.skeleton, poses.positions, poses.rotations)
        planted, ground = database.contacts[start:stop], flat if on_ground else None
        stood, _ = _of_feet(feet, world, turned, database.fps, planted, ground)
        local = in_root_space(database.skeleton, poses.positions, poses.rotations)
        rows.append(
            {
                **stood,
                "jerk_m_s3": metrics.jerk(world, database.fps),
                "ordinary_pop_cm": float(np.percentile(metrics.pops(local)[2:], 99)),
                "speed_mps": float(metrics.root_speed(world[:, 0][:, [0, 2]], database.fps).mean()),
            }
        )
        weights.append(stop - start)
    if not rows:
        return {}
    return {key: _average([row[key] for row in rows], weights) for key in rows[0]}


def _average(values: list[float], weights: list[int]) -> float:
    """Weighted mean of those that are numbers; NaN where none is."""
    known = np.isfinite(values)
    if not known.any():
        return float("nan")
    return float(np.average(np.array(values)[known], weights=np.array(weights)[known]))
