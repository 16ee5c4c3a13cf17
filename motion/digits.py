"""Numbers as text, exactly and fast: tables of decimals to float64 and back.

Reading gives the double that Python's ``float`` gives. A decimal of at most 15 digits is an integer below
2^53 times or over a power of ten that a double holds, so one operation rounds it right (Clinger 1990); up to
18 digits a quotient in double-double (Dekker 1971) decides; what stays in doubt goes to ``float`` itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

LIMIT = 1e15  # no length or angle of a motion is larger
OK, IN_DOUBT, NO_NUMBER = 0, 1, 2
DONE, SHORT, LONG, TOO_MANY, BAD, FULL = 0, 1, 2, 3, 4, 5

_POWERS = 10.0 ** np.arange(23)
_EXACT = 1 << 53
_SHORTEST = -1


@numba.njit(cache=True, nogil=True, inline="always")
def _product(a, b):
    """Product of two doubles as a double and its rounding error (Dekker's two-product)."""
    p = a * b
    t = 134217729.0 * a
    ah = t - (t - a)
    al = a - ah
    t = 134217729.0 * b
    bh = t - (t - b)
    bl = b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@numba.njit(cache=True, nogil=True, inline="always")
def _quotient(high, low, power):
    """(high + low) / power in double-double."""
    q = high / power
    product, error = _product(q, power)
    return q, (((high - product) - error) + low) / power


@numba.njit(cache=True, nogil=True)
def _long_quotient(mantissa, places):
    """mantissa (int64, 1 to 2^62) / 10^places (1 to 44), and whether its rounding is beyond doubt."""
    high = float(mantissa)
    low = float(mantissa - np.int64(high))
    high, low = _quotient(high, low, _POWERS[min(places, 22)])
    if places > 22:
        high, low = _quotient(high, low, _POWERS[places - 22])
    value = high + low
    error = low - (value - high)
    fraction, exponent = math.frexp(value)
    half = math.ldexp(1.0, exponent - 54)
    if fraction == 0.5:
        half /= 2
    return value, abs(error) < half * (1 - 1e-9)


@numba.njit(cache=True, nogil=True, inline="always")
def to_double(mantissa, exponent):
    """mantissa (int64, 0 to 2^62) times 10^exponent, and whether it is surely the nearest double."""
    if mantissa < _EXACT:
        if -22 <= exponent <= 0:
            return mantissa / _POWERS[-exponent], True
        if 0 < exponent <= 22:
            return mantissa * _POWERS[exponent], True
        if mantissa == 0:
            return 0.0, True
    if -44 <= exponent < 0:
        return _long_quotient(mantissa, -exponent)
    return 0.0, False


@numba.njit(cache=True, nogil=True, inline="always")
def is_space(c):
    """Whether a byte is ASCII white space."""
    return c == 32 or 9 <= c <= 13


@numba.njit(cache=True, nogil=True, inline="always")
def scan(data, i, n):
    """The number that starts at byte i and ends at white space or n: end, status, value.

    Grammar: sign, digits with or without a point, exponent; no ``nan``, no ``1_000``.
    """
    negative = data[i] == 45
    if negative or data[i] == 43:
        i += 1
    mantissa = np.int64(0)
    exponent = np.int64(0)
    begin = i
    while i < n and np.uint8(data[i] - 48) < 10:
        mantissa = mantissa * 10 + np.int64(data[i] - 48)
        i += 1
    count = i - begin
    if i < n and data[i] == 46:
        i += 1
        begin = i
        while i < n and np.uint8(data[i] - 48) < 10:
            mantissa = mantissa * 10 + np.int64(data[i] - 48)
            i += 1
        exponent = np.int64(begin - i)
        count += i - begin
    if count == 0:
        return i, NO_NUMBER, 0.0
    if i < n and (data[i] | 32) == 101:
        i += 1
        minus = i < n and data[i] == 45
        if i < n and (minus or data[i] == 43):
            i += 1
        begin = i
        power = np.int64(0)
        while i < n and np.uint8(data[i] - 48) < 10:
            power = min(power * 10 + np.int64(data[i] - 48), np.int64(100_000))
            i += 1
        if i == begin:
            return i, NO_NUMBER, 0.0
        exponent += -power if minus else power
    if i < n and not is_space(data[i]):
        return i, NO_NUMBER, 0.0
    if count > 18:
        return i, IN_DOUBT, 0.0
    value, sure = to_double(mantissa, exponent)
    return i, OK if sure else IN_DOUBT, -value if negative else value


@numba.njit(cache=True, nogil=True)
def _read(data, state, out, doubts):
    """Fill rows of out from lines of data; returns a status.

    state holds byte, line, row and column to go on from, and gets the number of doubts noted.
    """
    n = len(data)
    i, line, row, column, noted = state[0], state[1], state[2], state[3], 0
    rows, columns = out.shape
    status = DONE
    while i < n:
        c = data[i]
        if is_space(c):
            if c == 10:
                if column > 0:
                    if column < columns:
                        status = SHORT
                        break
                    row += 1
                    column = 0
                line += 1
            i += 1
            continue
        if column == 0 and (c == 35 or (c == 47 and i + 1 < n and data[i + 1] == 47)):
            while i < n and data[i] != 10:
                i += 1
            continue
        if row == rows:
            status = TOO_MANY
            break
        if column == columns:
            status = LONG
            break
        end, kind, value = scan(data, i, n)
        if kind == OK and abs(value) <= LIMIT:
            out[row, column] = value
        elif kind == IN_DOUBT:
            if noted == len(doubts):
                status = FULL
                break
            doubts[noted, 0], doubts[noted, 1], doubts[noted, 2] = row, column, line
            doubts[noted, 3], doubts[noted, 4] = i, end
            noted += 1
        else:
            status = BAD
            break
        column += 1
        i = end
    if status == DONE and column > 0:
        if column < columns:
            status = SHORT
        else:
            row += 1
            column = 0
    state[0], state[1], state[2], state[3], state[4] = i, line, row, column, noted
    return status


@dataclass
class Fault:
    """Where and why a table could not be read: `kind` is SHORT, LONG, TOO_MANY or BAD.

    line is 0-based within the data; column is the number of values before the fault; token the text there.
    """

    kind: int
    line: int
    row: int
    column: int
    token: str


def token_at(data: Bytes, i: int) -> str:
    """The text from byte i to the next white space, cut at 40 characters."""
    text = bytes(data[i : i + 40])
    return text.split(maxsplit=1)[0].decode("ascii", "replace") if text.split() else ""


def read_table(data: Bytes, columns: int, most_rows: int) -> tuple[NDArray[np.float64], Fault | None]:
    """Read lines of `columns` numbers each: a float64 table of the whole rows, and the fault that ended it.

    Blank lines and lines that begin with ``#`` or ``//`` are skipped. At most `most_rows` rows are expected,
    and memory is bounded by the length of data whatever `most_rows` says.
    """
    out = np.empty((min(most_rows, len(data) // (2 * columns) + 1), columns))
    doubts = np.empty((1024, 5), np.int64)
    state = np.zeros(5, np.int64)
    view = data.data
    while True:
        kind = _read(data, state, out, doubts)
        for row, column, line, at, end in doubts[: state[4]].tolist():
            value = float(view[at:end]) if end - at < 4096 else math.inf
            if not abs(value) <= LIMIT:
                return out[:row], Fault(BAD, line, row, column, token_at(data, at))
            out[row, column] = value
        if kind != FULL:
            break
    i, line, row, column, _ = state.tolist()
    if kind == DONE:
        return out[:row], None
    return out[:row], Fault(kind, line, row, column, "" if kind == SHORT else token_at(data, i))


def read_table_plain(data: bytes) -> NDArray[np.float64]:
    """The obvious twin of `read_table`, for tables without fault."""
    lines = (
        line for line in data.split(b"\n") if line.strip() and not line.lstrip().startswith((b"#", b"//"))
    )
    return np.array([[float(token) for token in line.split()] for line in lines])


@numba.njit(cache=True, nogil=True, inline="always")
def _scaled(value, decimals):
    """value * 10^decimals rounded half to even as the exact product; value >= 0, product below 9e17."""
    p, error = _product(value, _POWERS[decimals])
    if p >= _EXACT / 2:  # p is whole; the error holds what is beyond
        whole = math.floor(error)
        m = np.int64(p) + np.int64(whole)
        over = (error - whole) - 0.5
        error = 0.0
    else:  # over is 0 or larger than the error
        whole = math.floor(p)
        m = np.int64(whole)
        over = (p - whole) - 0.5
    if over > 0 or (over == 0 and (error > 0 or (error == 0 and m % 2 == 1))):
        m += 1
    return m


@numba.njit(cache=True, nogil=True)
def _shortest(value, guess):
    """The fewest decimals (-1 when not 22 do) that read back as value >= 0, and all digits as an integer."""
    d = guess
    while d > 0 and value * _POWERS[d] >= 2.0**51:
        d -= 1
    while d <= 22:
        if value * _POWERS[d] >= 9e17:
            return -1, np.int64(0)
        m = _scaled(value, d)
        back, sure = to_double(m, -d)
        if sure and back == value:
            while d > 0 and m % 10 == 0:
                m //= 10
                d -= 1
            return d, m
        d += 1
    return -1, np.int64(0)


@numba.njit(cache=True, nogil=True)
def _write(values, begin, decimals, columns, buffer):
    """Print values[begin:] into buffer until it is full or one needs Python: index reached, bytes written."""
    at = 0
    guess = np.int64(6)
    digits = np.empty(24, np.uint8)
    for index in range(begin, len(values)):
        if at + 34 > len(buffer):
            return index, at
        value = values[index]
        size = abs(value)
        places = decimals
        if places == _SHORTEST:
            if not size < 9e17:
                return index, at
            places, m = _shortest(size, guess)
            if places < 0:
                return index, at
            guess = np.int64(max(places, 1))
        else:
            if not size * _POWERS[places] < 9e17:
                return index, at
            m = _scaled(size, places)
        if math.copysign(1.0, value) < 0:
            buffer[at] = 45
            at += 1
        count = 0
        while m > 0 or count <= places:
            next_m = m // 10
            digits[count] = np.uint8(48 + m - next_m * 10)
            m = next_m
            count += 1
        for k in range(count - 1, -1, -1):
            buffer[at] = digits[k]
            at += 1
            if k == places and places > 0:
                buffer[at] = 46
                at += 1
        buffer[at] = 10 if (index + 1) % columns == 0 else 32
        at += 1
    return len(values), at


def write_table(values: NDArray[np.float64], decimals: int | None = None) -> bytes:
    """Text of a table ``[rows, columns]``: one line a row, numbers separated by a blank.

    decimals (0 to 18) prints as Python's ``f"{v:.{decimals}f}"`` does; None prints the fewest decimals that
    read back as the same double.
    """
    columns = values.shape[1]
    flat = np.ascontiguousarray(values, np.float64).reshape(-1)
    buffer = np.empty(min(1 << 20, 34 * max(flat.size, 1)), np.uint8)
    pieces, index = [], 0
    while index < flat.size:
        reached, used = _write(flat, index, _SHORTEST if decimals is None else decimals, columns, buffer)
        pieces.append(buffer[:used].tobytes())
        if reached < flat.size and used + 34 <= len(buffer):
            value = float(flat[reached])
            text = repr(value) if decimals is None else f"{value:.{decimals}f}"
            pieces.append(text.encode() + (b"\n" if (reached + 1) % columns == 0 else b" "))
            reached += 1
        index = reached
    return b"".join(pieces)


def write_table_plain(values: NDArray[np.float64], decimals: int) -> bytes:
    """The obvious twin of `write_table` with a fixed number of decimals."""
    return b"".join(
        b" ".join(f"{value:.{decimals}f}".encode() for value in row) + b"\n" for row in values.tolist()
    )
