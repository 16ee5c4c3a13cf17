"""A phase-functioned network's characters, whose trajectory is as others' (`lmm.locomotion.trajectory`)."""

from __future__ import annotations

import numpy as np

from ..locomotion.trajectory import PAST, blend, character, interval, ring, world

__all__ = ["CHARACTER", "PAST", "blend", "interval", "ring", "world"]

CHARACTER = character(("phase", np.float32))
