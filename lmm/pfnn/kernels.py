"""What control points count at phases, compiled; `lmm.pfnn.kernels_numpy` is the obvious twin."""

from __future__ import annotations

import math

import numba

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


@_jit
def share(phases, first, shares, order, ends):
    """Write which sets phases [N] need to first and shares [N, used], see `lmm.pfnn.spline.shares`.

    Rows by their first set go to order, and where each set's rows end to ends [sets]; there is room for N or
    more.
    """
    sets, used = len(ends), shares.shape[1]
    for n in range(len(phases)):
        if used == 4:
            place = phases[n] * (4 / (2 * math.pi))
            begin = math.floor(place)
            w = place - begin
            k = int(begin)
            first[n] = 0
            shares[n, (k - 1) % 4] = -w / 2 + w * w - w * w * w / 2
            shares[n, k % 4] = 1 - 5 / 2 * w * w + 3 / 2 * w * w * w
            shares[n, (k + 1) % 4] = w / 2 + 2 * w * w - 3 / 2 * w * w * w
            shares[n, (k + 2) % 4] = -w * w / 2 + w * w * w / 2
        else:
            place = phases[n] * (sets / (2 * math.pi))
            begin = math.floor(place if used == 2 else place + 0.5)
            first[n] = int(begin) % sets
            shares[n, 0] = 1
            if used == 2:
                shares[n, 0], shares[n, 1] = 1 - (place - begin), place - begin
    sort(first[: len(phases)], order, ends)


@_jit
def sort(first, order, ends):
    """Write rows [N] by their first set to order, and where each set's rows end to ends [sets]."""
    ends[:] = 0
    for n in range(len(first)):
        ends[first[n]] += 1
    total = 0
    for s in range(len(ends)):
        total += ends[s]
        ends[s] = total - ends[s]  # where it begins, until its rows are placed
    for n in range(len(first)):
        order[ends[first[n]]] = n
        ends[first[n]] += 1
