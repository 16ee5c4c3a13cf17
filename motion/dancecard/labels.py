"""What is known of a dance because it was planned: contacts, phase and gait, and their text form."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import files, strides
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
    phase : float64 [T], radians in 0 to 2 pi: 0 where the right foot strikes, pi where the left one does,
        slow while both stand (`motion.strides`).
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
    stood = [np.stack([s.array("on"), s.array("off")], axis=-1) for s in stances]
    contacts = np.stack([part for foot in feet for part in (foot.heel, foot.toe)], axis=-1)
    gait = np.select([path.crouching > 0.5, stand > 0.5, path.running > 0.5], [3, 0, 2], 1)
    return Labels(contacts.astype(np.uint8), strides.phase(path.time, *stood), gait.astype(np.uint8))


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
