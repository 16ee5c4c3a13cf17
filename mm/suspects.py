"""Remarks on clips that a person should look at: broken captures, and motion without a foothold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motion import kinematics
from motion.clip import Clip

from .database import Database

FASTEST, LOWEST = 15.0, -0.3  # m/s and m; no hips get there
MOVING, TOUCHING = 0.5, 0.05  # m/s; share of the frames
SHOWN = 5


def captures(clips: Sequence[Clip], names: Sequence[str], dropped: Sequence[int]) -> list[str]:
    """Remarks on clips whose hips jump or sink into the ground; dropped frames before them count, too."""
    fast, low = [], []
    for clip, name, before in zip(clips, names, dropped, strict=True):
        hips = _hips(clip)
        speeds = np.linalg.norm(np.diff(hips, axis=0), axis=-1) * clip.fps
        worst, lowest = int(speeds.argmax()), int(hips[:, 1].argmin())
        if speeds[worst] > FASTEST:
            fast.append(f"{name} ({speeds[worst]:.0f} m/s to frame {before + worst + 1})")
        if hips[lowest, 1] < LOWEST:
            low.append(f"{name} ({hips[lowest, 1]:.2f} m at frame {before + lowest})")
    found = (f"hips faster than {FASTEST:g} m/s", fast), (f"hips {-LOWEST:g} m or more below the ground", low)
    return [f"a broken capture? {what}: {_some(where)}" for what, where in found if where]


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


def _hips(clip: Clip) -> NDArray[np.float64]:
    """World positions of the hips [T, 3], of joint 0 where no joint has that role."""
    skeleton = clip.skeleton
    joint = skeleton.roles.get("hips", 0)
    if joint == 0:
        return clip.positions[:, 0]
    return kinematics.forward(skeleton, clip.positions, clip.rotations)[0][:, joint]
