"""The unit of a file's lengths: applied, and guessed from the size of the body."""

from __future__ import annotations

from .clip import Clip


def to_metres(clip: Clip, unit_to_m: float) -> Clip:
    """The clip with every length multiplied by unit_to_m, which it remembers."""
    skeleton = clip.skeleton
    ends = {j: end * unit_to_m for j, end in skeleton.end_sites.items()}
    return clip.replace(
        skeleton=type(skeleton)(
            skeleton.names, skeleton.parents, skeleton.offsets * unit_to_m, skeleton.roles, ends
        ),
        positions=clip.positions * unit_to_m,
        unit_to_m=unit_to_m,
    )
