"""Labels of a database's frames, each range labelled as the clip that it is."""

from __future__ import annotations

import numpy as np

from features.labels import Labels, label
from mm.database import Database
from motion import kinematics
from motion.errors import UserError


def labels_of(database: Database, *, phase: bool = True) -> Labels:
    """Labels of all frames; without phase for motion that has none.

    A range without a gait that can be walked (see `features.labels.label`) is a UserError that names its
    clip; so is a database of which a contact (`contact_roles`) is not among those labelled.
    """
    found = []
    for name, start, stop in zip(
        database.names, database.starts.tolist(), database.stops.tolist(), strict=True
    ):
        poses = database.poses[slice(start, stop)]
        world = kinematics.forward(database.skeleton, poses.positions, poses.rotations)
        try:
            found.append(label(database.skeleton, database.fps, *world, phase=phase))
        except UserError as error:
            # What helps who labels files, such as to leave the phase out, does not help here.
            remedy = "build a database without it, of motion on two feet that walk"
            raise UserError(f"clip {name}: {error.what}", path=error.path, remedy=remedy) from error
    names = found[0].names
    if any(one.names != names for one in found):
        what = "what touches the ground is not the same in all clips"
        raise UserError(what, remedy="build a database of clips that walk alike")
    unknown = [role for role in database.contact_roles if role not in names]
    if unknown:
        what = f"its contact {unknown[0]!r} is none of {', '.join(names)}"
        raise UserError(f"a database that cannot be labelled: {what}", remedy="build one of people who walk")
    return Labels(
        names,
        np.concatenate([one.contacts for one in found]),
        np.concatenate([np.asarray(one.phase) for one in found]) if phase else None,
        np.concatenate([one.gait for one in found]),
    )
