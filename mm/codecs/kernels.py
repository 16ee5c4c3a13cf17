"""Decoding, compiled: poses of frames from `Tables`. `mm.codecs.kernels_numpy` is the obvious twin.

Each frame is decoded by itself, with those that its velocities are differences of.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from motion.quat_scalar import inv, log_shortest, mul

from .smallest_three import MOST

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

SPARE = 6  # poses that `decode` writes into besides what it returns: five frames, and a key


@_jit
def half(stored):
    """The float32 of a finite half float, seen as uint16: its bits, moved, are it by 2^-112."""
    number = np.uint32(stored)
    moved = (number & np.uint32(0x7FFF)) << np.uint32(13) | (number & np.uint32(0x8000)) << np.uint32(16)
    return np.uint32(moved).view(np.float32) * np.float32(2.0**112)


@_jit
def word(row, at, count):
    """count bits of a row of bytes, from bit at on, the lowest first; 57 at the most."""
    first, shift = np.uint64(at >> 3), at & 7
    value = np.uint64(0)
    if first + np.uint64(8) <= np.uint64(len(row)):
        for k in range(8):  # as many as fit, which compiles to one load
            value |= np.uint64(row[first + np.uint64(k)]) << np.uint64(8 * k)
    else:
        for k in range((shift + count + 7) >> 3):
            value |= np.uint64(row[first + np.uint64(k)]) << np.uint64(8 * k)
    return (value >> np.uint64(shift)) & ((np.uint64(1) << np.uint64(count)) - np.uint64(1))


@_jit
def _unpack(row, at, bits, step, rotations, j):
    """Write a quaternion of the smallest three to rotations [J, 4]."""
    code = word(row, at, 2 + 3 * bits)
    left_out, mask = np.int64(code & np.uint64(3)), (np.uint64(1) << np.uint64(bits)) - np.uint64(1)
    squares, c = 0.0, 0
    for k in range(3):
        if c == left_out:
            c += 1
        value = step * np.int64((code >> np.uint64(2 + k * bits)) & mask) - MOST
        rotations[j, c] = value
        squares += value * value
        c += 1
    rotations[j, left_out] = math.sqrt(max(0.0, 1 - squares))


@_jit
def row(k, tables, positions, rotations):
    """Write the pose [J] of a stored row, but not its root."""
    joints = len(positions)
    if len(tables.floats):
        floats = tables.floats[k]
        for j in range(1, joints):
            for c in range(3):
                positions[j, c] = floats[j - 1, c]
            for c in range(4):
                rotations[j, c] = floats[j - 1, 3 + c]
        return
    if len(tables.halves):
        halves = tables.halves[k]
        for j in range(1, joints):
            squares = np.float32(0)
            for c in range(3):
                positions[j, c] = half(halves[j - 1, c])
            for c in range(4):
                rotations[j, c] = half(halves[j - 1, 3 + c])
                squares += rotations[j, c] * rotations[j, c]
            whole = np.float32(1 / math.sqrt(squares))
            for c in range(4):
                rotations[j, c] *= whole
        return
    bones, rest, moving, turning = tables.bones, tables.rest, tables.moving, tables.turning
    for j in range(1, joints):
        for c in range(3):
            positions[j, c] = bones[j, c]
        for c in range(4):
            rotations[j, c] = rest[j, c]
    translations, offset, scale = tables.translations[k], tables.offset, tables.scale
    for m in range(len(moving)):
        column = moving[m]
        positions[column // 3, column % 3] = offset[m] + scale[m] * np.float32(translations[m])
    packed, bits = tables.packed[k], tables.bits
    width, step = 2 + 3 * bits, 2 * MOST / ((1 << bits) - 1)
    for m in range(len(turning)):
        _unpack(packed, m * width, bits, step, rotations, turning[m])


@_jit
def blend(share, positions, rotations, to_positions, to_rotations):
    """Move a pose [J] on to another one by a share: rotations by the short way, and made whole."""
    stay = np.float32(1) - share
    for j in range(1, len(positions)):
        for c in range(3):
            positions[j, c] = stay * positions[j, c] + share * to_positions[j, c]
        along = np.float32(0)
        for c in range(4):
            along += rotations[j, c] * to_rotations[j, c]
        signed, squares = share if along >= 0 else -share, np.float32(0)
        for c in range(4):
            rotations[j, c] = stay * rotations[j, c] + signed * to_rotations[j, c]
            squares += rotations[j, c] * rotations[j, c]
        whole = np.float32(1 / math.sqrt(squares))
        for c in range(4):
            rotations[j, c] *= whole


@_jit
def _last_at_most(values, value):
    """The last place in ascending values whose value is not above this one."""
    low, high = 0, len(values)
    while high - low > 1:
        middle = (low + high) >> 1
        if values[middle] <= value:
            low = middle
        else:
            high = middle
    return low


@_jit
def place(frame, tables, positions, rotations, spare_positions, spare_rotations):
    """Write the pose [J] of a frame, but not its root; spare ones [J] are written over."""
    if len(tables.keys) == 0:
        row(frame, tables, positions, rotations)
        return
    k = _last_at_most(tables.keys, frame)
    row(k, tables, positions, rotations)
    first = tables.keys[k]
    if first < frame:
        row(k + 1, tables, spare_positions, spare_rotations)
        share = np.float32(frame - first) / np.float32(tables.keys[k + 1] - first)
        blend(share, positions, rotations, spare_positions, spare_rotations)


@_jit
def stencil(frame, start, stop):
    """Of which steps a frame's rate is made: the first of them, how many, and their four weights.

    Central differences; at the ends of a range as `motion.kinematics.velocities` continues them.
    """
    length = stop - start
    if length < 2:
        return start, 0, (0.0, 0.0, 0.0, 0.0)
    if length < 4:
        return min(frame, stop - 2), 1, (1.0, 0.0, 0.0, 0.0)
    if frame == start:
        if length == 4:
            return start, 3, (1.0, 0.5, -0.5, 0.0)
        return start, 4, (0.5, 1.0, 0.0, -0.5)
    if frame == stop - 1:
        return stop - 4, 3, (-0.5, 0.5, 1.0, 0.0)
    return frame - 1, 2, (0.5, 0.5, 0.0, 0.0)


@_jit
def _recompute(frame, tables, positions, rotations, velocities, angular, spare_positions, spare_rotations):
    """Write the pose [J] and the rates of a frame, as differences of those around it."""
    r = _last_at_most(tables.starts, frame)
    first, steps, weights = stencil(frame, tables.starts[r], tables.stops[r])
    for k in range(steps + 1):
        place(
            first + k, tables, spare_positions[k], spare_rotations[k], spare_positions[5], spare_rotations[5]
        )
    here = frame - first
    for j in range(1, len(positions)):
        for c in range(3):
            velocities[j, c] = 0
            angular[j, c] = 0
        if steps == 0:
            continue
        for c in range(3):
            positions[j, c] = spare_positions[here, j, c]
        for c in range(4):
            rotations[j, c] = spare_rotations[here, j, c]
    if steps == 0:
        place(frame, tables, positions, rotations, spare_positions[5], spare_rotations[5])
    for k in range(steps):
        weight = weights[k] * tables.fps
        if weight == 0:
            continue
        p, q, later_p, later_q = (
            spare_positions[k],
            spare_rotations[k],
            spare_positions[k + 1],
            spare_rotations[k + 1],
        )
        for j in range(1, len(positions)):
            for c in range(3):
                velocities[j, c] += weight * (later_p[j, c] - p[j, c])
            before = (q[j, 0], q[j, 1], q[j, 2], q[j, 3])
            after = (later_q[j, 0], later_q[j, 1], later_q[j, 2], later_q[j, 3])
            x, y, z = log_shortest(mul(after, inv(before)))
            angular[j, 0] += weight * x
            angular[j, 1] += weight * y
            angular[j, 2] += weight * z


@_jit
def _root(frame, tables, root):
    """Write the root's motion in a frame to root [6]."""
    for c in range(6):
        if len(tables.root):
            root[c] = tables.root[frame, c]
        elif len(tables.half_root):
            root[c] = half(tables.half_root[frame, c])
        else:
            root[c] = tables.root_scale[c] * np.float32(tables.coded_root[frame, c])


