"""The obvious twin of `lmm.pfnn.kernels`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from . import spline

_MODES = {used: mode for mode, used in spline.USED.items()}


def share(phases, first, shares, order, ends):
    """See `lmm.pfnn.kernels.share`."""
    rows = slice(len(phases))
    first[rows], shares[rows] = spline.shares(phases, _MODES[shares.shape[1]])
    sort(first[rows], order, ends)


def sort(first, order, ends):
    """See `lmm.pfnn.kernels.sort`."""
    order[: len(first)] = np.argsort(first, kind="stable")
    ends[:] = np.cumsum(np.bincount(first, minlength=len(ends)))
