"""Frames that repeat the one before: a capture that froze, or a rate that was raised by repeating frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .body import Body
from .finding import Finding, spans

SAME = 1e-6  # radians, and metres: below what a file's six decimals tell apart; bodies never hold so still
FROZEN, STOPPED = 0.1, 0.025  # seconds without any motion at all, and between motions
MOVING = 0.3  # m/s that the fastest joint must move around a frame for its repetition to matter
PATTERN, ALIKE = 4, 0.75  # repetitions that make a pattern if this share of their distances is alike
FURTHEST = 6  # frames from one repetition to the next in a pattern (24 fps shown at 30 repeat every fifth)


def findings(body: Body) -> list[Finding]:
    """Frozen spans, patterns of repeated frames, and single repeated frames."""
    clip = body.clip
    if len(clip) < 2:
        return []
    changes = [np.abs(np.diff(local, axis=0)).max(axis=(1, 2)) for local in (clip.rotations, clip.positions)]
    same = np.maximum(*changes) < SAME
    if not same.any():
        return []
    found, lone = [], np.zeros(len(same), bool)
    speeds = np.linalg.norm(np.diff(body.world, axis=0), axis=-1).max(axis=1) * body.fps
    for start, stop in spans(same):
        around = np.concatenate([speeds[max(start - 1, 0) : start], speeds[stop : stop + 1]])
        moves = len(around) > 0 and around.max() > MOVING * body.scale
        if stop - start >= max(3, round((STOPPED if moves else FROZEN) * body.fps)):
            seconds = (stop - start + 1) / body.fps
            what = f"nothing moves for {seconds:.2f} s, frames {start} to {stop}"
            found.append(Finding("frozen", start + 1, stop + 1, what, fatal=True))
        else:
            lone[start:stop] = moves
    return found + _repeated(body, lone)


def _repeated(body: Body, repeats: NDArray) -> list[Finding]:
    """Findings about frames that are the same as the one before, by the steps [T-1] that lead to them."""
    found = []
    for start, stop in spans(repeats, gap=FURTHEST - 1):
        at = np.flatnonzero(repeats[start:stop]) + start
        distances = np.diff(at)
        usual = float(np.median(distances)) if len(distances) else 0.0
        if len(at) >= PATTERN and usual > 1 and np.mean(distances == usual) >= ALIKE:
            whole = start < FURTHEST and len(repeats) - stop < FURTHEST
            first, last = (0, len(body)) if whole else (start, stop + 1)
            rate = body.fps * (1 - 1 / usual)
            count = f"{len(at)} of {last - first} frames repeat the one before"
            what = f"{count}, every {usual:.0f}th: sampled at {rate:.3g} fps?"
            found.append(Finding("repeated", first, last, what, fatal=True))
            continue
        for first, last in spans(repeats[start:stop]):
            frame, after = start + first + 1, start + last + 1
            what = f"frame {frame}{f' to {after - 1}' * (last - first > 1)} as frame {frame - 1}, amid motion"
            found.append(Finding("repeated", frame, after, what, fatal=False))
    return found