@_jit
def decode(frames, tables, spare_positions, spare_rotations,
           positions, rotations, velocities, angular, contacts):  # fmt: skip
    """Write poses [N, J] and contacts [N, C] of frames [N]; joint 0 is the root's motion (`mm.kernels`).

    Spare poses [SPARE, J] are written over.
    """
    root = np.empty(6, np.float32)
    for n in range(len(frames)):
        frame = frames[n]
        if len(tables.rates) or len(tables.half_rates):
            place(frame, tables, positions[n], rotations[n], spare_positions[5], spare_rotations[5])
            for j in range(1, positions.shape[1]):
                for c in range(3):
                    if len(tables.rates):
                        velocities[n, j, c] = tables.rates[frame, j - 1, c]
                        angular[n, j, c] = tables.rates[frame, j - 1, 3 + c]
                    else:
                        velocities[n, j, c] = half(tables.half_rates[frame, j - 1, c])
                        angular[n, j, c] = half(tables.half_rates[frame, j - 1, 3 + c])
        else:
            _recompute(
                frame, tables, positions[n], rotations[n], velocities[n], angular[n],
                spare_positions, spare_rotations,
            )  # fmt: skip
        _root(frame, tables, root)
        half_yaw = root[2] / 2
        positions[n, 0, 0], positions[n, 0, 1], positions[n, 0, 2] = root[0], 0, root[1]
        rotations[n, 0, 0], rotations[n, 0, 1] = math.cos(half_yaw), 0
        rotations[n, 0, 2], rotations[n, 0, 3] = math.sin(half_yaw), 0
        velocities[n, 0, 0], velocities[n, 0, 1], velocities[n, 0, 2] = root[3], 0, root[4]
        angular[n, 0, 0], angular[n, 0, 1], angular[n, 0, 2] = 0, root[5], 0
        feet = contacts.shape[1]
        for c in range(feet):
            bit = np.int64(frame) * feet + c
            contacts[n, c] = (tables.contacts[bit >> 3] >> np.uint8(bit & 7)) & np.uint8(1)
