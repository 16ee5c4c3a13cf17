"""Moments worth looking at in what a character did: its jumps, its sliding feet, where nothing fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm import metrics
from motion import contacts, kinematics
from motion.errors import UserError

from .timeline import Timeline

SLIDE_SPEED = 2 * contacts.SPEED  # m/s: a foot is told to touch where it is slower than half of that
SLIDE_LENGTH = 0.05  # metres: half the width of a foot
SLIDE_SMOOTHING = 0.05  # seconds
PEAK_SHARE, PEAK_RATIO = 0.95, 2.0

Steps = NDArray[np.int64]
KINDS = ("transition", "slide", "peak")


def of(timeline: Timeline, contact_roles: Sequence[str] | None = None) -> dict[str, Steps]:
    """The steps of each of `KINDS` that a timeline remembers; none of a kind that is not told.

    contact_roles : what the contacts recorded are of; None: those that are told by default.
    """
    timeline = timeline.held()
    found = dict.fromkeys(KINDS, np.zeros(0, np.int64))
    names = timeline.names
    if "transition" in names:
        found["transition"] = np.flatnonzero(timeline.stack("transition"))
    found["slide"] = _slides(timeline, contact_roles)
    if "feature_costs" in names:
        found["peak"] = peaks(costs(timeline), timeline.stack("searched"))
    return {kind: timeline.first + steps for kind, steps in found.items()}


def costs(timeline: Timeline, *, since: int = 0) -> NDArray[np.floating]:
    """What plays on after the last search costs for its query [T], of the steps remembered since a step; NaN
    before the first search."""
    played = timeline.stack("feature_costs", since=since).astype(np.float64).sum(axis=1)
    return np.where(np.isnan(timeline.stack("cost_current", since=since)), np.nan, played)


def peaks(costs: ArrayLike, searched: ArrayLike) -> Steps:
    """Where what was played fitted worst: the dearest search of each run of dear ones.

    costs [T] of what was played, which count where there was a search, searched [T]. Dear is what belongs to
    the dearest twentieth and costs twice the median, so that motion that fits well has no peaks: costs have
    long tails, whose ends a user's sharpest turns are.
    """
    costs, at = np.asarray(costs, np.float64), np.flatnonzero(searched)
    at = at[np.isfinite(costs[at])]
    if not len(at):
        return at
    values = costs[at]
    dear = (values >= np.quantile(values, PEAK_SHARE)) & (values > PEAK_RATIO * np.median(values))
    return np.array([at[a + int(np.argmax(values[a:b]))] for a, b in _runs(dear)], np.int64)


def slides(
    feet: ArrayLike, touching: ArrayLike, fps: float, *, cuts: ArrayLike | None = None
) -> list[tuple[int, int, int]]:
    """Stretches in which a foot that is to stand slides: first frame, last frame, foot; by first frame.

    feet [T, C, 3] world positions of what touches, metres; touching [T, C] as the data or a network has it;
    cuts [T], frames that the one before does not lead to. A foot slides while it touches and goes along the
    ground, averaged over 0.05 s, at 0.3 m/s or more, if it comes 5 cm far. Contacts are told by feet being
    slower than 0.15 m/s, so that no captured clip slides: what does was moved, blended or cut.
    """
    feet, touching = np.asarray(feet, np.float64)[..., [0, 2]], np.asarray(touching, bool)
    if len(feet) < 2:
        return []
    both = touching[1:] & touching[:-1]
    if cuts is not None:
        both &= ~np.asarray(cuts, bool)[1:, None]
    speed = np.linalg.norm(np.diff(feet, axis=0), axis=-1) * fps
    fast = metrics.smooth(np.where(both, speed, 0), fps, SLIDE_SMOOTHING) >= SLIDE_SPEED
    found = []
    for c in range(feet.shape[1]):
        for a, b in _runs(fast[:, c] & both[:, c]):
            if np.linalg.norm(feet[b, c] - feet[a, c]) >= SLIDE_LENGTH:
                found.append((a, b, c))
    return sorted(found)


def after(steps: ArrayLike, step: int) -> int | None:
    """The first of rising steps after a step."""
    steps = np.asarray(steps)
    at = int(np.searchsorted(steps, step, side="right"))
    return int(steps[at]) if at < len(steps) else None


def before(steps: ArrayLike, step: int) -> int | None:
    """The last of rising steps before a step."""
    steps = np.asarray(steps)
    at = int(np.searchsorted(steps, step, side="left"))
    return int(steps[at - 1]) if at else None


def touches(
    timeline: Timeline, contact_roles: Sequence[str] | None = None, *, since: int = 0
) -> NDArray[np.floating] | None:
    """World positions [T, C, 3] of what touches the ground, of the steps remembered since a step.

    contact_roles : see `of`. None where they do not fit the contacts recorded, or the body has no feet.
    """
    if "contacts" not in timeline.names:
        return None
    skeleton = timeline.skeleton
    positions, rotations = (
        timeline.stack(name, since=since).astype(np.float64) for name in ("positions", "rotations")
    )
    world = kinematics.forward(skeleton, positions, rotations)
    try:
        roles = contacts.contact_roles(skeleton, world[0]) if contact_roles is None else contact_roles
    except UserError:
        return None
    if len(roles) != timeline.record(timeline.last)["contacts"].shape[0]:
        return None
    return contacts.place_points(*world, *contacts.touching_points(skeleton, roles))


def _slides(timeline: Timeline, contact_roles: Sequence[str] | None) -> Steps:
    """The steps with which slides begin."""
    feet = touches(timeline, contact_roles)
    if feet is None:
        return np.zeros(0, np.int64)
    found = slides(feet, timeline.stack("contacts"), timeline.fps, cuts=timeline.cuts())
    return np.unique([first + 1 for first, _, _ in found]).astype(np.int64)


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index, and one past the last, of each run of flags [T] that are set."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
