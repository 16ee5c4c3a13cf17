"""Labels of a motion: what touches the ground, the phase of the gait, and which gait it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import kinematics, leadin, strides
from motion.clip import Clip
from motion.errors import UserError
from motion.roles import opposite
from motion.skeleton import Skeleton

from . import contacts as touching
from . import gait as gaits
from . import phase as phases

GAITS = gaits.GAITS
PARTS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("heel", "toe", "foot", "hand"))
"""What a contact may be of."""
TURN = np.float32(2 * np.pi)
# By what the contact of a part is told, where labels do not name it.
_TOLD_BY = {
    "heel": ("heel", "foot", "toe"),
    "toe": ("toe", "foot", "heel"),
    "foot": ("foot", "heel", "toe"),
    "hand": ("hand",),
}


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of T frames.

    Attributes
    ----------
    names : of C parts of the body that touch the ground (of `PARTS`), each with its twin on the other side.
    contacts : uint8 [T, C], 1 where a part rests on the ground.
    phase : float32 [T], radians in 0 to 2 pi, the right foot coming down at 0 and the left one at pi
        (REFERENCE 4.2); None where none was asked for.
    gait : float32 [T, 6], weights of `GAITS`, which sum to 1.
    """

    names: tuple[str, ...]
    contacts: NDArray[np.uint8]
    phase: NDArray[np.float32] | None
    gait: NDArray[np.float32]

    def __post_init__(self) -> None:
        frames, count = len(self.contacts), len(self.names)
        if self.contacts.shape != (frames, count) or self.gait.shape != (frames, len(GAITS)):
            raise ValueError(
                f"contacts {self.contacts.shape}, gait {self.gait.shape}, "
                f"expected ({frames}, {count}) and ({frames}, {len(GAITS)})"
            )
        if self.phase is not None and self.phase.shape != (frames,):
            raise ValueError(f"phase {self.phase.shape}, expected ({frames},)")
        if len(set(self.names)) < count or {opposite(name) for name in self.names} != set(self.names):
            raise ValueError(f"contacts of {', '.join(self.names)}: expected pairs of left and right")

    def __len__(self) -> int:
        return len(self.contacts)

    def __getitem__(self, frames: slice) -> Labels:
        phase = None if self.phase is None else self.phase[frames]
        return Labels(self.names, self.contacts[frames], phase, self.gait[frames])

    def mirrored(self) -> Labels:
        """Labels of the mirror image: left and right exchanged, half a turn on."""
        twins = [self.names.index(opposite(name)) for name in self.names]
        phase = None if self.phase is None else wrapped(self.phase.astype(np.float64) + np.pi)
        return replace(self, contacts=np.ascontiguousarray(self.contacts[:, twins]), phase=phase)

    def at(self, frames: ArrayLike) -> Labels:
        """Labels at instants [K] in frames, between two frames too: what a clip has at another rate.

        Contacts are those of the nearest frame; phase and gait are interpolated.
        """
        instants = np.clip(np.asarray(frames, np.float64), 0, len(self) - 1)
        known = np.arange(len(self))
        near = np.floor(instants + 0.5).astype(np.int64)
        phase = None
        if self.phase is not None:
            whole = np.concatenate([self.phase[:1], np.mod(np.diff(self.phase.astype(np.float64)), TURN)])
            phase = wrapped(np.interp(instants, known, np.cumsum(whole)))
        gait = np.stack([np.interp(instants, known, column) for column in self.gait.T], axis=-1)
        return Labels(self.names, self.contacts[near], phase, gait.astype(np.float32))

    def rephased(self, fps: float) -> Labels:
        """The labels with the phase that their contacts tell, as after contacts were corrected."""
        return replace(self, phase=wrapped(phases.from_contacts(self.names, self.contacts, fps)))

    def of_parts(self, names: Sequence[str]) -> Labels:
        """The labels with the contacts of other parts, which may name feet otherwise.

        A foot touches with its heel or toe; a foot that has no heel and toe of its own touches with both at
        once (REFERENCE 4.2). A UserError where nothing tells of a part.
        """
        columns = []
        for name in names:
            side, part = name.split("_")
            known = [f"{side}_{one}" for one in _TOLD_BY[part] if f"{side}_{one}" in self.names]
            if not known:
                limb = "hand" if part == "hand" else "foot"
                raise UserError(f"no contact of the {side} {limb} among {', '.join(self.names)}")
            both = part == "foot" and name not in known
            told = [self.contacts[:, self.names.index(one)] for one in (known if both else known[:1])]
            columns.append(np.max(told, axis=0))
        contacts = np.stack(columns, axis=-1) if columns else self.contacts[:, :0]
        return replace(self, names=tuple(names), contacts=contacts)

    def foot_contacts(self) -> NDArray[np.uint8]:
        """Contacts of left heel, left toe, right heel, right toe [T, 4], what the published layout has.

        See `of_parts`; a UserError without feet.
        """
        return self.of_parts(("left_heel", "left_toe", "right_heel", "right_toe")).contacts


def label(
    skeleton: Skeleton, fps: float, positions: NDArray[Any], rotations: NDArray[Any], *, phase: bool = True
) -> Labels:
    """Labels of T frames from world transforms, positions [T, J, 3] in metres and rotations [T, J, 4].

    The skeleton may have a ground root or none. It needs the roles hips, feet and a pair of up_leg, arm or
    shoulder. Where a phase is asked for that the motion does not have (on all fours, one foot that never
    touches, no step and no stand), that is a UserError. Ranges of a database are labelled one by one.
    """
    names, contacts = touching.find(skeleton, fps, positions, rotations)
    found = wrapped(phases.from_contacts(names, contacts, fps)) if phase else None
    gait = gaits.decide(skeleton, fps, positions, names, contacts)
    return Labels(names, contacts, found, gaits.weights(gait, fps))


def label_clip(clip: Clip, *, phase: bool = True) -> Labels:
    """Labels of a clip's frames, see `label`.

    A rest pose that was put before a capture is no motion: its frames have the first captured frame's
    contacts, a phase that goes on as in a stand, and the gait "other". A UserError names the clip's file.
    """
    start = leadin.lead_in(clip)
    world = kinematics.forward(clip.skeleton, clip.positions[start:], clip.rotations[start:])
    try:
        found = label(clip.skeleton, clip.fps, *world, phase=phase)
    except UserError as error:
        if error.path is not None:
            raise
        raise UserError(error.what, path=clip.source, remedy=error.remedy) from error
    if start == 0:
        return found
    contacts = np.concatenate([np.repeat(found.contacts[:1], start, axis=0), found.contacts])
    gait = np.concatenate([gaits.weights(np.full(start, gaits.OTHER), clip.fps), found.gait])
    before = None
    if found.phase is not None:
        slow = found.phase[0] + strides.STANDING_RATE * np.arange(-start, 0) / clip.fps
        before = np.concatenate([wrapped(slow), found.phase])
    return Labels(found.names, contacts, before, gait)


def wrapped(phase: NDArray[np.floating]) -> NDArray[np.float32]:
    """A phase as float32 in 0 to 2 pi, which rounding does not reach."""
    found = np.mod(phase, 2 * np.pi).astype(np.float32)
    found[found >= TURN] = 0
    return found
