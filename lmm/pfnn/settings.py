"""How characters of a phase-functioned network follow what they are asked (`lmm.locomotion.settings`)."""

from __future__ import annotations

from ..locomotion.settings import RECORD, record
from ..locomotion.settings import LocomotionSettings as PhaseSettings

__all__ = ["RECORD", "PhaseSettings", "record"]
