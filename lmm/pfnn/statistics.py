"""How a phase-functioned network's vectors are normalised (`lmm.locomotion.statistics`)."""

from __future__ import annotations

from ..locomotion.statistics import JOINT_SCALE, NOTHING, joint_weights, statistics

__all__ = ["JOINT_SCALE", "NOTHING", "joint_weights", "statistics"]
