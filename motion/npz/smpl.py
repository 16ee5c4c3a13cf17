"""Files of the SMPL family (SMPL, SMPL-H, SMPL-X), such as AMASS has: poses without their skeleton.

Loper et al., "SMPL: a skinned multi-person linear model", 2015; Romero et al., "Embodied hands", 2017;
Pavlakos et al., "Expressive body capture", 2019; Mahmood et al., "AMASS", 2019. At rest the body stands in a
T, Y up, facing +Z, and the pelvis is at ``trans`` plus its place in the model.

The bones' lengths are the licensed body model's. They come from, in this order: the file's own rest pose
(keys J, joints, rest_joints, rest_positions or offsets); such a file called ``skeleton.npz`` in the same
folder or one of the two above, which may also be a clip of a skeleton with these joint names; or, with a
`motion.errors.Note`, from the lengths of segments by stature of Drillis and Contini (1966; in Winter,
"Biomechanics and Motor Control of Human Movement", 4th ed. 2009, figure 4.1) with hip joint centres by Bell,
Pedersen and Brand (1990) and the spine, hands and face by eye. Its stature is the one with which the feet of
this clip stand on the ground, if a person can be so tall. The pelvis' place in the model, some centimetres
ahead of and tens below its origin, is then not known, and taken as the origin.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import files, kinematics, quat
from ..errors import Note
from ..skeleton import Skeleton
from .archive import Archive

Array = NDArray[np.float64]

_BODY = (
    *("pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2"),
    *(
        "left_ankle",
        "right_ankle",
        "spine3",
        "left_foot",
        "right_foot",
        "neck",
        "left_collar",
        "right_collar",
    ),
    *("head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
)
_BODY_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_HANDS = tuple(f"{side}_{finger}{i}" for side in ("left", "right") for finger in _FINGERS for i in (1, 2, 3))
_FACE = ("jaw", "left_eye", "right_eye")
LAYOUTS: dict[int, tuple[str, ...]] = {
    22: _BODY,
    24: (*_BODY, "left_hand", "right_hand"),
    52: (*_BODY, *_HANDS),
    55: (*_BODY, *_FACE, *_HANDS),
}
"""Joint names by their number: the body alone, SMPL, SMPL-H and SMPL-X."""

SKELETON = "skeleton.npz"  # a file of this name lends its rest pose, and is no clip
NOT_CLIPS = ("skeleton.npz", "shape.npz", "*_stagei.npz")  # the latter are AMASS's shapes of bodies

STATURE = 1.7  # metres, where the clip does not show one
_STATURES = (1.4, 2.1)
_SOLES = {"ankle": 0.039, "foot": 0.01}  # heights of joints over the ground, in statures
_APPROXIMATE = (
    "SMPL files do not say how long bones are, so they are those of an average person as tall as the motion "
    f"suggests; for the true ones put a {SKELETON} with the body model's joints (key J, [joints, 3] metres) "
    "beside them"
)


def parents(names: Sequence[str]) -> NDArray[np.int32]:
    """Parents [J] of one of the layouts' joints."""
    place = {name: j for j, name in enumerate(names)}
    out = list(_BODY_PARENTS)
    for name in names[len(_BODY) :]:
        side, _, part = name.partition("_")
        if name == "jaw" or part == "eye":
            out.append(place["head"])
        elif part == "hand" or part.endswith("1"):
            out.append(place[f"{side}_wrist"])
        else:
            out.append(place[f"{side}_{part[:-1]}{int(part[-1]) - 1}"])
    return np.array(out, np.int32)


def skeleton_file(path: Path) -> Path | None:
    """The ``skeleton.npz`` that belongs to a file: in its folder or one of the two above."""
    folder = Path(path).resolve().parent
    for place in (folder, *folder.parents[:2]):
        if path.name != SKELETON and files.kind(place / SKELETON) == "file":
            return place / SKELETON
    return None


def is_z_up(turns: Array) -> bool:
    """Whether the bodies of root rotations [T, 4] stand along Z, as in AMASS, and not along Y."""
    up = quat.rotate(turns, np.array([0.0, 1.0, 0.0])).mean(axis=0)
    return not (up[1] > 0.7 and up[1] > abs(up[2]))


def approximate(names: Sequence[str], rotations: Array, root: Array) -> Skeleton:
    """The skeleton that stands in for an unknown one, see above.

    rotations [T, J, 4] and root [T, 3] (metres, Y up, over the ground at 0) are the clip's.
    """
    warnings.warn(_APPROXIMATE, Note, stacklevel=2)
    unit = rest(names, 1.0)
    some = np.unique(np.linspace(0, len(root) - 1, 2000).astype(int))
    bones = np.repeat(unit.offsets[None], len(some), axis=0)
    bones[:, 0] = 0
    height = kinematics.forward(unit, bones, np.ascontiguousarray(rotations[some]))[0][..., 1]
    soles = [
        height[:, names.index(f"{s}_{part}")] - up for part, up in _SOLES.items() for s in ("left", "right")
    ]
    # The foot nearest to the ground is at root + stature * lowest; in a tenth of all frames it is to be at 0.
    lowest = np.maximum(-np.min(soles, axis=0), 1e-3)
    stature = float(np.percentile(root[some, 1] / lowest, 10))
    return rest(names, stature if _STATURES[0] <= stature <= _STATURES[1] else STATURE)


