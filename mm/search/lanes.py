"""Vector instructions for the inner loops of `exact`: 16 boxes or 16 rows at a time.

numba offers none, and its own vectorisation of these loops is several times slower; so they are written in
LLVM's vector types, which every processor's back end maps to what it has. Addresses are those of contiguous
arrays (`array.ctypes.data`); columns come in multiples of `UNROLL`.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils

LANES = 16
UNROLL = 4

intrinsic: Any = extending.intrinsic  # its type says that calls take the context too

_INT, _LONG, _FLOAT, _HALF = ir.IntType(32), ir.IntType(64), ir.FloatType(), ir.HalfType()
_FLOATS, _HALVES = ir.VectorType(_FLOAT, LANES), ir.VectorType(_HALF, LANES)
_BITS = ir.IntType(LANES)
# Sums may be reassociated and fused: callers leave room for rounding. Infinities and NaN keep their meaning.
_FAST = ("reassoc", "contract", "nsz")


def _long(value: int) -> Any:
    return ir.Constant(_LONG, value)


def _zeros() -> Any:
    return ir.Constant(_FLOATS, [0.0] * LANES)


def _splat(b: Any, scalar: Any) -> Any:
    """A scalar in all lanes."""
    one = b.insert_element(ir.Constant(_FLOATS, ir.Undefined), scalar, ir.Constant(_INT, 0))
    return b.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def _scalar_at(b: Any, address: Any, index: Any) -> Any:
    return b.load(b.gep(b.inttoptr(address, _FLOAT.as_pointer()), [index]))


def _floats(b: Any, address: Any, index: Any) -> Any:
    """Pointer to 16 floats that begin at an index."""
    at = b.gep(b.inttoptr(address, _FLOAT.as_pointer()), [index])
    return b.bitcast(at, _FLOATS.as_pointer())


def _floats_at(b: Any, address: Any, index: Any) -> Any:
    load = b.load(_floats(b, address, index))
    load.align = 4
    return load


def _halves_at(b: Any, address: Any, index: Any) -> Any:
    """16 half floats as floats."""
    load = b.load(b.gep(b.inttoptr(address, _HALVES.as_pointer()), [index]))
    load.align = 2
    return b.fpext(load, _FLOATS)


def _add_square(b: Any, total: Any, value: Any) -> None:
    square = b.fmul(value, value, flags=_FAST)
    b.store(b.fadd(b.load(total), square, flags=_FAST), total)


def _max(b: Any, x: Any, y: Any) -> Any:
    return b.select(b.fcmp_ordered(">", x, y), x, y)


def _box_gap(b: Any, boxes: Any, point: Any, column: Any) -> Any:
    """Distances of a point to 16 boxes in one column."""
    corner = b.mul(column, _long(2))
    at = _splat(b, _scalar_at(b, point, column))
    under = b.fsub(_halves_at(b, boxes, corner), at, flags=_FAST)
    over = b.fsub(at, _halves_at(b, boxes, b.add(corner, _long(1))), flags=_FAST)
    return _max(b, _max(b, under, over), _zeros())


def _below(b: Any, values: Any, limit: Any) -> Any:
    """Bit l set where lane l is below limit, as a 64-bit integer."""
    return b.zext(b.bitcast(b.fcmp_ordered("<", values, limit), _BITS), _LONG)


@intrinsic
def turn(context, vector, width, matrix, columns, product):
    """Write vector [width] @ matrix [width, columns] to product [columns], all floats; 16 divides columns."""

    def generate(context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        vector, width, matrix, columns, product = arguments
        with cgutils.for_range(b, b.sdiv(columns, _long(LANES))) as block:
            total = cgutils.alloca_once(b, _FLOATS)
            b.store(_zeros(), total)
            first = b.mul(block.index, _long(LANES))
            with cgutils.for_range(b, width) as loop:
                row = b.add(b.mul(loop.index, columns), first)
                values = _floats_at(b, matrix, row)
                scaled = b.fmul(_splat(b, _scalar_at(b, vector, loop.index)), values, flags=_FAST)
                b.store(b.fadd(b.load(total), scaled, flags=_FAST), total)
            b.store(b.load(total), _floats(b, product, first)).align = 4
        return context.get_dummy_value()

    return types.none(types.intp, types.intp, types.intp, types.intp, types.intp), generate


@intrinsic
def box_gaps(context, boxes, point, columns, limit, gaps):
    """Write squared distances of a point [columns] to 16 boxes [columns, 2 (lower, upper), 16] to gaps [16].

    Boxes are half floats, point and gaps floats. Returns bits of the boxes that are nearer than limit.
    """

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        boxes, point, columns, limit, gaps = arguments
        totals = [cgutils.alloca_once_value(b, _zeros()) for _ in range(2)]
        with cgutils.for_range(b, b.sdiv(columns, _long(UNROLL))) as loop:
            for u in range(UNROLL):
                column = b.add(b.mul(loop.index, _long(UNROLL)), _long(u))
                _add_square(b, totals[u % 2], _box_gap(b, boxes, point, column))
        total = b.fadd(b.load(totals[0]), b.load(totals[1]), flags=_FAST)
        b.store(total, _floats(b, gaps, _long(0))).align = 4
        return _below(b, total, _splat(b, limit))

    return types.int64(types.intp, types.intp, types.intp, types.float32, types.intp), generate


@intrinsic
def near_rows(context, rows, point, columns, limit):
    """Bits of the 32 rows [columns, 32] of half floats whose squared distance to a point is below limit.

    Stops as soon as there are none.
    """

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        rows, point, columns, limit = arguments
        limit = _splat(b, limit)
        totals = [cgutils.alloca_once_value(b, _zeros()) for _ in range(2)]
        bits = cgutils.alloca_once_value(b, _long(0))
        with cgutils.for_range(b, b.sdiv(columns, _long(UNROLL))) as loop:
            for u in range(UNROLL):
                column = b.add(b.mul(loop.index, _long(UNROLL)), _long(u))
                at = _splat(b, _scalar_at(b, point, column))
                for half, total in enumerate(totals):
                    values = _halves_at(b, rows, b.add(b.mul(column, _long(2)), _long(half)))
                    _add_square(b, total, b.fsub(values, at, flags=_FAST))
            low, high = (_below(b, b.load(total), limit) for total in totals)
            found = b.or_(low, b.shl(high, _long(LANES)))
            b.store(found, bits)
            with b.if_then(b.icmp_unsigned("==", found, _long(0))):
                loop.do_break()
        return b.load(bits)

    return types.int64(types.intp, types.intp, types.intp, types.float32), generate


def _sum_of_norms(
    b: Any, ends: Any, blocks: Any, columns: Any, slack: Any, gaps_of: Any, parts: int
) -> list[Any]:
    """Sums over blocks of the norm of gaps, and the squared norm of those behind, in parts of 16 lanes.

    gaps_of(column) gives the parts. From the sum of norms the first slack is taken away, from the last norm
    the second.
    """
    kind = ir.FunctionType(_FLOATS, [_FLOATS])
    root = cgutils.get_or_insert_function(b.module, kind, f"llvm.sqrt.v{LANES}f32")
    sums = [cgutils.alloca_once_value(b, _zeros()) for _ in range(parts)]
    squares = [cgutils.alloca_once(b, _FLOATS) for _ in range(parts)]
    first = cgutils.alloca_once_value(b, _long(0))

    def add_block(end: Any) -> None:
        for square in squares:
            b.store(_zeros(), square)
        with cgutils.for_range_slice(b, b.load(first), end, _long(1), _LONG) as (column, _):
            for square, gap in zip(squares, gaps_of(column), strict=True):
                _add_square(b, square, gap)
        b.store(end, first)

    with cgutils.for_range(b, blocks) as loop:
        ends_at = b.inttoptr(ends, _LONG.as_pointer())
        add_block(b.load(b.gep(ends_at, [loop.index])))
        for total, square in zip(sums, squares, strict=True):
            norm = b.call(root, [b.load(square)])
            b.store(b.fadd(b.load(total), norm, flags=_FAST), total)
    add_block(columns)
    costs = []
    for total, square in zip(sums, squares, strict=True):
        norms = _max(b, b.fsub(b.load(total), _splat(b, slack[0])), _zeros())
        last = _max(b, b.fsub(b.call(root, [b.load(square)]), _splat(b, slack[1])), _zeros())
        costs.append(b.fadd(norms, b.fmul(last, last)))
    return costs


@intrinsic
def box_norms(context, boxes, point, ends, blocks, columns, limit, slack, gaps):
    """As `box_gaps`, for sums of norms: blocks of columns end at ends [blocks], integers of 64 bits.

    The gap is the sum of the blocks' distances and the squared distance in the columns behind them, both
    distances less slack.
    """

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        boxes, point, ends, blocks, columns, limit, slack, gaps = arguments

        def gaps_of(column: Any) -> list[Any]:
            return [_box_gap(b, boxes, point, column)]

        (cost,) = _sum_of_norms(b, ends, blocks, columns, (slack, slack), gaps_of, 1)
        b.store(cost, _floats(b, gaps, _long(0))).align = 4
        return _below(b, cost, _splat(b, limit))

    address, real = types.intp, types.float32
    return types.int64(*[address] * 5, real, real, address), generate


@intrinsic
def near_norms(context, rows, point, ends, blocks, columns, limit, first_slack, last_slack):
    """As `near_rows`, for sums of norms as in `box_norms`, without stopping early."""

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        rows, point, ends, blocks, columns, limit, *slack = arguments

        def gaps_of(column: Any) -> list[Any]:
            at = _splat(b, _scalar_at(b, point, column))
            places = [b.add(b.mul(column, _long(2)), _long(half)) for half in range(2)]
            return [b.fsub(_halves_at(b, rows, place), at, flags=_FAST) for place in places]

        costs = _sum_of_norms(b, ends, blocks, columns, slack, gaps_of, 2)
        low, high = (_below(b, cost, _splat(b, limit)) for cost in costs)
        return b.or_(low, b.shl(high, _long(LANES)))

    address, real = types.intp, types.float32
    return types.int64(*[address] * 5, real, real, real), generate


@intrinsic
def lowest_bit(context, bits):
    """Index of the lowest bit set of a 64-bit integer that is not 0."""

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        return b.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate
