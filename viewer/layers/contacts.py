"""Feet on the ground: those that touch by what is played, and those that are held where they are."""

from __future__ import annotations

import numpy as np

from motion import contacts
from motion.errors import UserError

from ..scene import Layer, Points
from . import colours
from .moment import Moment


def touching(moment: Moment) -> dict[str, Layer]:
    """A yellow point at what touches, with a red one in it where it is held."""
    record, member = moment.record, moment.member
    if "contacts" not in record:
        return {}
    positions, rotations = moment.world
    skeleton = member.timeline.skeleton
    try:
        roles = member.contact_roles or contacts.contact_roles(skeleton, positions[None])
    except UserError:
        return {}
    if len(roles) != len(record["contacts"]):
        return {}
    spots = contacts.place_points(positions, rotations, *contacts.touching_points(skeleton, roles))
    down = record["contacts"] > 0
    held = np.asarray(record.get("locked", np.zeros(len(down)))) > 0
    return {
        "touching": Points(positions=spots[down], colours=colours.TOUCHING, size=20.0, through=0.8),
        "held": Points(positions=spots[held], colours=colours.HELD, size=9.0, through=0.9),
    }
