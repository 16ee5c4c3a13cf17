"""How a dancer differs from another, or from himself on another day: factors and angles about the mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Style:
    """Mean values are those of a calm young adult. Angles in degrees, lengths in metres."""

    cadence: float = 1.0  # factor on the step frequency at the same speed
    width: float = 0.105  # between the ankles' lines
    toe_out: float = 7.0
    arm_swing: float = 1.0
    elbow: float = 0.0  # added to the flexion
    arm_out: float = 6.5  # abduction of hanging arms
    lean: float = 0.0  # of the trunk, forward
    bounce: float = 1.0
    sway: float = 1.0
    twist: float = 1.0  # pelvis and shoulders about the vertical
    foot_lift: float = 1.0
    head: float = 0.0  # pitch, downward
    restless: float = 1.0  # wandering of everything
    asymmetry: float = 0.0  # of the arms' swing

    @staticmethod
    def random(rng: np.random.Generator) -> Style:
        """Someone."""

        def about(mean: float, spread: float) -> float:
            return float(mean + spread * np.clip(rng.standard_normal(), -2, 2))

        return Style(
            cadence=about(1.0, 0.025),
            width=about(0.105, 0.015),
            toe_out=about(7.0, 2.5),
            arm_swing=about(1.0, 0.18),
            elbow=about(0.0, 5.0),
            arm_out=about(6.5, 1.5),
            lean=about(0.0, 1.5),
            bounce=about(1.0, 0.12),
            sway=about(1.0, 0.15),
            twist=about(1.0, 0.2),
            foot_lift=about(1.0, 0.08),
            head=about(0.0, 2.5),
            restless=about(1.0, 0.2),
            asymmetry=about(0.0, 0.16),
        )
