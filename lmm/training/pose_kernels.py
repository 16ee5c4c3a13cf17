"""The pose losses and their gradient in one compiled pass; `lmm.training.pose_loss` has the obvious twin.

Autograd would walk the hierarchy level by level, twice, in many small operations. Here a window of frames
stays in the cache: forward kinematics, every term, and the chain rule back down the hierarchy.
"""

from __future__ import annotations

import math

import numba
import numpy as np

_jit = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})

TERMS = (
    "position",
    "rotation",
    "velocity",
    "angular velocity",
    "root velocity",
    "root angular velocity",
    "contact",
    "character position",
    "character rotation",
    "character velocity",
    "character angular velocity",
    "position rate",
    "rotation rate",
    "character position rate",
    "character rotation rate",
)


@_jit
def _l1(difference, coefficient):
    """Value and slope of coefficient |difference|; what is no number has a value that is none either."""
    value = coefficient * abs(difference)
    if difference > 0:
        return value, coefficient
    if difference < 0:
        return value, -coefficient
    return value, np.float32(0)


@_jit
def _gram_schmidt(y, at, turn, lengths):
    """Matrix turn [3, 3] of the six numbers at y[at:]; lengths [2] are kept for the way back."""
    ax, ay, az = y[at], y[at + 2], y[at + 4]
    bx, by, bz = y[at + 1], y[at + 3], y[at + 5]
    length = max(math.sqrt(ax * ax + ay * ay + az * az), np.float32(1e-12))
    ax, ay, az = ax / length, ay / length, az / length
    lengths[0] = length
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = max(math.sqrt(cx * cx + cy * cy + cz * cz), np.float32(1e-12))
    cx, cy, cz = cx / length, cy / length, cz / length
    lengths[1] = length
    turn[0, 0], turn[1, 0], turn[2, 0] = ax, ay, az
    turn[0, 1], turn[1, 1], turn[2, 1] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    turn[0, 2], turn[1, 2], turn[2, 2] = cx, cy, cz


@_jit
def _gram_schmidt_back(y, at, turn, lengths, g_turn, gradient):
    """Add the slope by the six numbers, given that by the matrix."""
    x0, x1, x2 = turn[0, 0], turn[1, 0], turn[2, 0]
    z0, z1, z2 = turn[0, 2], turn[1, 2], turn[2, 2]
    gx0, gx1, gx2 = g_turn[0, 0], g_turn[1, 0], g_turn[2, 0]
    gy0, gy1, gy2 = g_turn[0, 1], g_turn[1, 1], g_turn[2, 1]
    gz0, gz1, gz2 = g_turn[0, 2], g_turn[1, 2], g_turn[2, 2]
    # y = z x x
    gz0, gz1, gz2 = gz0 + x1 * gy2 - x2 * gy1, gz1 + x2 * gy0 - x0 * gy2, gz2 + x0 * gy1 - x1 * gy0
    gx0, gx1, gx2 = gx0 + gy1 * z2 - gy2 * z1, gx1 + gy2 * z0 - gy0 * z2, gx2 + gy0 * z1 - gy1 * z0
    # z = c / |c|, c = x x b
    along = z0 * gz0 + z1 * gz1 + z2 * gz2
    c0, c1, c2 = (
        (gz0 - z0 * along) / lengths[1],
        (gz1 - z1 * along) / lengths[1],
        (gz2 - z2 * along) / lengths[1],
    )
    b0, b1, b2 = y[at + 1], y[at + 3], y[at + 5]
    gx0, gx1, gx2 = gx0 + b1 * c2 - b2 * c1, gx1 + b2 * c0 - b0 * c2, gx2 + b0 * c1 - b1 * c0
    gradient[at + 1] += c1 * x2 - c2 * x1
    gradient[at + 3] += c2 * x0 - c0 * x2
    gradient[at + 5] += c0 * x1 - c1 * x0
    # x = a / |a|
    along = x0 * gx0 + x1 * gx1 + x2 * gx2
    gradient[at] += (gx0 - x0 * along) / lengths[0]
    gradient[at + 2] += (gx1 - x1 * along) / lengths[0]
    gradient[at + 4] += (gx2 - x2 * along) / lengths[0]


