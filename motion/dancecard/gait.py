"""How people step: measures of walking, running and stepping aside against speed, as published.

Speeds are in m/s, frequencies in strides (two steps) a second, shares in strides. All take and give arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def walking_frequency(speed: Any) -> Any:
    """Strides a second of a walk: 0.745 v^0.58.

    The exponent is of Grieve and Gear (Ergonomics 9, 1966); the factor makes it meet Winter's slow, natural
    and fast walkers (1991; 87, 105, 123 steps a minute with strides of 1.38, 1.51, 1.64 m).
    """
    return 0.745 * np.maximum(speed, 0.5) ** 0.58


def running_frequency(speed: Any) -> Any:
    """Strides a second of a run: 77, 79 and 80 a minute at 2.4, 2.6 and 2.9 m/s.

    van Oeveren et al., PLOS ONE 12, 2017; a tenth of a stride a second more with each m/s.
    """
    return 1.04 + 0.1 * np.maximum(speed, 1.5)


def sidestep_frequency(speed: Any) -> Any:
    """Strides a second of steps to a side, which are short for feet do not cross."""
    return 0.88 + 0.42 * np.minimum(speed, 1.6)


def turning_frequency(rate: Any) -> Any:
    """Strides a second of stepping round on the spot at a rate in rad/s: about 60 degrees a step at most."""
    return 0.66 + 0.24 * np.abs(rate)


def walking_duty(speed: Any) -> Any:
    """Share of a stride that a foot stands in a walk: 0.62 at 1.3 m/s, less when faster (Murray 1967)."""
    return np.clip(0.715 - 0.072 * speed, 0.57, 0.70)


def running_duty(speed: Any) -> Any:
    """The same in a run: contact of 0.29 s at 2.5 m/s, 0.2 s at 4.5 m/s (Nilsson, Thorstensson 1987)."""
    return np.clip(0.374 - 0.038 * (speed - 2.5), 0.27, 0.43)


def vertical_excursion(speed: Any) -> Any:
    """Rise and fall of the body in a walk, metres: 2.7 cm at 0.7, 4.8 cm at 1.6 m/s (Orendurff 2004)."""
    return np.clip(0.0274 + 0.0233 * (np.asarray(speed) - 0.7), 0.004, 0.055)


def lateral_excursion(speed: Any) -> Any:
    """Sway from side to side in a walk, metres: 7.0 cm at 0.7 m/s to 3.9 cm at 1.6 m/s (Orendurff 2004)."""
    return np.clip(0.0699 - 0.0349 * (np.asarray(speed) - 0.7), 0.02, 0.075)
