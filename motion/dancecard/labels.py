"""What is known of a dance because it was planned: contacts, phase and gait, and their text form."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import files
from .curves import Array
from .feet import Foot
from .path import Path
from .steps import Stances

CONTACTS = ("left_heel", "left_toe", "right_heel", "right_toe")
GAITS = ("stand", "walk", "jog", "crouch")


@dataclass(frozen=True, eq=False)
class Labels:
    """Exact labels of T frames.

    Attributes
    ----------
    contacts : uint8 [T, 4], whether each of `CONTACTS` rests on the ground (a toe means the toe joint).
    phase : float64 [T], radians in 0 to 2 pi: 0 where the left foot strikes, pi where the right one does.
        It rests while both feet stand longer than between two steps.
    gait : uint8 [T], index into `GAITS`; who stands crouched crouches.
    """

    contacts: NDArray[np.uint8]
    phase: Array
    gait: NDArray[np.uint8]

    def __getitem__(self, frames: slice) -> Labels:
        return Labels(self.contacts[frames], self.phase[frames], self.gait[frames])

    def __len__(self) -> int:
        return len(self.phase)


def label(path: Path, stances: tuple[Stances, Stances], feet: tuple[Foot, Foot], stand: Array) -> Labels:
    """Labels of what was planned; stand [T] is the share of standing."""
    contacts = np.stack([part for foot in feet for part in (foot.heel, foot.toe)], axis=-1)
    gait = np.select([path.crouching > 0.5, stand > 0.5, path.running > 0.5], [3, 0, 2], 1)
    return Labels(contacts.astype(np.uint8), phase(path.time, stances), gait.astype(np.uint8))


def phase(time: Array, stances: tuple[Stances, Stances]) -> Array:
    """Phase at times: half a turn from strike to strike of the other foot, a whole one to the same foot's.

    It goes on evenly, but in a stand waits until just before the next foot leaves the ground.
    """
    strikes = sorted(
        (on, foot, off)
        for foot, stance in enumerate(stances)
        for on, off in zip(stance.on[1:], stance.off[:-1], strict=True)
    )
    knots, values = [time[0] - 2.0], [0.0]
    before = None
    for on, foot, off in strikes:
        step = np.pi if before is None or foot != before else 2 * np.pi
        if before is None and foot == 0:
            values[0] = np.pi
        start = max(knots[-1] + 1e-6, min(off - 0.35, on - 1e-3))
        knots += [start, on]
        values += [values[-1], values[-1] + step]
        before = foot
    return np.mod(np.interp(time, knots, values), 2 * np.pi)


def spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of true flags [T]: first frame and one past the last of each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def write(path: str | os.PathLike[str], labels: Labels) -> None:
    """Write labels as CSV, a line a frame, whole or not at all."""
    lines = [",".join(("frame", *CONTACTS, "phase", "gait"))]
    for frame, (contacts, angle, gait) in enumerate(
        zip(labels.contacts.tolist(), labels.phase.tolist(), labels.gait.tolist(), strict=True)
    ):
        lines.append(f"{frame},{','.join(map(str, contacts))},{angle:.5f},{GAITS[gait]}")
    with files.atomic(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode())
