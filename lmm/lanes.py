"""Vector instructions for the networks' kernels: 16 floats at a time, weights read as they are stored.

Written in LLVM's vector types as `mm.search.lanes` is: every processor's back end maps them to what it has.
Weights are float32, half floats seen as uint16, or int8. They are read in panels of 32 outputs, which stand
side by side in groups: strides count weights from one input to the next. Half floats become floats by the
processor's own instruction where the compiler may use one, elsewhere by shifts and a product, which is exact.
Addresses are those of contiguous arrays (`array.ctypes.data`).

Two bfloat16 inputs that stand side by side in 32 bits, the first in the lower ones, are a pair. Inputs and
weights (uint32) in pairs go through the processor's own product of two pairs, which is added to a float;
what is said of an input then holds of a pair. `lmm.tiles` multiplies more of them at a time.
"""

from __future__ import annotations

import platform
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import binding, ir
from numba import extending, types
from numba.core import cgutils
from numba.core import config as numba_config

LANES = 16
PANEL = 2 * LANES
GROUP = 8  # panels whose sums 16 registers hold
# Kernels are compiled once more for a literal 0 among their arguments; for this one they are not.
ZERO: Any = np.int64(0)

intrinsic: Any = extending.intrinsic  # its type says that calls take the context too
config: Any = numba_config  # whose settings come from the environment

_BYTE, _SHORT, _INT, _LONG = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_FLOAT, _HALF = ir.FloatType(), ir.HalfType()
_STORED = {"float32": _FLOAT, "uint16": _HALF, "int8": _BYTE, "uint32": _INT}
_FLOATS, _INTS = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES)
_FUSED = ("contract",)  # a product and a sum may be rounded once


def features() -> set[str]:
    """What the processor can do, as far as numba may use it."""
    if config.CPU_FEATURES is not None:
        return {name[1:] for name in config.CPU_FEATURES.split(",") if name.startswith("+")}
    try:
        return {name for name, has in binding.get_host_cpu_features().items() if has}
    except RuntimeError:  # LLVM does not know this processor
        return set()


# 32 registers of 16 floats hold the sums of 12 rows by 32 outputs; smaller sets those of 2.
TALL, SHORT = (12, 4) if "avx512f" in features() else (2, 2)
MULTIPLIES_PAIRS = "avx512bf16" in features()
_CONVERTS_HALVES = "f16c" in features() or platform.machine().lower() in ("aarch64", "arm64")


def long(value: int) -> Any:
    return ir.Constant(_LONG, value)


def _splat(b: Any, scalar: Any) -> Any:
    """A scalar in all lanes."""
    vector = ir.VectorType(scalar.type, LANES)
    one = b.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.Constant(_INT, 0))
    return b.shuffle_vector(one, one, ir.Constant(_INTS, [0] * LANES))


def _constant(value: float) -> Any:
    return ir.Constant(_FLOATS, [value] * LANES)


def _ints(value: int) -> Any:
    return ir.Constant(_INTS, [value] * LANES)


def _pointer(b: Any, address: Any, index: Any, kind: Any) -> Any:
    """To the number at an index."""
    return b.gep(b.inttoptr(address, kind.as_pointer()), [index])


def load(b: Any, address: Any, index: Any, stored: str = "float32") -> Any:
    """16 numbers that begin at an index, as floats, or pairs as they are."""
    kind = _STORED[stored]
    half = stored == "uint16" and not _CONVERTS_HALVES
    vector = ir.VectorType(_SHORT if half else kind, LANES)
    numbers = b.load(b.bitcast(_pointer(b, address, index, kind), vector.as_pointer()))
    numbers.align = 1 if stored == "int8" else 2 if stored == "uint16" else 4
    if half:
        return _widen(b, numbers)
    if stored == "uint16":
        return b.fpext(numbers, _FLOATS)
    return b.sitofp(numbers, _FLOATS) if stored == "int8" else numbers


