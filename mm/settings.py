"""The controller's settings; half-lives, limits and intervals are the public reference's."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from motion.config import ConfigError, choices, shown

MOST = 1e6  # seconds, metres or radians: what is far more than needed, but still fits counts of frames
Synchronization = Literal["adjust", "clamp", "adjust+clamp", "data", "none"]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a controller searches, blends and follows. Seconds, metres, radians.

    Attributes
    ----------
    search_interval : time between searches.
    ignore_radius : frames of the current range nearer than this are no candidates (the jump threshold).
    reselect_time : for so long after a jump no other one leads back to within ignore_radius of the frame that
        it left, unless what plays cannot go on. With 0 two stretches of which each soon costs more than the
        other, a clip and its mirrored copy most of all, can take turns while the character glides.
    ignore_end : the last stretch of every range is no candidate.
    continuing_bias : share by which a candidate must be cheaper than playing on, in [0, 1). Without one, two
        frames that cost nearly the same can take turns, and a frozen pose glides.
    forced_search_change : a search is forced when the desired velocity (m/s) or facing (rad) changed by this
        much from one frame to the next and the change is over; the reference's 50 a second at 60 Hz.
    velocity_halflife, rotation_halflife : how fast the simulated object follows the command.
    inertialization_halflife : how fast the difference at a transition fades.
    synchronization : how character and simulated object stay together. "adjust" draws the character to
        the object, "clamp" keeps it within the maximal distance and angle, "data" puts the object where
        the character is (pure data-driven), "none" lets them drift.
    position_adjustment_halflife, rotation_adjustment_halflife : how fast "adjust" acts.
    adjustment_ratio : "adjust" moves and turns the character by at most this share of its own speed.
    maximal_distance, maximal_angle : what "clamp" allows.
    foot_lock : hold feet that are in contact, by two-bone inverse kinematics.
    foot_halflife : how fast a foot blends into and out of a lock.
    unlock_radius : a lock further than this from the animation is given up.
    foot_height : height at which feet lock; None takes the usual ones from the database (see `mm.feet`).
    body_radius : distance kept from obstacles.
    """

    search_interval: float = 0.1
    ignore_radius: float = 1 / 3
    reselect_time: float = 1 / 3
    ignore_end: float = 1 / 3
    continuing_bias: float = 0.2
    forced_search_change: float = 50 / 60
    velocity_halflife: float = 0.27
    rotation_halflife: float = 0.27
    inertialization_halflife: float = 0.1
    synchronization: Synchronization = "adjust+clamp"
    position_adjustment_halflife: float = 0.1
    rotation_adjustment_halflife: float = 0.2
    adjustment_ratio: float = 0.5
    maximal_distance: float = 0.15
    maximal_angle: float = np.pi / 2
    foot_lock: bool = True
    foot_halflife: float = 0.1
    unlock_radius: float = 0.2
    foot_height: float | None = None
    body_radius: float = 0.3

    def __post_init__(self) -> None:
        check_numbers(self)
        if self.continuing_bias >= 1:
            raise ConfigError("continuing_bias", f"{self.continuing_bias}", remedy="give a share below 1")
        known = Synchronization.__args__  # type: ignore[attr-defined]
        if self.synchronization not in known:
            raise ConfigError(
                "synchronization", f"{self.synchronization!r} is no choice", remedy=choices(known)
            )


def check_numbers(settings: Any) -> None:
    """A ConfigError unless every number of a dataclass of settings is from 0 to `MOST`."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if number and not 0 <= value <= MOST:
            remedy = f"give a number from 0 to {MOST:,.0f}"
            raise ConfigError(field.name, f"{shown(value)} is out of range", remedy=remedy)


# What the kernels read: one record, so that a call passes one array.
RECORD = np.dtype(
    [
        (name, np.float32)
        for name in (
            "dt",
            "search_interval",
            "forced_search_change",
            "velocity_halflife",
            "rotation_halflife",
            "inertialization_halflife",
            "position_adjustment_halflife",
            "rotation_adjustment_halflife",
            "adjustment_ratio",
            "maximal_distance",
            "maximal_angle",
            "foot_halflife",
            "unlock_radius",
            "body_radius",
        )
    ]
    + [("adjust", np.bool_), ("clamp", np.bool_), ("data", np.bool_)],
    align=True,
)


def record(settings: Settings, fps: float) -> np.ndarray:
    """Settings as one `RECORD` [1]."""
    out = np.zeros(1, RECORD)
    for name in RECORD.names or ():
        if name in settings.__dict__:
            out[name] = getattr(settings, name)
    out["dt"] = 1 / fps
    for name in ("adjust", "clamp", "data"):
        out[name] = name in settings.synchronization.split("+")
    return out
