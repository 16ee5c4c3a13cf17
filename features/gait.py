"""Which gait a body goes in: standing, walking, jogging, crouching, jumping or something else.

Physics tells them apart. A run has flight in every step, in which the body falls freely; a walk has none. A
jump's flight lasts longer than that of any runner. Who crouches holds hips and head low, who sits, kneels or
lies holds the hips lower than legs can walk. Heights count in lengths of the leg, speeds beside what a
pendulum of that length falls at, so that the same numbers hold for small and large bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from motion import root
from motion.roles import SIDES
from motion.skeleton import Skeleton

from . import contacts as touching

Array = NDArray[np.floating]

GAITS = ("stand", "walk", "jog", "crouch", "jump", "other")
STAND, WALK, JOG, CROUCH, JUMP, OTHER = range(len(GAITS))
GRAVITY = 9.81

# Who shifts the weight sways at 0.2 m/s, the slowest purposeful walk goes at about 0.3; turning likewise.
MOVING, TURNING = 0.25, 0.5  # m/s, rad/s
SWAY = 0.2  # seconds, standard deviation of the filter of that speed
# Footfalls a second: who takes more than the first steps, if on the spot; a walk takes 2 at most, a run has
# at least 2.5, also a slow one that hardly leaves the ground but bounces by more than a walk's 0.3 g.
STEPPING, QUICK, BOUNCE = 1.6, 2.2, 0.35
CADENCE = 0.5  # seconds, standard deviation of the filter of footfalls
# In flight nothing touches the ground and the hips fall with a third of gravity or more; of a stride that
# takes 0.7 s two flights of some 0.1 s are a run's. Missed contacts alone do not make the hips fall.
FALLING, STRIDE, FLIGHT = 0.3, 0.7, 0.05
# Walks end at a Froude number v^2 / (g l) of about 0.5; none is possible above 1, when feet would
# lift off (Alexander 1989).
RUNNING = 0.8
JUMPING = 0.24  # seconds of flight, which raise the body by 7 cm; those of runners last 0.2 at most
LANDING = 0.15  # seconds before and after a flight that belong to the jump
# Heights of hips and head above the lower ankle, beside a straight body's. Runners bend their knees to 0.78
# but hold the head above 0.85 unless they duck.
LOW_HIPS, LOW_HEAD, DUCKED_HEAD = 0.8, 0.84, 0.75
DOWN_HIPS, DOWN_HEAD = 0.45, 0.5  # below them nobody goes on two feet

SMOOTH = 0.15  # seconds, standard deviation of the filter that blends the weights at changes
BRIEF = 0.5  # seconds: shorter spells are taken for what is around them


def decide(
    skeleton: Skeleton, fps: float, positions: Array, names: Sequence[str], contacts: NDArray[Any]
) -> NDArray[np.int64]:
    """Index into `GAITS` of each frame [T].

    positions [T, J, 3] are world positions, metres; contacts [T, C] are of the parts named (see
    `features.contacts`). The skeleton needs the roles hips and feet; without a head only the hips tell of
    crouching. On all fours, heads say nothing, and hands are feet.
    """
    frames = len(positions)
    if frames == 0:
        return np.zeros(0, np.int64)
    fours = any(name.endswith("hand") for name in names)
    body = _Body(skeleton, positions, use_head=not fours)
    hips = positions[:, skeleton.role("hips")]
    speed = np.hypot(*(_rate(hips[:, axis], SWAY, fps) for axis in (0, 2)))
    across = root.across(skeleton, positions)
    turning = np.abs(_rate(np.unwrap(np.arctan2(across[:, 0], across[:, 2])), SWAY, fps))

    on = np.any(np.asarray(contacts) != 0, axis=1)
    touching.clean(on, fps)
    height = ndimage.gaussian_filter1d(body.hips, 0.03 * fps, mode="nearest")
    fall = -_gradient(_gradient(height)) * fps * fps / GRAVITY
    flight = ~on & (fall > FALLING)
    leaps = [span for span in touching.spans(flight) if span[1] - span[0] >= JUMPING * fps]
    for start, stop in leaps:
        flight[start:stop] = False
    bounce = np.sqrt(np.maximum(_mean(fall**2, STRIDE, fps), 0))
    cadence = _cadence(touching.feet(names, contacts, fps), fps)

    moves = (speed > MOVING) | (turning > TURNING) | (cadence > STEPPING)
    fast = speed > RUNNING * np.sqrt(GRAVITY * body.leg)
    runs = (_mean(flight, STRIDE, fps) > FLIGHT) | ((bounce > BOUNCE) & (cadence > QUICK)) | fast
    low, head = _mean(body.hip_share, BRIEF, fps), _mean(body.head_share, BRIEF, fps)
    gait = np.where(runs, JOG, np.where(moves, WALK, STAND))
    gait[(low < LOW_HIPS) & (head < np.where(runs, DUCKED_HEAD, LOW_HEAD))] = CROUCH
    gait[(low < DOWN_HIPS) | (head < DOWN_HEAD)] = OTHER
    gait = settle(gait, fps)
    around = round(LANDING * fps)
    for start, stop in leaps:
        part = slice(max(0, start - around), stop + around)
        gait[part] = np.where(gait[part] == OTHER, OTHER, JUMP)
    return gait


def weights(gait: NDArray[np.integer], fps: float, *, smooth: float = SMOOTH) -> NDArray[np.float32]:
    """Weights [T, 6] that sum to 1 of gaits [T]: smoothed over time, so that one blends into the next."""
    chosen = np.eye(len(GAITS))[gait]
    if smooth > 0 and len(gait):
        chosen = ndimage.gaussian_filter1d(chosen, smooth * fps, axis=0, mode="nearest")
    # No traces that a person could not see in a file.
    chosen[chosen < 0.005] = 0.0
    return (chosen / np.maximum(chosen.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)


def settle(gait: NDArray[np.integer], fps: float) -> NDArray[np.int64]:
    """Gaits [T] without spells shorter than `BRIEF`: each has what most frames around it have."""
    counts = np.stack([_mean(gait == k, 2 * BRIEF, fps) for k in range(len(GAITS))], axis=-1)
    return counts.argmax(axis=1)


class _Body:
    """How high a body is held over its feet.

    Attributes
    ----------
    leg : length of the legs from the thighs' joints to the ankles, metres.
    hips : [T] height of the thighs' joints, metres.
    hip_share, head_share : [T] height of hips and head above the lower ankle, beside a straight body's.
    """

    def __init__(self, skeleton: Skeleton, positions: Array, *, use_head: bool) -> None:
        roles = skeleton.roles
        feet = [skeleton.role(f"{side}_foot") for side in SIDES]
        tops = [roles.get(f"{side}_up_leg", skeleton.role("hips")) for side in SIDES]
        self.leg = float(
            np.mean([_length(skeleton, positions, *ends) for ends in zip(tops, feet, strict=True)])
        )
        low = positions[:, feet, 1].min(axis=1)
        self.hips = positions[:, tops, 1].mean(axis=1)
        self.hip_share = (self.hips - low) / self.leg
        if not use_head:
            self.head_share = np.full(len(positions), np.inf)
        elif "head" not in roles:
            self.head_share = self.hip_share + LOW_HEAD - LOW_HIPS
        else:
            head = positions[:, roles["head"]]
            trunk = np.linalg.norm(head - positions[:, tops].mean(axis=1), axis=-1)
            straight = self.leg + float(np.percentile(trunk, 95))
            self.head_share = (head[:, 1] - low) / straight


def _length(skeleton: Skeleton, positions: Array, top: int, end: int) -> float:
    """Length of the bones from a joint down to another, metres; their distance, where it is not below."""
    try:
        chain = skeleton.chain(end, top)
    except ValueError:
        chain = [top, end]
    bones = np.diff(positions[:: max(1, len(positions) // 200), chain], axis=1)
    return max(float(np.median(np.linalg.norm(bones, axis=-1).sum(axis=1))), 1e-3)


def _gradient(values: Array) -> Array:
    return np.gradient(values) if len(values) > 1 else np.zeros_like(values)


def _rate(values: Array, smooth: float, fps: float) -> Array:
    """Rate of change [T] per second, smoothed by a Gaussian of a standard deviation in seconds."""
    return _gradient(ndimage.gaussian_filter1d(values, smooth * fps, mode="nearest")) * fps


def _cadence(feet: NDArray[np.bool_], fps: float) -> Array:
    """Footfalls a second [T] of feet [T, 2] that stand or not, over `CADENCE` seconds."""
    falls = np.zeros(len(feet))
    falls[1:] = (feet[1:] & ~feet[:-1]).sum(axis=1)
    return ndimage.gaussian_filter1d(falls, CADENCE * fps, mode="nearest") * fps


def _mean(values: NDArray[Any], seconds: float, fps: float) -> Array:
    """Mean of values [T] over a window around each frame."""
    size = max(1, round(seconds * fps))
    return ndimage.uniform_filter1d(np.asarray(values, np.float64), size, mode="nearest")
