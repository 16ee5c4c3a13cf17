"""Jumps of the whole body and flips of joints: steps between frames unlike those around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..roles import ROLES
from .body import Body
from .finding import Finding, between_steps, some

# Hips of a person jolt by up to 10 g when a foot strikes or the body falls.
# Over one frame that makes 0.11 m at 30 fps, but 7 mm at 120, where the noise of markers is more.
JOLT, LEAST_JUMP = 100.0, 0.035  # m/s², m
FASTEST = 14.0  # m/s; the fastest sprinter reached 12.4 (100 m world record of 2009)

# Ankles and wrists turn with up to 600 rad/s² when they strike (measured in runs at 30 fps, where a step is
# told from those beside it with twice the acceleration). Toes, fingers and tails jitter by more.
TWITCH = 900.0  # rad/s²
LEAST_FLIP, LEAST_FLIP_OF_ENDS = np.radians(30.0), np.radians(40.0)
FATAL_FLIP = np.radians(60.0)


def unlike_neighbours(steps: NDArray) -> NDArray[np.float64]:
    """How far each of the steps [S, ..., 3] is from the two before and the two after, on the nearer side.

    Of the two on a side the farther counts, so that a jump which a filter smeared over two steps stands out,
    and one there and back, whose steps may be alike. Ends have one side.
    """
    count = len(steps)
    before, after = np.zeros((2, *steps.shape[:-1]))
    for lag in range(1, min(3, count)):
        apart = np.linalg.norm(steps[lag:] - steps[:-lag], axis=-1)
        before[lag:] = np.maximum(before[lag:], apart)
        after[:-lag] = np.maximum(after[:-lag], apart)
    if count > 1:
        before[0], after[-1] = after[0], before[-1]
    return np.minimum(before, after)


def jumps(body: Body) -> list[Finding]:
    """Where the hips are elsewhere from one frame to the next."""
    steps = np.diff(body.world[:, body.hips], axis=0)
    lengths = np.linalg.norm(steps, axis=-1)
    limit = max(1.0, body.scale) * max(LEAST_JUMP, JOLT / body.fps**2)
    far = (lengths * body.fps > FASTEST * max(1.0, body.scale)) & (lengths > limit)
    bad = far | (np.minimum(unlike_neighbours(steps), lengths) > limit)
    found = []
    for start, stop in between_steps(bad, gap=body.gap):
        near = slice(max(start - 1, 0), min(stop, len(steps)))
        worst = near.start + int(np.argmax(lengths[near] * bad[near]))
        speed = lengths[worst] * body.fps
        kind = "teleport" if far[worst] else "jump"
        what = f"hips move {lengths[worst]:.2f} m from frame {worst} to {worst + 1} ({speed:.0f} m/s)"
        found.append(Finding(kind, start, stop, what, fatal=True))
    return found


def flips(body: Body) -> list[Finding]:
    """Where joints turn abruptly; fatal where a joint with a role, no toe, does by a lot."""
    turns = body.rotation_steps
    angles = np.linalg.norm(turns, axis=-1)
    excess = np.minimum(unlike_neighbours(turns), angles)
    limbs = {body.roles[role] for role in ROLES if role in body.roles and role != "root"}
    ends = np.ones(len(body.skeleton), bool)
    ends[list(limbs - set(body.joints(("left_toe", "right_toe"))))] = False
    least = LEAST_FLIP + ends * (LEAST_FLIP_OF_ENDS - LEAST_FLIP)
    twitch = TWITCH / max(body.scale, 1e-3) / body.fps**2
    bad: NDArray = excess > least + twitch
    found = []
    for start, stop in between_steps(np.any(bad, axis=1), gap=body.gap):
        near = slice(max(start - 1, 0), min(stop, len(turns)))
        here = np.where(bad[near], angles[near], -1.0)
        joints = np.argsort(-here.max(axis=0), kind="stable")[: int(bad[near].any(axis=0).sum())]
        worst = near.start + int(here[:, joints[0]].argmax())
        names = some([body.skeleton.names[j] for j in joints])
        turn = f"turn{'s' * (len(joints) == 1)} by {np.degrees(here[:, joints[0]].max()):.0f} degrees"
        what = f"{names} {turn} from frame {worst} to {worst + 1}"
        fatal = bool((excess[near][:, ~ends] > FATAL_FLIP + twitch / 2).any())
        found.append(Finding("flip", start, stop, what, fatal))
    return found
