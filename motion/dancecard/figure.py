"""The figure that dances: 31 joints of a person of 1.75 m, standing in a T-pose at zero rotations.

Lengths are the mean shares of stature of Drillis and Contini (1966) as given by Winter, *Biomechanics and
Motor Control of Human Movement*, figure 4.1; the spine is curved as a person's is.
"""

from __future__ import annotations

import numpy as np

from ..skeleton import Skeleton

STATURE = 1.75  # metres
THIGH, SHANK = 0.245 * STATURE, 0.246 * STATURE
ANKLE = 0.039 * STATURE  # height of the ankle above the sole
BALL = np.array([0.0, 0.024, 0.135])  # the toe joint from the point of the sole below the ankle
HEEL = np.array([0.0, 0.0, -0.055])  # where the heel touches, likewise
TOE = np.array([0.0, -0.010, 0.068])  # the tip of the toes from the toe joint
HIP = np.array([0.088, -0.065, 0.0])  # the left hip joint from the middle of the pelvis

_SPINE = (
    ("Spine", "Hips", (0.0, 0.095, -0.012)),
    ("Spine1", "Spine", (0.0, 0.125, -0.010)),
    ("Spine2", "Spine1", (0.0, 0.135, -0.018)),
    ("Neck", "Spine2", (0.0, 0.175, 0.004)),
    ("Neck1", "Neck", (0.0, 0.06, 0.016)),
    ("Head", "Neck1", (0.0, 0.06, 0.016)),
)
_LEG = (
    ("UpLeg", "Hips", tuple(HIP)),
    ("Leg", "UpLeg", (0.0, -THIGH, 0.0)),
    ("Foot", "Leg", (0.0, -SHANK, 0.0)),
    ("ToeBase", "Foot", (0.0, BALL[1] - ANKLE, BALL[2])),
)
_ARM = (
    ("Shoulder", "Spine2", (0.035, 0.135, 0.012)),
    ("Arm", "Shoulder", (0.145, -0.01, -0.020)),
    ("ForeArm", "Arm", (0.186 * STATURE * 0.93, 0.0, 0.0)),
    ("Hand", "ForeArm", (0.146 * STATURE, 0.0, 0.0)),
    ("Thumb1", "Hand", (0.03, -0.012, 0.028)),
    ("Thumb2", "Thumb1", (0.032, -0.006, 0.020)),
    ("Index1", "Hand", (0.092, 0.0, 0.022)),
    ("Index2", "Index1", (0.042, 0.0, 0.0)),
)
_ENDS = {
    "Head": (0.0, 0.175, 0.012),
    "ToeBase": tuple(TOE),
    "Thumb2": (0.028, 0.0, 0.012),
    "Index2": (0.044, 0, 0),
}


def _skeleton() -> Skeleton:
    """The joints in the order in which files list them: a limb to its end before the next one begins."""
    rows: list[tuple[str, str, tuple[float, ...]]] = [("Hips", "", (0.0, 0.0, 0.0))]
    for limb, middle in ((_LEG, _SPINE), (_ARM, ())):
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            for name, parent, (x, y, z) in limb:
                above = parent if parent in ("Hips", "Spine2") else side + parent
                rows.append((side + name, above, (sign * x, y, z)))
        rows += middle
    names = [name for name, _, _ in rows]
    parents = [names.index(parent) if parent else -1 for _, parent, _ in rows]
    ends = {}
    for j, name in enumerate(names):
        part = name.removeprefix("Left").removeprefix("Right")
        if part in _ENDS:
            ends[j] = np.array(_ENDS[part], np.float64) * [
                -1.0 if name.startswith("Right") else 1.0,
                1.0,
                1.0,
            ]
    roles = {"hips": "Hips", "spine": "Spine", "chest": "Spine2", "neck": "Neck", "head": "Head"}
    limbs = dict(
        up_leg="UpLeg", leg="Leg", foot="Foot", toe="ToeBase",
        shoulder="Shoulder", arm="Arm", forearm="ForeArm", hand="Hand",
    )  # fmt: skip
    for part, name in limbs.items():
        roles[f"left_{part}"], roles[f"right_{part}"] = "Left" + name, "Right" + name
    return Skeleton(
        tuple(names),
        np.array(parents, np.int32),
        np.array([offset for _, _, offset in rows], np.float64),
        {role: names.index(name) for role, name in roles.items()},
        ends,
    )


FIGURE = _skeleton()
