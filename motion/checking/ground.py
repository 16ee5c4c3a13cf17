"""The ground: clips that do not stand at y = 0, bodies that sink into it, bodies that hang in the air.

What a body stands on is nobody's to know: boxes, stairs and slopes are seen only by feet that rest on them.
So a body in the air is suspect only if nothing of it rests anywhere, and if it does not fall either.
"""

from __future__ import annotations

import numpy as np

from .body import GRAVITY, STILL, Body, slower_of_steps
from .finding import Finding, spans

OFF = 0.35  # of the legs' length: an ankle's height is 0.1, the ground of a set of files may lie as deep
UNDER = 0.25  # of the legs' length under the ground: softer ground or steps down were seen to 0.2
ABOVE = 0.15  # of the legs' length over the ground: higher than toes drag
LONGEST_FLIGHT = 1.0  # seconds; a flight of T rises by g T²/8: 1.2 m, the height of records
SHORTEST = 0.25  # seconds; below it the acceleration is too uncertain to be told from falling
LONG = 0.4  # seconds, from which on it is certain
FALLING, LONG_FALLING = 0.2, 0.5  # of gravity, downwards: what falls less is held by something


def findings(body: Body) -> list[Finding]:
    """A ground that is not at 0, soles below the ground, and floating."""
    if len(body) < 2 or not body.soles.size:
        return []
    level = _level(body)
    # A ground that cannot be right tells nothing about what is above it.
    return level + _under(body) + ([] if level else _floating(body))


def _level(body: Body) -> list[Finding]:
    if abs(body.ground) <= OFF * body.leg:
        return []
    where = "below" if body.ground < 0 else "above"
    what = f"the body stands {abs(body.ground):.2f} m {where} y = 0"
    return [Finding("ground", 0, len(body), what, fatal=True)]


def _under(body: Body) -> list[Finding]:
    lowest = body.soles[..., 1].min(axis=1)
    found = []
    for start, stop in spans(lowest < body.ground - UNDER * body.leg, gap=body.gap):
        frame = start + int(lowest[start:stop].argmin())
        what = f"feet {body.ground - lowest[frame]:.2f} m under the ground at frame {frame}"
        found.append(Finding("ground", start, stop, what, fatal=True))
    return found


def _floating(body: Body) -> list[Finding]:
    points = np.concatenate([body.world, body.soles], axis=1)
    heights = points[..., 1].min(axis=1) - body.ground
    high = heights > ABOVE * body.leg
    if not high.any():
        return []
    moving = slower_of_steps(points, body.fps).min(axis=1) > STILL * np.sqrt(body.scale)
    found = []
    for start, stop in spans(high & moving):
        seconds = body.seconds(start, stop)
        if seconds < SHORTEST or stop - start < 4:
            continue
        height = body.centre[start:stop, 1]
        times = np.arange(stop - start) / body.fps
        falls = -2 * np.polyfit(times - times.mean(), height, 2)[0]
        least = LONG_FALLING if seconds > LONG else FALLING
        if seconds > LONGEST_FLIGHT * max(1.0, np.sqrt(body.scale)) or falls < least * GRAVITY:
            height_above = f"floats {heights[start:stop].min():.2f} m or more above the ground"
            what = f"{height_above} for {seconds:.2f} s, falling with {falls:.1f} m/s²"
            found.append(Finding("floating", start, stop, what, fatal=True))
    return found
