"""Arrays as compiled kernels take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def plain(array: NDArray) -> NDArray:
    """A read-only contiguous view without memmap's subclass: one type for the kernels, mapped or not."""
    view = np.ascontiguousarray(np.asarray(array)).view()
    view.flags.writeable = False
    return view
