"""The frame rate behind a frame time, whose printed digits are rounded."""

from __future__ import annotations

import math

_COMMON_RATES = tuple(
    map(int, "10 12 15 20 24 25 30 48 50 60 72 75 90 96 100 120 144 150 180 200 240 250 300 480 500".split())
)
_BROADCAST_RATES = tuple(n * 1000 / 1001 for n in (24, 30, 60, 120, 240))


def frame_rate(printed: str) -> float:
    """The frame rate behind a printed frame time.

    Frame times are rounded (0.008333) or cut (0.06666666) decimals, so the rate is one that the printed
    digits can stand for: a common one, a broadcast one (29.97 is 30000/1001), a whole one, else the plain
    reciprocal.
    """
    seconds = float(printed)
    mantissa, _, power = printed.lower().partition("e")
    step = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    rates: list[tuple[float, ...]] = [_COMMON_RATES] if step < seconds / 2 else []
    if step < seconds / 100:
        rates += [_BROADCAST_RATES, (float(round(1 / seconds)),) if seconds < 1 else ()]
    for choices in rates:
        rate = min(choices, key=lambda r: abs(math.log(r * seconds)), default=0.0)
        if rate and -0.5000001 < (1 / rate - seconds) / step < 1:
            return float(rate)
    return 1 / seconds
