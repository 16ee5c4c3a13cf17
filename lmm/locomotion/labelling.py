"""Labels of a database's frames, each range labelled as the clip that it is."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from features import contacts as touching
from features import gait as gaits
from features.labels import GAITS, Labels, label
from mm.database import Database
from motion import console, kinematics
from motion.errors import Note, UserError

NAMED = 5  # clips of a remark

_REMEDIES = {
    True: "build a database of people who walk, give labels made by hand (--labels), or train --model mann",
    False: "build a database of bodies whose hips and feet are known (--roles)",
}


@dataclass(frozen=True, eq=False)
class DatabaseLabels(Labels):
    """Labels of all frames of a database.

    Attributes
    ----------
    left_out : names of clips that cannot be labelled, and why: what their frames have here says nothing.
    """

    left_out: Mapping[str, str] = field(default_factory=dict)


def kept(database: Database, labels: Labels) -> NDArray[np.bool_]:
    """Which ranges [R] of a database its labels say something of."""
    left_out = labels.left_out if isinstance(labels, DatabaseLabels) else {}
    return np.array([name not in left_out for name in database.names], bool)


def labels_of(
    database: Database, *, phase: bool = True, given: Mapping[str, Labels] | None = None
) -> DatabaseLabels:
    """Labels of all frames.

    With a phase, of two feet, contacts are found anew, of heels and toes. Without one, of two feet or four,
    they are the database's own. given are labels to take in place of those found, by names of clips
    (`lmm.locomotion.given_labels`); where they have no phase their contacts tell it.

    Clips that cannot be labelled, such as those without a gait that can be walked where there is to be a
    phase, are left out, and a `motion.errors.Note` tells which. Where nothing is left, what touches the
    ground is not what the database says, or there is to be a phase on all fours, that is a UserError.
    """
    if phase and any(role.endswith("hand") for role in database.contact_roles):
        remedy = "build a database of people who walk, or train --model mann"
        raise UserError("a database of bodies on all fours: phases are of two feet", remedy=remedy)
    found: dict[int, Labels] = {}
    left_out: dict[str, str] = {}
    for r in console.progress(range(len(database.names)), label="labelling", unit="ranges"):
        name = database.names[r]
        try:
            own = (given or {}).get(name)
            found[r] = _range(database, r, phase) if own is None else _given(database, r, phase, own)
        except UserError as error:
            left_out.setdefault(name, error.what)
    told = {r: labels for r, labels in found.items() if database.names[r] not in left_out}
    count = len(set(database.names))
    if not told:
        what = f"none of {count} clips can be labelled: {_told(left_out)}"
        raise UserError(what, remedy=_REMEDIES[phase])
    if left_out:
        are = "is" if len(left_out) == 1 else "are"
        line = f"{len(left_out)} of {count} clips {are} left out, without labels: {_told(left_out)}"
        warnings.warn(line, Note, stacklevel=2)
    return _joined(database, told, phase, left_out)


def _range(database: Database, r: int, phase: bool) -> Labels:
    """Labels of a range, found in its motion."""
    positions, rotations = world(database, r)
    if phase:
        return label(database.skeleton, database.fps, positions, rotations)
    names = database.contact_roles
    contacts = np.asarray(database.contacts[database.starts[r] : database.stops[r]])
    gait = gaits.decide(database.skeleton, database.fps, positions, names, contacts)
    return Labels(names, contacts, None, gaits.weights(gait, database.fps))


def _given(database: Database, r: int, phase: bool, own: Labels) -> Labels:
    """Labels of a range that somebody gave, as those of `_range` are."""
    if database.mirrored[r]:
        own = own.mirrored()
    if not phase:
        return Labels(database.contact_roles, own.of_parts(database.contact_roles).contacts, None, own.gait)
    names = touching.parts(database.skeleton, world(database, r)[0])
    return own.of_parts(names) if own.phase is not None else own.of_parts(names).rephased(database.fps)


def world(database: Database, r: int) -> tuple[NDArray, NDArray]:
    """World positions [T, J, 3] and rotations [T, J, 4] of a range's joints."""
    poses = database.poses[slice(int(database.starts[r]), int(database.stops[r]))]
    return kinematics.forward(database.skeleton, poses.positions, poses.rotations)


def _joined(
    database: Database, told: Mapping[int, Labels], phase: bool, left_out: Mapping[str, str]
) -> DatabaseLabels:
    names = next(iter(told.values())).names
    if any(one.names != names for one in told.values()):
        what = "what touches the ground is not the same in all clips"
        raise UserError(what, remedy="build a database of clips that walk alike")
    unknown = [role for role in database.contact_roles if role not in names]
    if unknown:
        what = f"its contact {unknown[0]!r} is none of {', '.join(names)}"
        raise UserError(f"a database that cannot be labelled: {what}", remedy="build one of people who walk")
    contacts = np.zeros((len(database), len(names)), np.uint8)
    turns = np.zeros(len(database), np.float32) if phase else None
    gait = np.zeros((len(database), len(GAITS)), np.float32)
    for r, one in told.items():
        part = slice(int(database.starts[r]), int(database.stops[r]))
        contacts[part], gait[part] = one.contacts, one.gait
        if turns is not None:
            turns[part] = one.phase
    return DatabaseLabels(names, contacts, turns, gait, left_out=left_out)


def _told(left_out: Mapping[str, str]) -> str:
    """Clips by what is wrong with them, in a line."""
    reasons: dict[str, list[str]] = {}
    for name, why in left_out.items():
        reasons.setdefault(why, []).append(name)
    parts = []
    for why, names in reasons.items():
        more = f" and {len(names) - NAMED} more" * (len(names) > NAMED)
        parts.append(f"{', '.join(names[:NAMED])}{more} ({why})")
    return "; ".join(parts)
