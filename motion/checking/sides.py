"""Left and right, front and back: whether the left lies to the left of where knees and toes point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..roles import SIDES
from .body import Body
from .finding import Finding, spans

BENT = 0.04  # legs by which a knee must stand out of the line from thigh to ankle to show where it points
ALONG = 0.5  # cosine from which on a foot points along the body's facing, or against it
TOLD = 0.1  # share of the frames in which knees or toes must point somewhere to be asked
MOST = 0.5  # share of right frames less that of wrong ones; below minus this the whole clip is meant
LASTING = 0.5  # seconds; legs that cross in side steps and turns uncross sooner
CROSSED = 0.25  # legs by which the left foot is right of the right one


def findings(body: Body) -> list[Finding]:
    """Swapped sides, backward knees or feet, swapped arms; and spans of these, and of crossed legs."""
    if body.forward is None:
        return []
    knees, toes, arms = (
        _sign(knee_bends(body), BENT * body.leg),
        _sign(toe_directions(body), ALONG),
        _arms(body),
    )
    whole = {"knees": _mostly_wrong(knees), "toes": _mostly_wrong(toes), "arms": _mostly_wrong(arms)}
    if (whole["knees"] and (whole["toes"] or not toes.any())) or (whole["toes"] and not knees.any()):
        who = " and ".join(name for name, votes in (("knees", knees), ("toes", toes)) if votes.any())
        what = f"left and right are swapped: {who} point backwards if what is called left is left"
    elif whole["knees"]:
        what = "the knees bend backwards"
    elif whole["toes"]:
        what = "the toes point backwards"
    elif whole["arms"]:
        what = "the left arm is on the side of the right leg"
    else:
        return _for_a_while(body, knees, toes, arms)
    return [Finding("sides", 0, len(body), what, fatal=True)]


def _for_a_while(body: Body, knees: NDArray, toes: NDArray, arms: NDArray) -> list[Finding]:
    crossed = _crossing(body) > CROSSED * body.leg
    reasons = (
        ((knees < 0) & (toes <= 0), "knees and toes point backwards if what is called left is left"),
        (arms < 0, "the left arm is on the side of the right leg"),
        (crossed, "the left foot is far on the right of the right foot"),
    )
    found = []
    for flags, why in reasons:
        for start, stop in spans(flags, gap=body.gap // 2):
            if body.seconds(start, stop) >= LASTING:
                what = f"{why}, for {body.seconds(start, stop):.1f} s"
                found.append(Finding("sides", start, stop, what, fatal=True))
    return found


def knee_bends(body: Body) -> NDArray[np.float64]:
    """How far the knees [T, 2] stand before the line from thigh to ankle, metres; none without roles."""
    found = []
    for side in SIDES:
        chain = body.joints(f"{side}_{part}" for part in ("up_leg", "leg", "foot"))
        if not chain:
            return np.zeros((len(body), 0))
        thigh, knee, ankle = (body.world[:, joint] for joint in chain)
        line = ankle - thigh
        share = ((knee - thigh) * line).sum(axis=-1) / np.maximum((line * line).sum(axis=-1), 1e-9)
        found.append(((knee - thigh - share[:, None] * line) * body.forward).sum(axis=-1))
    return np.stack(found, axis=-1)


def toe_directions(body: Body) -> NDArray[np.float64]:
    """Cosine between where the feet [T, 2] point and where the body faces; none without toes."""
    found = []
    for side in SIDES:
        chain = body.joints(f"{side}_{part}" for part in ("foot", "toe"))
        if not chain:
            return np.zeros((len(body), 0))
        along = body.world[:, chain[1]] - body.world[:, chain[0]]
        found.append((along * body.forward).sum(axis=-1) / np.maximum(np.linalg.norm(along, axis=-1), 1e-9))
    return np.stack(found, axis=-1)


def _sign(values: NDArray, least: float) -> NDArray[np.int8]:
    """Per frame [T] what the values [T, 2] of both sides say, 1 or -1; 0 where none is sure or both are."""
    right, wrong = (values > least).any(axis=1), (values < -least).any(axis=1)
    return np.subtract(right, wrong, dtype=np.int8)


def _arms(body: Body) -> NDArray[np.int8]:
    """Per frame [T] whether the left arm is to the left of the right one, by the legs' left."""
    joints = body.joints(f"{side}_arm" for side in SIDES)
    if not joints or "left_up_leg" not in body.roles:
        return np.zeros(len(body), np.int8)
    apart = (body.world[:, joints[0]] - body.world[:, joints[1]]) * [1.0, 0.0, 1.0]
    cosine = (apart * body.left).sum(axis=-1) / np.maximum(np.linalg.norm(apart, axis=-1), 1e-9)
    return _sign(cosine[:, None], ALONG)


def _crossing(body: Body) -> NDArray[np.float64]:
    """How far the left foot is to the right of the right foot [T], metres."""
    joints = body.joints(f"{side}_foot" for side in SIDES)
    if not joints:
        return np.zeros(len(body))
    return ((body.world[:, joints[1]] - body.world[:, joints[0]]) * body.left).sum(axis=-1)


def _mostly_wrong(signs: NDArray[np.int8]) -> bool:
    told = signs != 0
    return bool(told.mean() > TOLD and signs[told].mean() < -MOST)
