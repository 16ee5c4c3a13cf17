"""What a user asks of a character, and the protocol of every system that obeys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from motion.pose import Poses
from motion.skeleton import Skeleton

if TYPE_CHECKING:
    from .description import Description


@dataclass(eq=False)
class Command:
    """What N characters are asked to do at one instant, in the world's ground plane.

    Attributes
    ----------
    velocity : float32 [N, 2], desired velocity x, z, m/s.
    yaw : float32 [N], desired facing, radians; 0 faces +Z, pi/2 faces +X.
    turn_rate : float32 [N], rad/s at which the two above are expected to turn (the camera's rate).
    required_tags, forbidden_tags : uint32 [N], tag bits that a matched frame must, must not bear.
    crouch : bool [N], whether to go crouched; for motion matching, to play frames of the tag "crouch" and
        else none of them, where its database has that tag.
    """

    velocity: NDArray[np.float32]
    yaw: NDArray[np.float32]
    turn_rate: NDArray[np.float32]
    required_tags: NDArray[np.uint32]
    forbidden_tags: NDArray[np.uint32]
    crouch: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.velocity)

    @staticmethod
    def still(count: int) -> Command:
        """count commands to stand, facing +Z."""
        return Command(
            np.zeros((count, 2), np.float32),
            np.zeros(count, np.float32),
            np.zeros(count, np.float32),
            np.zeros(count, np.uint32),
            np.zeros(count, np.uint32),
            np.zeros(count, np.bool_),
        )


class System(Protocol):
    """Anything that drives N characters: motion matching, LMM, mixtures of their stages, PFNN, MANN.

    A system runs at its own rate; a host with another refresh rate steps it at that rate and interpolates.
    """

    name: str
    skeleton: Skeleton
    fps: float
    count: int

    def reset(self, positions: NDArray[np.float32], yaws: NDArray[np.float32]) -> None:
        """Put N characters at positions [N, 2] (x, z), facing yaws [N], at rest."""
        ...

    def step(self, command: Command) -> Poses:
        """Advance one frame, 1 / fps; returns N poses, joint 0 in the world, valid until the next step."""
        ...

    def record(self) -> dict[str, NDArray]:
        """What the last step did, arrays with leading axis N (see `mm.recording`)."""
        ...

    def memory(self) -> dict[str, int]:
        """Bytes by part."""
        ...


def lag_of(system: System) -> float | None:
    """Seconds after which a system's characters go the way that they are asked to: its `lag`.

    None where it does not tell, as motion matching, whose characters lag by what they are set to.
    """
    return getattr(system, "lag", None)


class Described(System, Protocol):
    """A system that knows its data's description and its feet, so that it drives rigs, and on grounds.

    settings are those of its kind; they say how feet are held (`mm.settings.Settings`'s of that name).
    `stage_seconds` holds the time of the last step by stage when `timed` is set.
    """

    description: Description
    settings: Any
    timed: bool
    stage_seconds: dict[str, float]

    def check_tags(self, required: int, forbidden: int) -> None:
        """A UserError unless characters can be asked for tags required without those forbidden (bits)."""
        ...

    def poses(self) -> Poses:
        """The poses [N] that the last step showed, valid until the next one."""
        ...

    def contacts(self) -> NDArray[np.uint8]:
        """Which feet touch the ground by what is played [N, C]; valid until the next step."""
        ...

    def planted(self) -> NDArray[np.uint8]:
        """Which feet the last step held on the ground [N, C]; valid until the next one."""
        ...


@runtime_checkable
class Resumable(System, Protocol):
    """A system that can go back to where it was, and go on by other settings: the controllers themselves."""

    settings: Any

    def remember(self) -> Any:
        """The characters as they are: a copy, for `recall`."""
        ...

    def recall(self, remembered: Any) -> None:
        """Be again where this system, or one that was made alike, was."""
        ...

    def retune(self, settings: Any) -> None:
        """Go on by other settings from the next step on; those that cannot change are a UserError."""
        ...
