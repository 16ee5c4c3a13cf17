"""How characters that a network drives by their trajectory follow what they are asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mm.settings import check_numbers
from motion.config import ConfigError

RATE = 60  # frames a second that `joint_smoothing` is of
SHIFT = 0.1  # m/s at least over which walk goes over to jog


@dataclass(frozen=True, kw_only=True)
class LocomotionSettings:
    """Seconds, metres, radians.

    Attributes
    ----------
    position_bias, direction_bias : how soon along the trajectory what is asked replaces what is predicted:
        by 1 - (1 - t)^bias at the share t of the future (REFERENCE 4.2). 0.5 and 2 are the published demo's
        normal ones; with its responsive ones, 2 and 5, the published network keeps to ways better, and does
        not walk backwards when it is asked to walk slowly.
    velocity_halflife, facing_halflife : how fast a change of the command is taken in.
    gait_halflife, crouch_halflife : how fast the gait asked for changes.
    stand_speed : below it a character is asked to stand, the slower the more.
    jog_from, jog_to : speeds between which walk goes over to jog; None lays them close to the geometric mean
        of the data's walking and running speed. Nobody in the data goes half in the one and half in the
        other: a network that is asked to ran at 4 m/s where 2.4 were asked.
    adjustment_ratio : the root is drawn to the way asked, from aside, by at most this share of its own speed;
        characters of motion matching are by half. 0, as published, leaves the way to the network, which goes
        where the body faces rather than aside.
    joint_smoothing : share of the last frame's joints, moved on by their velocities, in those shown, of 60
        frames a second as published; at other rates they are followed as fast in time.
    stretch : whether joints are shown where the network puts them, as published; else bones keep their
        length, and limbs are bent so that they end where it puts hands and feet (`lmm.locomotion.bones`).
    foot_lock, foot_halflife, unlock_radius, foot_height, body_radius : see `mm.settings.Settings`.
    """

    position_bias: float = 2.0
    direction_bias: float = 5.0
    velocity_halflife: float = 0.005
    facing_halflife: float = 0.005
    gait_halflife: float = 0.11
    crouch_halflife: float = 0.11
    stand_speed: float = 0.06
    jog_from: float | None = None
    jog_to: float | None = None
    adjustment_ratio: float = 0.2
    joint_smoothing: float = 0.5
    stretch: bool = False
    foot_lock: bool = True
    foot_halflife: float = 0.1
    unlock_radius: float = 0.2
    foot_height: float | None = None
    body_radius: float = 0.3

    def __post_init__(self) -> None:
        check_numbers(self)
        if self.joint_smoothing >= 1:
            raise ConfigError("joint_smoothing", f"{self.joint_smoothing}", remedy="give a share below 1")
        if self.jog_from is not None and self.jog_to is not None and not self.jog_from < self.jog_to:
            raise ConfigError("jog_to", f"{self.jog_to}", remedy="give more than jog_from")


# What the kernels read; shares are what is taken in of a change in one frame.
RECORD = np.dtype(
    [
        (name, np.float32)
        for name in (
            "dt",
            "velocity_share",
            "facing_share",
            "gait_share",
            "crouch_share",
            "stand_speed",
            "jog_from",
            "jog_to",
            "jogs",
            "crouches",
            "adjustment_ratio",
            "joint_smoothing",
            "body_radius",
        )
    ],
    align=True,
)


def record(
    settings: LocomotionSettings,
    fps: float,
    *,
    walk_mps: float,
    run_mps: float,
    jogs: bool = True,
    crouches: bool = True,
) -> np.ndarray:
    """Settings as one `RECORD` [1], for data of these walking and running speeds that has these gaits or not.

    Of a gait that is not in the data a network knows nothing: it is not asked for.
    """
    out = np.zeros(1, RECORD)
    out["jogs"], out["crouches"] = jogs, crouches
    for name in ("stand_speed", "adjustment_ratio", "body_radius"):
        out[name] = getattr(settings, name)
    out["joint_smoothing"] = settings.joint_smoothing ** (RATE / fps)
    for name in ("velocity", "facing", "gait", "crouch"):
        halflife = getattr(settings, f"{name}_halflife")
        out[f"{name}_share"] = 1 - 0.5 ** (1 / (fps * halflife)) if halflife > 0 else 1
    change = np.sqrt(walk_mps * run_mps)
    low = change - SHIFT / 2 if settings.jog_from is None else settings.jog_from
    high = change + SHIFT / 2 if settings.jog_to is None else settings.jog_to
    out["dt"], out["jog_from"], out["jog_to"] = 1 / fps, low, max(high, low + SHIFT)
    return out
