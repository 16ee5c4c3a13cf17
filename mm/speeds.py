"""How fast a user asks a character to go, and how fast the data goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from motion import config
from motion.config import ConfigError

if TYPE_CHECKING:
    from .database import Database

Triple = tuple[float, float, float]

GRAVITY = 9.81
FROUDE = 0.5  # legged animals, two legs or four, go over from walk to run near v^2 / (g h) = 0.5
HIPS = 0.9  # metres, where a database does not say


@dataclass(frozen=True)
class Speeds:
    """Speeds of a stick at full tilt: forward, sideways and backward, m/s (REFERENCE 2.5)."""

    walk: Triple = (1.75, 1.5, 1.25)
    run: Triple = (4.0, 3.0, 2.5)

    def __post_init__(self) -> None:
        config.validate(self)
        for name in ("walk", "run"):
            if not all(np.isfinite(v) and v >= 0 for v in getattr(self, name)):
                raise ConfigError(
                    name, f"speeds {getattr(self, name)}", remedy="give three numbers of at least 0"
                )

    def scaled(self, walk: float, run: float) -> Speeds:
        """Multiplied by factors."""
        return Speeds(tuple(v * walk for v in self.walk), tuple(v * run for v in self.run))  # type: ignore[arg-type]


def of_database(database: Database) -> tuple[float, float]:
    """Typical walking and running speed of a database, m/s, from the ground root's velocities.

    Frames slower than a quarter of the walk-run transition do not count. The transition, sqrt(0.5 g h) with h
    the height of the hips, is 2.1 m/s for a human. Walk is the median below it; run the upper quartile above.
    Data that hardly runs gives the fast end of its walk as run, data that hardly walks the slow end of its
    run as walk; data that never moves gives (0, 0).
    """
    velocity = np.asarray(database.poses.velocities[:, 0, [0, 2]], np.float64)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    transition = float(np.sqrt(FROUDE * GRAVITY * _hip_height(database)))
    speed = speed[speed > transition / 4]
    slow, fast = speed[speed < transition], speed[speed >= transition]
    if len(speed) == 0:
        return 0.0, 0.0
    if len(fast) < 0.05 * len(speed):
        return float(np.median(slow)), float(np.percentile(slow, 90))
    if len(slow) < 0.05 * len(speed):
        return float(np.percentile(fast, 10)), float(np.percentile(fast, 75))
    return float(np.median(slow)), float(np.percentile(fast, 75))


def _hip_height(database: Database) -> float:
    hips = database.skeleton.roles.get("hips")
    if not hips:  # absent, or the root itself
        return HIPS
    # Without forward kinematics where the hips hang on the ground root, as they do after grounding.
    chain = database.skeleton.chain(hips)[1:]
    height = float(np.median(database.poses.positions[:, chain, 1].sum(axis=1)))
    return height if height > 0.05 else HIPS