@_jit
def _forward(parents, y, turns, lengths, x, r, v, w, arms):
    """Forward kinematics of a vector y [D] in the root's space."""
    n = len(parents) - 1
    rotations, velocities, angular = 3 * n, 9 * n, 12 * n
    for a in range(3):
        x[0, a], v[0, a], w[0, a] = 0.0, 0.0, 0.0
        for b in range(3):
            r[0, a, b] = 1.0 if a == b else 0.0
    for j in range(1, n + 1):
        p, i = parents[j], j - 1
        _gram_schmidt(y, rotations + 6 * i, turns[j], lengths[j])
        for a in range(3):
            arm, rate, turned = np.float32(0), np.float32(0), np.float32(0)
            for b in range(3):
                arm += r[p, a, b] * y[3 * i + b]
                rate += r[p, a, b] * y[velocities + 3 * i + b]
                turned += r[p, a, b] * y[angular + 3 * i + b]
                total = np.float32(0)
                for c in range(3):
                    total += r[p, a, c] * turns[j, c, b]
                r[j, a, b] = total
            arms[j, a], x[j, a] = arm, x[p, a] + arm
            v[j, a], w[j, a] = v[p, a] + rate, w[p, a] + turned
        v[j, 0] += w[p, 1] * arms[j, 2] - w[p, 2] * arms[j, 1]
        v[j, 1] += w[p, 2] * arms[j, 0] - w[p, 0] * arms[j, 2]
        v[j, 2] += w[p, 0] * arms[j, 1] - w[p, 1] * arms[j, 0]


@_jit
def _backward(parents, y, turns, lengths, r, w, arms, gx, gr, gv, gw, gradient):
    """Add the slope by y, given those by what `_forward` made, which are used up."""
    n = len(parents) - 1
    rotations, velocities, angular = 3 * n, 9 * n, 12 * n
    g_turn, g_arm = np.empty((3, 3), np.float32), np.empty(3, np.float32)
    for j in range(n, 0, -1):
        p, i = parents[j], j - 1
        for a in range(3):
            gx[p, a] += gx[j, a]
            gv[p, a] += gv[j, a]
            gw[p, a] += gw[j, a]
        a0, a1, a2 = arms[j, 0], arms[j, 1], arms[j, 2]
        g0, g1, g2 = gv[j, 0], gv[j, 1], gv[j, 2]
        gw[p, 0] += a1 * g2 - a2 * g1
        gw[p, 1] += a2 * g0 - a0 * g2
        gw[p, 2] += a0 * g1 - a1 * g0
        g_arm[0] = gx[j, 0] + g1 * w[p, 2] - g2 * w[p, 1]
        g_arm[1] = gx[j, 1] + g2 * w[p, 0] - g0 * w[p, 2]
        g_arm[2] = gx[j, 2] + g0 * w[p, 1] - g1 * w[p, 0]
        for a in range(3):
            for b in range(3):
                total = np.float32(0)
                for c in range(3):
                    total += gr[j, a, c] * turns[j, b, c]
                gr[p, a, b] += (
                    total
                    + g_arm[a] * y[3 * i + b]
                    + gv[j, a] * y[velocities + 3 * i + b]
                    + gw[j, a] * y[angular + 3 * i + b]
                )
                total = np.float32(0)
                for c in range(3):
                    total += r[p, c, a] * gr[j, c, b]
                g_turn[a, b] = total
        for b in range(3):
            position, rate, turned = np.float32(0), np.float32(0), np.float32(0)
            for a in range(3):
                position += r[p, a, b] * g_arm[a]
                rate += r[p, a, b] * gv[j, a]
                turned += r[p, a, b] * gw[j, a]
            gradient[3 * i + b] += position
            gradient[velocities + 3 * i + b] += rate
            gradient[angular + 3 * i + b] += turned
        _gram_schmidt_back(y, rotations + 6 * i, turns[j], lengths[j], g_turn, gradient)


@_jit
def _vectors(window, joints):
    return np.empty((window, joints, 3), np.float32)


