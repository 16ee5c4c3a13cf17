"""What run-time retargeting to a large rig costs, beside the controller that drives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mm import courses
from mm.controller import Controller, build_index
from mm.database import Database
from mm.description import anatomy_of
from mm.driving import at_data_speeds
from mm.rigged import Rigged
from mm.settings import Settings
from motion import console, retarget, rig
from motion.anatomy import Anatomy
from motion.errors import UserError
from motion.retargeter import Retargeter
from motion.roles import SIDES

from . import crowd, timing

# Longer thighs and shorter shins than the data's, so that feet have to be brought to the ground.
_PROPORTIONS = {"leg": 1.06, "foot": 0.93}


def measure(
    database: Database,
    *,
    joints: int = rig.JOINTS,
    counts: Sequence[int] = (1, 16, 256, 1024),
    index: str = "exact",
    seconds: float = 3.0,
    repeats: int = 3,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """A row a count: mean microseconds a character and frame, one pinned thread, warm.

    us: retargeting with feet planted by the controller's locks, no_feet_us without; controller_us: the whole
    step of the controller; share: of both together; twin_us: the NumPy twin, and how many times longer.
    """
    if not counts or min(counts) < 1:
        raise UserError(f"counts {list(counts)}", remedy="give numbers of at least 1, as 1,16,256")
    settings = Settings()
    source = anatomy_of(database)
    target = large_rig(source, joints)
    shared = build_index(database, index, settings)
    course = at_data_speeds(courses.load("random"), database)
    frames = max(2, round(seconds * database.fps))
    rows = []
    for count in console.progress(counts, label="retarget", unit="counts") if progress else counts:
        controller = Controller(database, count=count, settings=settings, index=shared)
        rigged = Rigged(controller, target)
        cost = crowd.cost(rigged, course, frames, repeats)
        each = 1e6 / count
        own = float(each * cost.stages["retargeting"].mean())
        whole = float(each * sum(stage.mean() for stage in cost.stages.values()))
        twin, free = (
            each * _step_seconds(rigged, source, target, compiled=compiled, feet=feet)
            for compiled, feet in ((False, True), (True, False))
        )
        rows.append(
            {
                "characters": count,
                "joints": len(target.skeleton),
                "us": own,
                "no_feet_us": free,
                "controller_us": whole - own,
                "share": own / whole,
                "twin_us": twin,
                "twin_ratio": twin / own,
            }
        )
    return rows


def large_rig(source: Anatomy, joints: int) -> Anatomy:
    """A rig of so many joints around a skeleton, with legs of other proportions."""
    offsets = source.skeleton.offsets.copy()
    for side in SIDES:
        for part, factor in _PROPORTIONS.items():
            offsets[source.skeleton.roles[f"{side}_{part}"]] *= factor
    small = replace(source.skeleton, offsets=offsets)
    return retarget.anatomy_like(rig.enlarge(small, joints), source)


def _step_seconds(rigged: Rigged, source: Anatomy, target: Anatomy, *, compiled: bool, feet: bool) -> float:
    """Least seconds of a step on the controller's last poses."""
    controller = rigged.controller
    roles = controller.description.contact_roles if feet else ()
    retargeter = Retargeter(source, target, rigged.count, contact_roles=roles, compiled=compiled)
    contacts = controller.planted() if feet else None
    poses = controller.poses()
    with timing.single_thread():
        times = timing.best_of(lambda: retargeter.step(poses, contacts, 1 / rigged.fps), repeats=5)
    return float(np.min(times))