def rest(names: Sequence[str], stature: float) -> Skeleton:
    """A skeleton of one of the layouts by stature (metres), in a T, Y up, facing +Z, its pelvis at 0."""
    places = {
        "pelvis": (0, 0.58, 0),
        **{"spine1": (0, 0.64, -0.01), "spine2": (0, 0.715, -0.01), "spine3": (0, 0.75, 0)},
        **{"neck": (0, 0.855, -0.01), "head": (0, 0.9, 0.01)},
        **{"jaw": (0, 0.895, 0.02), "left_eye": (0.018, 0.936, 0.05), "right_eye": (-0.018, 0.936, 0.05)},
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hand = 0.11 + 0.186 + 0.146
        limbs = {
            **{"hip": (0.36 * 0.14, 0.53, 0), "knee": (0.36 * 0.14, 0.285, 0)},
            **{"ankle": (0.36 * 0.14, 0.039, -0.01), "foot": (0.36 * 0.14, 0.01, 0.066)},
            **{"collar": (0.045, 0.81, 0), "shoulder": (0.11, 0.818, 0)},
            **{"elbow": (0.11 + 0.186, 0.818, 0), "wrist": (hand, 0.818, 0), "hand": (hand + 0.05, 0.818, 0)},
        }
        for i in range(3):
            for finger, across in (("index", 0.013), ("middle", 0.004), ("ring", -0.004), ("pinky", -0.013)):
                limbs[f"{finger}{i + 1}"] = (hand + 0.054 + 0.019 * i, 0.818, across)
            limbs[f"thumb{i + 1}"] = (hand + 0.014 + 0.017 * i, 0.814, 0.014 + 0.007 * i)
        places |= {f"{side}_{part}": (sign * x, y, z) for part, (x, y, z) in limbs.items()}
    world = stature * (np.array([places[name] for name in names]) - places["pelvis"])
    above = parents(names)
    offsets = np.concatenate([world[:1], world[1:] - world[above[1:]]])
    ends = {names.index(f"{side}_foot"): np.array([0, 0, 0.038 * stature]) for side in ("left", "right")}
    ends[names.index("head")] = np.array([0, 0.1 * stature, 0])
    return Skeleton(tuple(names), above, offsets, end_sites=ends)


def poses(archive: Archive) -> tuple[tuple[str, ...], Array] | None:
    """The joint names and axis-angles [T, J, 3] of an SMPL file; None if it is none."""
    if "poses" in archive.headers and archive.first(("parents", "kintree_table", "hierarchy")) is None:
        shape = archive.headers["poses"].shape
        if len(shape) == 2 and shape[1] % 3 == 0 and shape[1] // 3 in LAYOUTS:
            return LAYOUTS[shape[1] // 3], archive.numbers("poses").reshape(shape[0], shape[1] // 3, 3)
        if len(shape) == 3 and shape[1] in LAYOUTS and shape[2] == 3:
            return LAYOUTS[shape[1]], archive.numbers("poses")
    for first, body, others in (
        ("root_orient", "pose_body", ("pose_jaw", "pose_eye", "pose_hand")),
        (
            "global_orient",
            "body_pose",
            ("jaw_pose", "leye_pose", "reye_pose", "left_hand_pose", "right_hand_pose"),
        ),
    ):
        if first in archive.headers and body in archive.headers:
            return _joined(archive, first, body, others)
    return None


def _joined(
    archive: Archive, first: str, body: str, others: Sequence[str]
) -> tuple[tuple[str, ...], Array] | None:
    """Poses of a file that keeps the body's parts apart; parts of a layout that it lacks are at rest."""
    parts = {key: archive.numbers(key) for key in (first, body)}
    frames = len(parts[first]) if parts[first].ndim else 0
    extra = {key: archive.numbers(key) for key in others if key in archive.headers}
    for key, values in (parts | extra).items():
        if values.ndim < 2 or len(values) != frames or values[:1].size % 3 or frames == 0:
            raise archive.fault(
                f"{key} is {archive.headers[key]}, expected [frames, 3 joints]",
                f"the file has {archive.listing()}",
            )
    whole = np.concatenate([part.reshape(frames, -1, 3) for part in parts.values()], axis=1)
    if whole.shape[1] < len(_BODY):
        return None
    tail = [values.reshape(frames, -1, 3) for values in extra.values()]
    joints = sum(part.shape[1] for part in tail)
    if whole.shape[1] == len(_BODY) and joints in (len(_HANDS), len(_FACE) + len(_HANDS)):
        whole = np.concatenate([whole, *tail], axis=1)
    names = LAYOUTS.get(whole.shape[1])
    return None if names is None else (names, whole)
