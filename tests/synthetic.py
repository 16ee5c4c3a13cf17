"""A procedural humanoid that walks, turns, runs and stands: motion whose truth is known, made without files.

Feet are placed on the ground by a clock and stay exactly still until they lift; legs follow by two-bone
inverse kinematics. So contacts, speeds, headings and turns are known beforehand.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from motion import quat
from motion.clip import Clip
from motion.skeleton import Skeleton

THIGH = SHIN = 0.43
ANKLE = 0.09  # height of the foot joint above the sole
HIPS = 0.88  # height of the hips when they stand still
SIDE = 0.09  # half the distance of the feet
DROP = 0.05  # the thighs hang so far below the hips
GAITS = {"stand": (1.0, 1.0), "walk": (1.0, 0.6), "run": (0.7, 0.3)}  # name: (seconds a cycle, share planted)

_JOINTS: list[tuple[str, str, tuple[float, float, float]]] = [
    ("Hips", "", (0, HIPS, 0)),
    ("LeftUpLeg", "Hips", (SIDE, -DROP, 0)),
    ("LeftLeg", "LeftUpLeg", (0, -THIGH, 0)),
    ("LeftFoot", "LeftLeg", (0, -SHIN, 0)),
    ("LeftToe", "LeftFoot", (0, -0.07, 0.14)),
    ("RightUpLeg", "Hips", (-SIDE, -DROP, 0)),
    ("RightLeg", "RightUpLeg", (0, -THIGH, 0)),
    ("RightFoot", "RightLeg", (0, -SHIN, 0)),
    ("RightToe", "RightFoot", (0, -0.07, 0.14)),
    ("Spine", "Hips", (0, 0.08, -0.01)),
    ("Spine1", "Spine", (0, 0.12, 0)),
    ("Spine2", "Spine1", (0, 0.12, 0)),
    ("Neck", "Spine2", (0, 0.22, 0.01)),
    ("Head", "Neck", (0, 0.10, 0.02)),
    ("LeftShoulder", "Spine2", (0.03, 0.17, 0.01)),
    ("LeftArm", "LeftShoulder", (0.13, 0, 0)),
    ("LeftForeArm", "LeftArm", (0, -0.28, 0)),
    ("LeftHand", "LeftForeArm", (0, -0.25, 0)),
    ("RightShoulder", "Spine2", (-0.03, 0.17, 0.01)),
    ("RightArm", "RightShoulder", (-0.13, 0, 0)),
    ("RightForeArm", "RightArm", (0, -0.28, 0)),
    ("RightHand", "RightForeArm", (0, -0.25, 0)),
]

_ROLES = {
    "hips": "Hips",
    "spine": "Spine",
    "chest": "Spine2",
    "neck": "Neck",
    "head": "Head",
} | {
    f"{side}_{role}": f"{side.title()}{part}"
    for side in ("left", "right")
    for role, part in {
        "up_leg": "UpLeg",
        "leg": "Leg",
        "foot": "Foot",
        "toe": "Toe",
        "shoulder": "Shoulder",
        "arm": "Arm",
        "forearm": "ForeArm",
        "hand": "Hand",
    }.items()
}


def skeleton() -> Skeleton:
    """22 joints, hips first; zero rotations: standing, facing +Z, arms and legs straight down."""
    names = [name for name, _, _ in _JOINTS]
    parents = [names.index(parent) if parent else -1 for _, parent, _ in _JOINTS]
    offsets = np.array([offset for _, _, offset in _JOINTS], np.float64)
    roles = {role: names.index(name) for role, name in _ROLES.items()}
    ends = {names.index(f"{side}Toe"): np.array([0, 0, 0.06]) for side in ("Left", "Right")}
    return Skeleton(tuple(names), np.array(parents, np.int32), offsets, roles, ends)


def walk(
    name: str = "walk",
    *,
    gait: str = "walk",
    speed: float = 1.2,
    turn: float | Callable[[np.ndarray], np.ndarray] = 0.0,
    seconds: float = 5.0,
    fps: float = 60.0,
) -> Clip:
    """A clip of the humanoid, starting at the origin and facing +Z, as a file would hold it (no ground root).

    speed m/s along the heading; turn rad/s about +Y (left is positive), a number or a function of time.
    """
    rig = skeleton()
    time = np.arange(round(seconds * fps)) / fps
    position, heading = _path(speed, turn, seconds)
    cycle, duty = GAITS[gait]
    clock = 2 * np.pi * time / cycle
    moving = 0.0 if gait == "stand" else 1.0

    rotations = quat.identity(len(time), len(rig))
    positions = np.tile(rig.offsets, (len(time), 1, 1))
    sway = 0.01 * np.sin(clock) * (1 - moving)  # whoever stands still breathes and shifts a little
    bob = 0.015 * np.cos(2 * clock) * moving
    facing = quat.from_yaw(heading(time))
    positions[:, 0] = position(time) + quat.rotate(facing, np.stack([sway, HIPS + bob, 0 * sway], -1))
    rotations[:, 0] = quat.mul(facing, _turn("y", 0.06 * np.sin(clock) * moving))

    for side, sign, phase in (("Left", 1.0, 0.0), ("Right", -1.0, 0.5)):
        hip, knee, foot, toe = (rig.index(side + part) for part in ("UpLeg", "Leg", "Foot", "Toe"))
        ankle, rotation, lifted = _foot(time, cycle, duty, phase, sign, position, heading)
        target = quat.rotate(quat.inv(rotations[:, 0]), ankle - positions[:, 0]) - rig.offsets[hip]
        rotations[:, hip], rotations[:, knee] = _two_bones(target)
        leg = quat.mul(rotations[:, 0], quat.mul(rotations[:, hip], rotations[:, knee]))
        rotations[:, foot] = quat.mul(quat.inv(leg), rotation)
        rotations[:, toe] = _turn("x", -0.3 * lifted)
        swing = 0.4 * moving * np.sin(clock + 2 * np.pi * phase)
        rotations[:, rig.index(side + "Arm")] = _turn("x", swing)
        rotations[:, rig.index(side + "ForeArm")] = _turn("x", -0.3 - 0.2 * moving + 0.2 * swing)
    rotations[:, rig.index("Spine")] = _turn("x", np.full(len(time), 0.03 + 0.1 * (gait == "run")))
    rotations[:, rig.index("Spine2")] = _turn("y", -0.1 * np.sin(clock) * moving)
    rotations[:, rig.index("Head")] = _turn("x", 0.02 * np.sin(clock / 2))
    return Clip(name, rig, fps, positions, quat.unroll(rotations))


def planted(clip: Clip, gait: str) -> np.ndarray:
    """Which feet stand on the ground, bool [T, 2], left and right: the truth that contacts should find."""
    cycle, duty = GAITS[gait]
    phase = np.arange(len(clip))[:, None] / (clip.fps * cycle) + np.array([0.0, 0.5])
    return phase % 1.0 < duty


def weave(time: np.ndarray) -> np.ndarray:
    """A turn rate, rad/s, that bends left, then right, and left again."""
    return 0.9 * np.sin(1.3 * time + 0.4)


def clips(seconds: float = 5.0, fps: float = 60.0) -> list[Clip]:
    """The set most tests want: straight, left turn, right turn, stand, run."""
    return [
        walk("straight", seconds=seconds, fps=fps),
        walk("left_turn", turn=0.8, seconds=seconds, fps=fps),
        walk("right_turn", turn=-0.8, seconds=seconds, fps=fps),
        walk("stand", gait="stand", speed=0.0, seconds=seconds, fps=fps),
        walk("run", gait="run", speed=3.0, turn=0.2, seconds=seconds, fps=fps),
    ]


def _turn(axis: str, angle: np.ndarray) -> np.ndarray:
    return quat.from_axis_angle(np.eye(3)["xyz".index(axis)], angle)


def _path(speed: float, turn: float | Callable, seconds: float) -> tuple[Callable, Callable]:
    """Ground position [..., 3] and heading [...] at any time, with two seconds to spare at both ends."""
    fine = np.arange(-2.0, seconds + 2.0, 0.002)
    rate = turn(fine) if callable(turn) else np.full(len(fine), float(turn))
    yaw = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * 0.002)])
    yaw -= np.interp(0.0, fine, yaw)
    velocity = speed * np.stack([np.sin(yaw), 0 * yaw, np.cos(yaw)], -1)
    place = np.concatenate([np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * 0.002, axis=0)])
    place -= np.array([np.interp(0.0, fine, place[:, i]) for i in range(3)])
    return (
        lambda t: np.stack([np.interp(t, fine, place[:, i]) for i in range(3)], -1),
        lambda t: np.interp(t, fine, yaw),
    )


def _foot(
    time: np.ndarray,
    cycle: float,
    duty: float,
    phase: float,
    sign: float,
    position: Callable,
    heading: Callable,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World position [T, 3] and rotation [T, 4] of a foot joint, and how far it is lifted [T], 0..1."""
    turns = time / cycle + phase
    step, share = np.floor(turns), turns % 1.0

    def stance(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        middle = (number + duty / 2 - phase) * cycle  # the body passes over the foot in mid-stance
        yaw = heading(middle)
        aside = np.stack([np.full_like(yaw, sign * SIDE), np.full_like(yaw, ANKLE), 0 * yaw], -1)
        return position(middle) + quat.rotate(quat.from_yaw(yaw), aside), yaw

    (here, yaw_here), (there, yaw_there) = stance(step), stance(step + 1)
    swing = np.clip((share - duty) / max(1 - duty, 1e-9), 0, 1)
    ease = swing**2 * (3 - 2 * swing)
    lifted = np.sin(np.pi * swing) ** 2
    place = here + ease[:, None] * (there - here)
    place[:, 1] += 0.12 * lifted
    yaw = yaw_here + ease * (yaw_there - yaw_here)
    pitch = 0.5 * np.sin(2 * np.pi * swing) * np.sin(np.pi * swing)
    return place, quat.mul(quat.from_yaw(yaw), _turn("x", pitch)), lifted


def _two_bones(target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local rotations of thigh and knee that put the ankle at target [T, 3] from the thigh's joint."""
    reach = np.linalg.norm(target, axis=-1)
    bend = np.arccos(np.clip(reach / (2 * THIGH), 0, 1))
    down = np.broadcast_to([0.0, -1.0, 0.0], target.shape)
    swing = quat.between(down, target / reach[:, None])
    return quat.mul(swing, _turn("x", -bend)), _turn("x", 2 * bend)