def _widen(b: Any, halves: Any) -> Any:
    """Finite half floats, as 16-bit integers, to floats: exponents differ by 112."""
    bits = b.zext(halves, _INTS)
    size = b.shl(b.and_(bits, _ints(0x7FFF)), _ints(13))
    size = b.fmul(b.bitcast(size, _FLOATS), _constant(2.0**112))
    sign = b.shl(b.and_(bits, _ints(0x8000)), _ints(16))
    return b.bitcast(b.or_(b.bitcast(size, _INTS), sign), _FLOATS)


def _round(b: Any, floats: Any) -> Any:
    """Floats to the nearest bfloat16, and of two the even one, as integers; NaN stays NaN."""
    bits = b.bitcast(floats, _INTS)
    up = b.add(_ints(0x7FFF), b.and_(b.lshr(bits, _ints(16)), _ints(1)))
    nearest = b.lshr(b.add(bits, up), _ints(16))
    return b.select(b.fcmp_unordered("uno", floats, floats), _ints(0x7FC0), nearest)


def store(b: Any, value: Any, address: Any, index: Any) -> None:
    """Write 16 floats to where an index says."""
    pointer = b.bitcast(_pointer(b, address, index, _FLOAT), _FLOATS.as_pointer())
    b.store(value, pointer).align = 4


def _add_product(b: Any, total: Any, x: Any, y: Any) -> Any:
    """total + x y, of floats or of pairs."""
    if x.type == _INTS:  # what LLVM calls pairs has changed; it takes integers for either
        kind = ir.FunctionType(_FLOATS, [_FLOATS, _INTS, _INTS])
        dot = cgutils.get_or_insert_function(b.module, kind, "llvm.x86.avx512bf16.dpbf16ps.512")
        return b.call(dot, [total, x, y])
    return b.fadd(total, b.fmul(x, y, flags=_FUSED), flags=_FUSED)


def finish(b: Any, total: Any, scale: Any, bias: Any, rectify: Any) -> Any:
    """total * scale + bias, and 0 where that is negative if rectify is not 0; NaN stays NaN."""
    y = _add_product(b, bias, total, scale)
    negative = b.fcmp_ordered("<", y, _constant(0.0))
    wanted = b.icmp_signed("!=", rectify, long(0))
    return b.select(wanted, b.select(negative, _constant(0.0), y), y)


@intrinsic(prefer_literal=True)
def rows_times_panel(context, rows, x, x_stride, panel, stride, inputs, scale, bias, rectify, y, y_stride):
    """Write x [rows, inputs] @ panel [inputs, 32] * scale + bias to y [rows, 32]; all are floats.

    rows is a constant; strides count floats from row to row, of the panel from input to input. Negative
    results become 0 where rectify is 1.
    """
    return _rows_times(rows, "float32")


@intrinsic(prefer_literal=True)
def rows_times_pairs(context, rows, x, x_stride, panel, stride, pairs, scale, bias, rectify, y, y_stride):
    """As `rows_times_panel`, of x [rows, pairs] and a panel [pairs, 32] of pairs."""
    return _rows_times(rows, "uint32")


