"""Unit quaternions of few bits: the largest component is left out, the other three are rounded.

With the sign that makes the largest positive, the others lie within 1 / sqrt(2). A quaternion is 2 bits that
say which is left out, and three codes of b bits; the quaternions of a frame stand bit to bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOST = 0.5**0.5
CHUNK = 4096  # frames of which every bit takes a byte, for a while


def step(bits: int) -> float:
    """What one code is more than the one before."""
    return 2 * MOST / (2**bits - 1)


def bound(bits: int) -> float:
    """The largest angle, radians, between a rotation and what is decoded of it.

    Three components are wrong by half a step h at most, so their vector moves by sqrt(3) h. On the sphere
    that is as much farther as the component left out is below 1; it is 1/2 or more, and less by what the
    vector moved. A rotation's angle is twice that of its quaternion.
    """
    moved = 3**0.5 * step(bits) / 2
    least = (1 - (0.75**0.5 + moved) ** 2) ** 0.5
    return 2 * moved / least


def width(bits: int) -> int:
    """Bits of a quaternion."""
    return 2 + 3 * bits


def encode(rotations: NDArray[np.float32], bits: int) -> NDArray[np.uint8]:
    """Rows of bytes [T, B] of rotations [T, M, 4]: B = ceil(M (2 + 3 bits) / 8)."""
    frames, joints = rotations.shape[:2]
    out = np.zeros((frames, -(-joints * width(bits) // 8)), np.uint8)
    for start in range(0, frames, CHUNK):
        words = _words(np.asarray(rotations[start : start + CHUNK], np.float64), bits)
        every = words[..., None] >> np.arange(width(bits), dtype=np.uint64) & np.uint64(1)
        rows = every.astype(np.uint8).reshape(len(words), -1)
        out[start : start + CHUNK] = np.packbits(rows, axis=1, bitorder="little")
    return out


def _words(q: NDArray[np.float64], bits: int) -> NDArray[np.uint64]:
    """Codes [T, M] of rotations [T, M, 4]."""
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    left_out = np.argmax(np.abs(q), axis=-1)
    q = q * np.where(np.take_along_axis(q, left_out[..., None], -1) < 0, -1, 1)
    kept = (np.arange(3) + (np.arange(3) >= left_out[..., None])).astype(np.int64)
    codes = np.rint((np.take_along_axis(q, kept, -1) + MOST) / step(bits)).clip(0, 2**bits - 1)
    shifts = np.uint64(2) + np.uint64(bits) * np.arange(3, dtype=np.uint64)
    return left_out.astype(np.uint64) | np.bitwise_or.reduce(codes.astype(np.uint64) << shifts, axis=-1)


def decode(rows: NDArray[np.uint8], joints: int, bits: int) -> NDArray[np.float64]:
    """Rotations [T, M, 4] of rows of bytes [T, B]; the obvious twin of what `mm.codecs.kernels` does."""
    every = np.unpackbits(rows, axis=1, bitorder="little", count=joints * width(bits))
    every = every.reshape(len(rows), joints, width(bits)).astype(np.int64)
    left_out = every[..., 0] + 2 * every[..., 1]
    codes = every[..., 2:].reshape(len(rows), joints, 3, bits) @ (1 << np.arange(bits))
    kept = codes * step(bits) - MOST
    out = np.empty((len(rows), joints, 4))
    places = np.arange(3) + (np.arange(3) >= left_out[..., None])
    np.put_along_axis(out, places, kept, -1)
    largest = np.sqrt(np.maximum(0, 1 - (kept * kept).sum(-1)))
    np.put_along_axis(out, left_out[..., None], largest[..., None], -1)
    return out
