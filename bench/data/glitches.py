"""What looks wrong in motion, of clips as of a run, so that the one can be the yardstick of the other.

A pop is a joint that leaps, beyond where its velocity would have put it (`mm.metrics.pops`). A slip is what a
foot slides in one stance, from touching the ground until leaving it: the sum of `mm.metrics.skate`, which
counts the less the higher the foot is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mm import metrics, quality
from mm.database import Database
from mm.quality import Feet
from motion import contacts
from motion.skeleton import Skeleton

from .clips import Clips

Array = NDArray[np.floating]

RARE = 99.9  # percentile of the clips' own that a glitch lies beyond
SLIPS = 99.0  # of stances, of which there are some hundreds only
SEEN_CM = 3.0  # of a slip: clips without any would have every step of a run be a glitch
LEAPS = 2.0  # times the rare pop, from which a capture should be looked at
JOINED = 0.1  # seconds between two leaps that are one
STANCE = ["foot", "start", "stop", "worst", "slip_cm"]


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the clips themselves stay below: cost of the nearest frame elsewhere, pop (cm), slip (cm)."""

    cost: float
    pop_cm: float
    slip_cm: float


def pops(local: Array, clips: Clips) -> Array:
    """Pops [T], cm, of clips' joint positions [T, J, 3] in the root's space; a clip's first two frames: 0."""
    out = np.zeros(len(local))
    for start, stop in zip(clips.starts, clips.stops, strict=True):
        out[start:stop] = metrics.pops(local[start:stop])
    return out


def stances(feet: Array, touching: NDArray, fps: float, rest: Array) -> pd.DataFrame:
    """A row a stance of feet [T, C, 3], world, metres: the foot, the first frame and one past the last, where
    it slides fastest, and by how much it slides, cm.

    touching [T, C], whether each is on the ground by the data; rest [C] the height at which it stands.
    """
    steps = metrics.skate(feet, fps, rest) / fps
    stands = (np.asarray(touching)[1:] > 0) & (np.asarray(touching)[:-1] > 0)
    whole, rows = Clips.one(len(stands), fps), []
    for foot in range(stands.shape[1]):
        for start, stop in whole.passages(stands[:, foot]):
            slides = steps[start:stop, foot]
            worst = int(start + 1 + slides.argmax())
            rows.append((foot, int(start), int(stop + 1), worst, float(slides.sum())))
    return pd.DataFrame(rows, columns=STANCE)


def slips_of(database: Database, clips: Clips, feet: Feet) -> Array:
    """The slips, cm, of all stances of a database's clips."""
    found = []
    for start, stop in zip(clips.starts, clips.stops, strict=True):
        frames = clips.frames[start:stop]
        poses = database.poses[frames]
        standing = touches(database.skeleton, poses.positions, poses.rotations, feet)
        found.append(stances(standing, database.contacts[frames], database.fps, feet.rest)["slip_cm"])
    return pd.concat(found).to_numpy(float)


def touches(skeleton: Skeleton, positions: Array, rotations: Array, feet: Feet) -> Array:
    """Where feet touch the ground, world [T, C, 3], of local transforms [T, J, ..]."""
    world = quality.world_transforms(skeleton, positions, rotations)
    return contacts.place_points(*world, feet.joints, feet.points)


def bounds(cost: Array, pop: Array, slip: Array) -> Bounds:
    """Of the clips' own costs [T], pops [T] and slips [S]; a slip that nobody sees is none."""
    known = cost[np.isfinite(cost)]
    return Bounds(
        cost=float(np.percentile(known, RARE)) if len(known) else float("inf"),
        pop_cm=float(np.percentile(pop, RARE)),
        slip_cm=max(SEEN_CM, float(np.percentile(slip, SLIPS)) if len(slip) else 0.0),
    )


def leaping(local: Array, at: int) -> int:
    """The joint that pops most at a frame from 2 on, of joints [T, J, 3] in the root's space."""
    return int(np.linalg.norm(np.diff(local[at - 2 : at + 1], n=2, axis=0)[0], axis=-1).argmax())


def leaps(local: Array, pop: Array, clips: Clips, bound: float, names: Sequence[str]) -> pd.DataFrame:
    """A row a passage of clips whose pops [T] exceed a bound, the worst first.

    local [T, J, 3] are their joints in the root's space, of these names.
    """
    rows = []
    for start, stop in clips.passages(pop > bound, join=JOINED):
        at = int(start + np.argmax(pop[start:stop]))
        clip, at_s, frame = (clips.where(at, at + 1)[key] for key in ("clip", "from_s", "frame"))
        rows.append((clip, at_s, frame, names[leaping(local, at)], float(pop[at]), float(pop[at] / bound)))
    found = pd.DataFrame(rows, columns=["clip", "at_s", "frame", "joint", "pop_cm", "times"])
    return found.sort_values("pop_cm", ascending=False, kind="stable", ignore_index=True)
