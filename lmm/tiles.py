"""Products of bfloat16 pairs by the processor's matrix tiles (AMX), where a process may use them.

A tile is 16 rows of 64 bytes: 16 pairs, or 16 sums. One instruction adds 16 rows by 16 pairs times 16 pairs
by 16 outputs to 16 by 16 sums. Linux lends tiles to processes that ask for them.
"""

from __future__ import annotations

import ctypes
import functools
import platform
import sys
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from .lanes import LANES, features, finish, intrinsic, load, long, store

TILE = 16  # rows of a tile, and numbers or pairs of each
TALL_TILES = 2 * TILE
_HAS_TILES = {"amx-tile", "amx-bf16"} <= features()
_BYTE, _VOID = ir.IntType(8), ir.VoidType()
_POINTER = _BYTE.as_pointer()
_SHAPES = bytes([1, *[0] * 15, *[64, 0] * 8, *[0] * 16, *[TILE] * 8, *[0] * 8])  # of palette 1: whole tiles
_ARCH_PRCTL, _REQUEST, _TILE_DATA = 158, 0x1023, 18


@functools.cache
def permitted() -> bool:
    """Whether this process may use tiles; Linux is asked for them the first time."""
    if not _HAS_TILES or sys.platform != "linux" or platform.machine() != "x86_64":
        return False
    call = ctypes.CDLL(None, use_errno=True).syscall
    call.restype, call.argtypes = ctypes.c_long, [ctypes.c_long] * 3
    return call(_ARCH_PRCTL, _REQUEST, _TILE_DATA) == 0


def _call(b: Any, name: str, *arguments: Any) -> None:
    """One of LLVM's instructions on tiles; integers stand for tiles themselves."""
    values = [ir.Constant(_BYTE, a) if isinstance(a, int) else a for a in arguments]
    kind = ir.FunctionType(_VOID, [value.type for value in values])
    b.call(cgutils.get_or_insert_function(b.module, kind, f"llvm.x86.{name}"), values)


@intrinsic
def open_tiles(context):
    """Make all tiles whole and 0; what follows may use them until `close_tiles`."""

    def generate(context: Any, b: Any, _signature: Any, _arguments: Any) -> Any:
        if _HAS_TILES:
            shapes = ir.Constant(ir.ArrayType(_BYTE, len(_SHAPES)), bytearray(_SHAPES))
            _call(b, "ldtilecfg", b.bitcast(cgutils.global_constant(b, "tile_shapes", shapes), _POINTER))
        return context.get_dummy_value()

    return types.none(), generate


@intrinsic
def close_tiles(context):
    """Give the tiles back, lest every change of threads saves them."""

    def generate(context: Any, b: Any, _signature: Any, _arguments: Any) -> Any:
        if _HAS_TILES:
            _call(b, "tilerelease")
        return context.get_dummy_value()

    return types.none(), generate


@intrinsic(prefer_literal=True)
def tiles_times_pairs(context, rows, x, x_stride, panel, stride, pairs, scale, bias, rectify, y, y_stride):
    """As `lmm.lanes.rows_times_pairs`, of 16 or 32 rows, while tiles are open; 16 divides pairs."""
    down = rows.literal_value // TILE

    def generate(context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        _, x, x_stride, panel, stride, pairs, scale, bias, rectify, y, y_stride = arguments
        if not _HAS_TILES:
            return context.get_dummy_value()

        def bytes_of(count: Any) -> Any:
            return b.mul(count, long(4))

        def at(address: Any, *counts: Any) -> Any:
            for count in counts:
                address = b.add(address, bytes_of(count))
            return b.inttoptr(address, _POINTER)

        # Tiles 0 to 3 hold sums, 4 and 5 rows of x, 6 and 7 the panel's halves.
        places = [(row, half) for row in range(down) for half in range(2)]
        for row, half in places:
            _call(b, "tilezero", 2 * row + half)
        with cgutils.for_range(b, b.sdiv(pairs, long(TILE))) as loop:
            first = b.mul(loop.index, long(TILE))
            for half in range(2):
                from_ = at(panel, b.mul(first, stride), long(TILE * half))
                _call(b, "tileloadd64", 6 + half, from_, bytes_of(stride))
            for row in range(down):
                from_ = at(x, b.mul(x_stride, long(TILE * row)), first)
                _call(b, "tileloadd64", 4 + row, from_, bytes_of(x_stride))
            for row, half in places:
                _call(b, "tdpbf16ps", 2 * row + half, 4 + row, 6 + half)
        for row, half in places:
            to = at(y, b.mul(y_stride, long(TILE * row)), long(TILE * half))
            _call(b, "tilestored64", 2 * row + half, to, bytes_of(y_stride))
        halves = [long(LANES * half) for half in range(2)]
        scales, biases = ([load(b, row, half) for half in halves] for row in (scale, bias))
        with cgutils.for_range(b, long(TILE * down)) as loop:
            for half, s, t in zip(halves, scales, biases, strict=True):
                index = b.add(b.mul(y_stride, loop.index), half)
                store(b, finish(b, load(b, y, index), s, t, rectify), y, index)
        return context.get_dummy_value()

    address = types.intp
    return types.none(rows, *[address] * 10), generate
