"""Values that are no numbers, or of no size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import quat
from ..clip import Clip
from .finding import Finding, some, spans

LARGEST = 1e5  # metres from the origin; beyond it a float32 database tells no millimetres apart


def unusable(clip: Clip) -> NDArray[np.bool_]:
    """Where [T, J] a value is not finite, a position beyond `LARGEST` or a rotation of no unit length."""
    with np.errstate(invalid="ignore", over="ignore"):
        far = np.abs(clip.positions) < LARGEST
        size = np.einsum("tjq,tjq->tj", clip.rotations, clip.rotations)
        good = far[..., 0] & far[..., 1] & far[..., 2] & (np.abs(size - 1) < 0.1)
    return np.asarray(~good)


def findings(clip: Clip, bad: NDArray[np.bool_]) -> list[Finding]:
    """Frames that are not finite, by where [T, J] they are `unusable`."""
    found = []
    for start, stop in spans(np.any(bad, axis=1)):
        names = [clip.skeleton.names[j] for j in np.flatnonzero(bad[start:stop].any(axis=0))]
        what = f"values of {some(names)} are not finite or beyond {LARGEST:g} m"
        found.append(Finding("not finite", start, stop, what, fatal=True))
    return found


def filled(clip: Clip, bad: NDArray) -> Clip:
    """The clip with straight lines between good frames in place of the bad ones [T], of which not all."""
    good = np.flatnonzero(~bad)
    after = np.minimum(np.searchsorted(good, np.arange(len(bad))), len(good) - 1)
    start, stop = good[np.maximum(after - (good[after] > np.arange(len(bad))), 0)], good[after]
    share = np.clip((np.arange(len(bad)) - start) / np.maximum(stop - start, 1), 0, 1)[:, None, None]
    first, last = quat.unroll(np.stack([clip.rotations[start], clip.rotations[stop]]))
    return clip.replace(
        positions=(1 - share) * clip.positions[start] + share * clip.positions[stop],
        rotations=quat.normalize((1 - share) * first + share * last),
    )
