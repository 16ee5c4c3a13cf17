"""The obvious twin of `lmm.pfnn.kernels`: the same over whole arrays, for the tests to compare."""

from __future__ import annotations

import numpy as np

from ..locomotion import layers_numpy as mixed
from . import spline

_MODES = {used: mode for mode, used in spline.USED.items()}


def evaluate(x, phases, sets, used, layers, weights, numbers, first, shares, order, ends, work, wide, panel,
             active, y):  # fmt: skip
    """See `lmm.pfnn.kernels.evaluate`."""
    _share(phases, sets, used, first, shares, order, ends)
    mixed.evaluate(x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y)


def evaluate_pairs(tiles, x, phases, sets, used, layers, weights, numbers, first, shares, order, ends, work,
                   wide, panel, active, y):  # fmt: skip
    """See `lmm.pfnn.kernels.evaluate_pairs`."""
    _share(phases, sets, used, first, shares, order, ends)
    mixed.evaluate_pairs(
        tiles, x, sets, used, layers, weights, numbers, shares, order, ends, work, wide, panel, active, y
    )


def _share(phases, sets, used, first, shares, order, ends):
    """`lmm.pfnn.kernels.share` and `sort`."""
    first[:], shares[:] = spline.shares(phases, _MODES[used])
    order[:] = np.argsort(first, kind="stable")
    ends[:] = np.cumsum(np.bincount(first, minlength=sets))
