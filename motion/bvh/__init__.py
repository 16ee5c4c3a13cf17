"""BVH files: read and written, as documents (exactly what the file says) and as clips.

A joint's position channels replace its OFFSET, whichever joint it is; rotation channels are applied in the
order in which the joint lists them, R = R_first R_second R_third.
"""

from .clips import from_clip, read, to_clip, write
from .document import CHANNELS, BvhDocument
from .rates import frame_rate
from .reading import parse
from .writing import serialise

__all__ = [
    "CHANNELS",
    "BvhDocument",
    "frame_rate",
    "from_clip",
    "parse",
    "read",
    "serialise",
    "to_clip",
    "write",
]
