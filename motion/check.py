"""Whether a clip can be trusted: what is wrong with it, where, and which frames are good."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .checking import bones, ground, jumps, rate, rest, sides, still, upright, values
from .checking.body import Body
from .checking.finding import KINDS, Finding, spans
from .clip import Clip

__all__ = ["KINDS", "Finding", "check", "good_spans"]

# In this order: what a detector found is not found again by those after it.
OF_FRAMES = (
    *(rest.findings, bones.findings, still.findings, jumps.jumps, jumps.flips),
    *(ground.findings, sides.findings),
)
EXPLAINS = {"not finite", "rest pose", "stretch", "frozen", "repeated", "jump", "teleport"}
EXPLAINED = {"rest pose", "frozen", "repeated", "jump", "flip", "sides"}
SLACK = 2  # frames around a defect that suffer from it
CUTS = {"not finite", "rest pose", "stretch", "frozen", "repeated", "jump", "teleport", "flip"}
"""Kinds that part the clip into pieces, of which the longest tells whether the rate is right."""


def check(clip: Clip) -> list[Finding]:
    """What is wrong with a clip, as `motion.sources.load` reads it: in metres, roles set, not grounded.

    Returns findings, those about the whole clip first, then by frame; none for a sound clip. Any rate, unit
    and skeleton will do; what a clip has no roles for is not judged. Where the rate is wrong, the frames are
    judged at the likely one.
    """
    if len(clip) == 0:
        return []
    unusable = values.unusable(clip)
    lost = values.findings(clip, unusable)
    bad = np.any(unusable, axis=1)
    if bad.all():
        return lost
    if bad.any():
        clip = values.filled(clip, bad)
    body = Body(clip)
    if lying := upright.findings(body):
        return lying + lost  # nothing else can be told by it
    found = _of_frames(body, lost)
    start, stop = _calm(len(clip), found)
    if stop - start < len(clip):
        calm = clip.replace(positions=clip.positions[start:stop], rotations=clip.rotations[start:stop])
        verdict = rate.judge(Body(calm)) if len(calm) > 1 else None
    else:
        verdict = rate.judge(body) if len(clip) > 1 else None
    if verdict is not None:
        found = _of_frames(Body(clip.replace(fps=verdict.likely)), lost)
        found.append(Finding("rate", 0, len(clip), verdict.what, fatal=True))
    return sorted(found, key=lambda f: (f.stop - f.start < len(clip), f.start, f.stop))


def good_spans(length: int, findings: Iterable[Finding], *, minimum: int = 1) -> list[tuple[int, int]]:
    """Ranges [start, stop) of a clip's length frames without fatal findings, of minimum frames or more."""
    good = np.ones(length, bool)
    for finding in findings:
        if finding.fatal:
            good[finding.start : finding.stop] = False
    return [(start, stop) for start, stop in spans(good) if stop - start >= minimum]


def _of_frames(body: Body, found: list[Finding]) -> list[Finding]:
    found = list(found)
    for detector in OF_FRAMES:
        found += [new for new in detector(body) if not any(_explains(old, new) for old in found)]
    return found


def _explains(old: Finding, new: Finding) -> bool:
    """Whether what is new is but a trace of what was found in the same frames before."""
    # What leads to a frozen pose is a defect of its own.
    before = 0 if old.kind == "frozen" and new.kind in ("jump", "teleport", "flip") else SLACK
    inside = old.start - before <= new.start and new.stop <= old.stop + SLACK
    return inside and old.kind in EXPLAINS and new.kind in EXPLAINED


def _calm(length: int, findings: Iterable[Finding]) -> tuple[int, int]:
    """The longest range of frames that no cut parts."""
    cuts = [f for f in findings if f.kind in CUTS and f.stop - f.start < length]
    return max(good_spans(length, cuts), key=lambda span: span[1] - span[0], default=(0, 0))