@_jit
def pose_loss(parents, fps, coefficients, first, window, vectors, truth, tx, tr, tv, tw, gradients, terms):
    """Sums of the terms over windows of frames, and the slope of their sum by the vectors.

    vectors [B window, D] predicted, windows one after another; first [B] the true frame that each begins at;
    truth [T, D] and the true joints in the root's space: tx, tv, tw [T, J, 3], tr [T, J, 3, 3].
    coefficients [15] in the order of TERMS, rates per second included. Writes gradients [B window, D] and
    terms [15], float64.
    """
    joints, size = len(parents), vectors.shape[1]
    n = joints - 1
    edges = np.array([3 * n, 9 * n, 12 * n, 15 * n, 15 * n + 3, 15 * n + 6, size])
    turns = np.empty((window, joints, 3, 3), np.float32)
    lengths = np.empty((window, joints, 2), np.float32)
    x, v, w, arms = (
        _vectors(window, joints),
        _vectors(window, joints),
        _vectors(window, joints),
        _vectors(window, joints),
    )
    r = np.empty((window, joints, 3, 3), np.float32)
    gx, gv, gw = _vectors(window, joints), _vectors(window, joints), _vectors(window, joints)
    gr = np.empty((window, joints, 3, 3), np.float32)
    terms[:] = 0
    for k in range(len(first)):
        sums = np.zeros(15, np.float32)
        for f in range(window):
            y, goal, gradient = vectors[k * window + f], truth[first[k] + f], gradients[k * window + f]
            _forward(parents, y, turns[f], lengths[f], x[f], r[f], v[f], w[f], arms[f])
            start = 0
            for term in range(7):
                for d in range(start, edges[term]):
                    value, gradient[d] = _l1(y[d] - goal[d], coefficients[term])
                    sums[term] += value
                start = edges[term]
            t = first[k] + f
            for a in range(3):
                gx[f, 0, a], gv[f, 0, a], gw[f, 0, a] = 0.0, 0.0, 0.0
                for b in range(3):
                    gr[f, 0, a, b] = 0.0
            for j in range(1, joints):
                for a in range(3):
                    value, gx[f, j, a] = _l1(x[f, j, a] - tx[t, j, a], coefficients[7])
                    sums[7] += value
                    for b in range(3):
                        value, gr[f, j, a, b] = _l1(r[f, j, a, b] - tr[t, j, a, b], coefficients[8])
                        sums[8] += value
                    value, gv[f, j, a] = _l1(v[f, j, a] - tv[t, j, a], coefficients[9])
                    sums[9] += value
                    value, gw[f, j, a] = _l1(w[f, j, a] - tw[t, j, a], coefficients[10])
                    sums[10] += value
        for f in range(1, window):
            now, before, t = k * window + f, k * window + f - 1, first[k] + f
            for d in range(9 * n):
                term = 11 if d < 3 * n else 12
                difference = (vectors[now, d] - vectors[before, d]) - (truth[t, d] - truth[t - 1, d])
                value, slope = _l1(difference, coefficients[term])
                sums[term] += value
                gradients[now, d] += slope
                gradients[before, d] -= slope
            for j in range(1, joints):
                for a in range(3):
                    difference = (x[f, j, a] - x[f - 1, j, a]) - (tx[t, j, a] - tx[t - 1, j, a])
                    value, slope = _l1(difference, coefficients[13])
                    sums[13] += value
                    gx[f, j, a] += slope
                    gx[f - 1, j, a] -= slope
                    for b in range(3):
                        difference = (r[f, j, a, b] - r[f - 1, j, a, b]) - (
                            tr[t, j, a, b] - tr[t - 1, j, a, b]
                        )
                        value, slope = _l1(difference, coefficients[14])
                        sums[14] += value
                        gr[f, j, a, b] += slope
                        gr[f - 1, j, a, b] -= slope
        for f in range(window):
            at = k * window + f
            _backward(parents, vectors[at], turns[f], lengths[f], r[f], w[f], arms[f],
                      gx[f], gr[f], gv[f], gw[f], gradients[at])  # fmt: skip
        for term in range(15):
            terms[term] += sums[term]


@_jit
def forward(parents, vectors, x, r, v, w):
    """Forward kinematics of vectors [T, D] in the root's space: x, v, w [T, J, 3] and r [T, J, 3, 3]."""
    joints = len(parents)
    turns, lengths = np.empty((joints, 3, 3), np.float32), np.empty((joints, 2), np.float32)
    arms = np.empty((joints, 3), np.float32)
    for t in range(len(vectors)):
        _forward(parents, vectors[t], turns, lengths, x[t], r[t], v[t], w[t], arms)
