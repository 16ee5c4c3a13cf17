"""Remarks on clips of a database that a person should look at: motion without a foothold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .database import Database

MOVING, TOUCHING = 0.5, 0.05  # m/s; share of the frames
SHOWN = 5


def contacts(database: Database) -> list[str]:
    """Remarks on clips that move and hardly ever have a foot on the ground."""
    found = []
    feet = [i for i, role in enumerate(database.contact_roles) if role.endswith(("toe", "foot"))]
    own = np.flatnonzero(~database.mirrored)
    for name, start, stop in zip(
        (database.names[r] for r in own), database.starts[own], database.stops[own], strict=True
    ):
        steps = np.diff(database.poses.positions[start:stop, 0], axis=0)
        speed = np.linalg.norm(steps, axis=-1).mean() * database.fps
        touching = database.contacts[start:stop][:, feet].mean(axis=0)
        if feet and speed > MOVING and (touching < TOUCHING).all():
            found.append(f"{name} ({speed:.1f} m/s)")
    if not found:
        return []
    share = f"less than {TOUCHING:.0%} of the frames"
    what = f"{len(found)} of {len(own)} clips move but touch the ground in {share}"
    return [f"{what}, so that no foot is held: {_some(found)}"]


def _some(where: Sequence[str]) -> str:
    return ", ".join(where[:SHOWN]) + f" and {len(where) - SHOWN} more" * (len(where) > SHOWN)
