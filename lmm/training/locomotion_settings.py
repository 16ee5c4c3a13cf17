"""How networks that a trajectory drives are trained: what their settings have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .settings import Common, StageSettings, check_range


@dataclass(frozen=True, kw_only=True)
class LocomotionStageSettings(StageSettings):
    """How the network is trained.

    Attributes
    ----------
    window : frames that the network runs on its own output; 1 learns each frame by itself.
    alone : share of the iterations, the first, in which each frame is learned by itself whatever the window.
    keep : share of a layer's inputs that dropout leaves.
    noise, asked_noise : how far off the joints that go in are at most, and the trajectory, in deviations of
        their block; each sample by another amount. A walk backwards lies half a deviation from one ahead
        where the data runs: who is told of the way no better than that answers what is rare with what is
        common.
    ordinary : joints of an ordinary rig. Those of a larger one repeat one another: each by itself they would
        outweigh the trajectory, and what they are off by would cancel. They count together, and are off
        together, as so many. 0 for each by itself. Joints that do not count (fingers) are not counted.
    """

    hidden: tuple[int, ...] = (512, 512)
    alone: float = 0.0
    keep: float = 0.7
    noise: float = 0.0
    asked_noise: float = 0.0
    ordinary: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        ranges = (
            ("alone", 0, 1),
            ("keep", 0.01, 1),
            ("noise", 0, 10),
            ("asked_noise", 0, 10),
            ("ordinary", 0, 1e6),
        )
        for name, least, most in ranges:
            check_range(name, getattr(self, name), least, most)


@dataclass(frozen=True, kw_only=True)
class LocomotionTraining(Common):
    """How a network is trained that a trajectory drives."""

    @property
    def stage(self) -> LocomotionStageSettings:
        """The training of the network."""
        raise NotImplementedError

    def longest(self, fps: float) -> int:
        return self.stage.window + 2  # a range's first and last frame have no vectors


ORDINARY = 26  # joints that count in CMU's skeleton, which train well each by itself


def ours(name: str) -> dict[str, Any]:
    """What our recipe has for every such network, in a size.

    Larger batches at a higher rate that falls to 0, averaged weights; inputs that are a little off, and a few
    frames on the network's own output, so that it finds back into the motion.
    """
    iterations = {"full": 60_000, "quick": 20_000, "smoke": 30}[name]
    return {
        "iterations": iterations,
        "batch": 128,
        "window": 4,
        "learning_rate": 1e-3,
        "schedule": "cosine",
        "optimiser": "adam",
        "warm_up": 0.02,
        "average": 0.999,
        "clip": 1.0,
        "evaluate": max(iterations // 50, 15),
        "alone": 0.6,
        "keep": 1.0,
        "noise": 0.5,
        "asked_noise": 0.1,
        "ordinary": ORDINARY,
    }