def _rows_times(rows: Any, stored: str) -> tuple[Any, Callable[..., Any]]:
    count = rows.literal_value

    def generate(context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        _, x, x_stride, panel, stride, inputs, scale, bias, rectify, y, y_stride = arguments
        # Without it all rows' loads move to the front, and sums are spilled to make room for them.
        fence = ir.InlineAsm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", side_effect=True)
        totals = [[cgutils.alloca_once_value(b, _constant(0.0)) for _ in range(2)] for _ in range(count)]
        with cgutils.for_range(b, inputs) as loop:
            first = b.mul(loop.index, stride)
            halves = [load(b, panel, b.add(first, long(LANES * half)), stored) for half in range(2)]
            for row in range(count):
                b.call(fence, [])
                at = b.add(b.mul(x_stride, long(row)), loop.index)
                value = _splat(b, b.load(_pointer(b, x, at, _STORED[stored])))
                for total, half in zip(totals[row], halves, strict=True):
                    b.store(_add_product(b, b.load(total), value, half), total)
        for half in range(2):
            column = long(LANES * half)
            scales, biases = load(b, scale, column), load(b, bias, column)
            for row in range(count):
                value = finish(b, b.load(totals[row][half]), scales, biases, rectify)
                store(b, value, y, b.add(b.mul(y_stride, long(row)), column))
        return context.get_dummy_value()

    address = types.intp
    return types.none(rows, *[address] * 10), generate


@intrinsic(prefer_literal=True)
def active_times_panels(
    context, panels, weights, first, stride, indices, values, count, scale, bias, rectify, y
):
    """Write the sum of values [count] times rows indices [count] of panels, times scale, plus bias, to y.

    The panels, a constant number of them, begin at number first of weights; indices are int32, all else
    floats, but for values that are pairs where the weights are. Inputs that are 0 are simply not listed.
    """
    width, stored = panels.literal_value, str(weights.dtype)

    def generate(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        _, weights, first, stride, indices, values, count, scale, bias, rectify, y = arguments
        array = context.make_array(signature.args[1])(context, b, weights)
        base = b.ptrtoint(array.data, _LONG)
        totals = [cgutils.alloca_once_value(b, _constant(0.0)) for _ in range(2 * width)]
        with cgutils.for_range(b, count) as loop:
            row = b.sext(b.load(_pointer(b, indices, loop.index, _INT)), _LONG)
            at = b.add(first, b.mul(row, stride))
            value = _splat(b, b.load(_pointer(b, values, loop.index, _INT if stored == "uint32" else _FLOAT)))
            for place, total in enumerate(totals):
                weight = load(b, base, b.add(at, long(LANES * place)), stored)
                b.store(_add_product(b, b.load(total), value, weight), total)
        for place, total in enumerate(totals):
            column = long(LANES * place)
            scales, biases = load(b, scale, column), load(b, bias, column)
            store(b, finish(b, b.load(total), scales, biases, rectify), y, column)
        return context.get_dummy_value()

    address = types.intp
    return types.none(panels, weights, *[address] * 9), generate


@intrinsic
def panel_to_floats(context, weights, first, stride, inputs, floats):
    """Write a panel [inputs, 32], which begins at number first of weights, to contiguous floats."""
    stored = str(weights.dtype)

    def generate(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        weights, first, stride, inputs, floats = arguments
        array = context.make_array(signature.args[0])(context, b, weights)
        base = b.ptrtoint(array.data, _LONG)
        with cgutils.for_range(b, inputs) as loop:
            at, to = b.add(first, b.mul(loop.index, stride)), b.mul(loop.index, long(PANEL))
            for half in (long(0), long(LANES)):
                store(b, load(b, base, b.add(at, half), stored), floats, b.add(to, half))
        return context.get_dummy_value()

    return types.none(weights, *[types.intp] * 4), generate


@intrinsic
def round_to_pairs(context, floats, pairs, count):
    """Write floats [2 count], to the nearest bfloat16 and of two the even one, to pairs; 16 divides count.

    Both may begin at the same address.
    """
    return _to_pairs(1)


@intrinsic
def split_to_pairs(context, floats, pairs, count):
    """Write floats [2 count] as sums of two bfloat16 numbers to pairs [2 count]; 16 divides count.

    Behind 16 pairs of the nearest numbers stand 16 of what is left. Both may begin at the same address.
    """
    return _to_pairs(2)


def _to_pairs(parts: int) -> tuple[Any, Callable[..., Any]]:
    def generate(context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        floats, pairs, count = arguments
        shorts = ir.VectorType(_SHORT, LANES)
        with cgutils.for_range(b, b.sdiv(count, long(LANES))) as loop:
            first = b.mul(loop.index, long(PANEL))
            rest = [load(b, floats, b.add(first, long(LANES * half))) for half in range(2)]
            for part in range(parts):
                nearest = [_round(b, values) for values in rest]
                for half, values in enumerate(nearest):
                    at = b.add(b.mul(first, long(parts)), long(PANEL * part + LANES * half))
                    to = b.bitcast(_pointer(b, pairs, at, _SHORT), shorts.as_pointer())
                    b.store(b.trunc(values, shorts), to).align = 4
                whole = [b.bitcast(b.shl(values, _ints(16)), _FLOATS) for values in nearest]
                rest = [b.fsub(values, taken) for values, taken in zip(rest, whole, strict=True)]
        return context.get_dummy_value()

    return types.none(*[types.intp] * 3), generate
