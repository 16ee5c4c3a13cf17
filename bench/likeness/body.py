"""A clip as a biomechanist looks at it: where the body is, where it faces, when its feet stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mm import metrics
from motion import contacts, kinematics, leadin, quat, resample, root
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton

Array = NDArray[np.floating]

FPS = 60.0  # at which all motion is compared; a rate twice as high is halved
SIDES = ("left", "right")
NEEDED = ("hips", *(f"{side}_{part}" for side in SIDES for part in ("up_leg", "leg", "foot")))
SHORTEST = 0.5  # seconds of motion that are worth looking at
TOE_LOW, HEEL_LOW = 0.04, 0.05  # metres above its rest below which a foot may stand: floors of captures tilt
STILL, SHARE, FASTEST = (
    0.35,
    0.6,
    1.2,
)  # a foot that stands is slower than m/s, or this share of the body's speed, up to m/s
BLINK = 0.05  # seconds: contacts and flights no longer than that are noise


@dataclass(frozen=True, eq=False)
class Body:
    """A grounded clip in the world, and what is told from it once.

    Attributes
    ----------
    clip : grounded, joint 0 the ground root, at `FPS`.
    band : Hz up to which the file's own rate can tell, half of it.
    positions, rotations : world transforms [T, J, 3], [T, J, 4].
    leg : metres from the hip joint to the floor along a straight leg.
    path : [T, 2] ground position of the hips, metres.
    velocity : [T, 2] of it, averaged over 0.5 s.
    yaw : [T] where the hips face, radians, unwrapped, not smoothed; heading: averaged over a second.
    rest : [4] heights at which left and right ankle, left and right toe (or foot) stand.
    stands : bool [T, 2], whether the left, the right foot is on the ground.
    """

    clip: Clip
    band: float
    positions: Array
    rotations: Array
    leg: float
    path: Array
    velocity: Array
    yaw: Array
    heading: Array
    rest: Array
    stands: NDArray[np.bool_]

    @property
    def skeleton(self) -> Skeleton:
        return self.clip.skeleton

    @property
    def fps(self) -> float:
        return self.clip.fps

    def __len__(self) -> int:
        return len(self.clip)

    def has(self, *roles: str) -> bool:
        return all(role in self.skeleton.roles for role in roles)

    def at(self, role: str) -> Array:
        """World positions [T, 3] of a role's joint."""
        return self.positions[:, self.skeleton.role(role)]

    def turned(self, role: str) -> Array:
        """World rotations [T, 4] of a role's joint."""
        return self.rotations[:, self.skeleton.role(role)]

    def toe(self, side: str) -> str:
        """The role of a side's toe, or of its foot where there is no toe."""
        return f"{side}_toe" if self.has(f"{side}_toe") else f"{side}_foot"

    @staticmethod
    def of(clip: Clip) -> Body:
        """Of a clip as `motion.sources.load` gives it; a UserError without hips and whole legs."""
        for role in NEEDED:
            if role not in clip.skeleton.roles:
                raise UserError(f"no joint plays the role {role!r}", path=clip.source, remedy="exclude it")
        clip = leadin.without_lead_in(clip)
        if clip.seconds < SHORTEST:
            raise UserError(f"{clip.seconds:.2f} s are too short to judge", path=clip.source)
        band = clip.fps / 2
        clip = root.ground(resample.resample(clip, FPS))
        positions, rotations = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
        roles = clip.skeleton.roles
        path = positions[:, roles["hips"]][:, [0, 2]]
        ahead = root.facing(clip.skeleton, positions, rotations)
        yaw = np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2]))
        velocity = metrics.smooth(kinematics.velocities(path, clip.fps), clip.fps, 0.5)
        feet, rest = _feet(clip, positions, np.linalg.norm(velocity, axis=-1))
        return Body(
            clip=clip,
            band=band,
            positions=positions,
            rotations=rotations,
            leg=_leg(clip.skeleton, positions) + float(np.mean(rest[:2])),
            path=path,
            velocity=velocity,
            yaw=yaw,
            heading=metrics.smooth(yaw, clip.fps, 1.0),
            rest=rest,
            stands=_stands(feet, rest, np.linalg.norm(velocity, axis=-1), clip.fps),
        )


def _leg(skeleton: Skeleton, positions: Array) -> float:
    """Median length of thigh and shank, metres."""
    lengths = []
    for side in SIDES:
        hip, knee, ankle = (positions[:, skeleton.role(f"{side}_{p}")] for p in ("up_leg", "leg", "foot"))
        lengths.append(np.linalg.norm(hip - knee, axis=-1) + np.linalg.norm(knee - ankle, axis=-1))
    return float(np.median(lengths))


def _feet(clip: Clip, positions: Array, speed: Array) -> tuple[Array, Array]:
    """World positions [T, 4, 3] of ankles and toes, left first, and the heights [4] at which they stand."""
    roles = clip.skeleton.roles
    ankles = [f"{side}_foot" for side in SIDES]
    toes = [f"{side}_toe" for side in SIDES]
    toes = toes if all(role in roles for role in toes) else ankles
    feet = positions[:, [roles[role] for role in (*ankles, *toes)]]
    touching = contacts.contacts(clip, roles=(*ankles, *toes))
    return feet, metrics.resting_heights(feet, touching, speed)


def _stands(feet: Array, rest: Array, speed: Array, fps: float) -> NDArray[np.bool_]:
    """Whether a foot stands, bool [T, 2]: its heel or its toe is low and lags behind the body.

    A share of the body's speed, because a runner's foot never is as still as a walker's.
    """
    rates = np.linalg.norm(kinematics.velocities(feet, fps), axis=-1)
    slow = rates < np.clip(SHARE * speed, STILL, FASTEST)[:, None]
    low = feet[..., 1] - rest < np.array([HEEL_LOW, HEEL_LOW, TOE_LOW, TOE_LOW])
    either = (slow & low).reshape(len(feet), 2, 2).any(axis=1)
    return contacts.median(either, 2 * round(BLINK * fps) + 1)


def turned_mean(rotations: Array) -> Array:
    """The rotation [4] in the middle of rotations [T, 4]: the mean over one hemisphere.

    Enough where they lie within some tens of degrees (Markley et al. 2007 give the exact eigenvector).
    """
    signs = np.where(rotations @ rotations[len(rotations) // 2] < 0, -1.0, 1.0)
    return quat.normalize((rotations * signs[:, None]).mean(axis=0))
