"""The number reader equals Python's float, the printer equals Python's formatting, on any decimal."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion import digits


def read(text: str | bytes, columns: int, most_rows: int = 1 << 40):
    data = np.frombuffer(text if isinstance(text, bytes) else text.encode(), np.uint8)
    return digits.read_table(data, columns, most_rows)


def same_bits(a, b) -> bool:
    return np.array_equal(
        np.asarray(a, np.float64).view(np.uint64), np.asarray(b, np.float64).view(np.uint64)
    )


numerals = st.builds(
    lambda sign, whole, point, fraction, exponent: (
        sign + whole + (("." + fraction) if point or not whole else "") + exponent
    ),
    st.sampled_from(["", "-", "+"]),
    st.text("0123456789", max_size=24),
    st.booleans(),
    st.text("0123456789", min_size=1, max_size=24),
    st.one_of(st.just(""), st.builds(lambda e, n: f"{e}{n}", st.sampled_from("eE"), st.integers(-330, 14))),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(numerals, min_size=1, max_size=20))
def test_every_numeral_reads_as_float(tokens):
    tokens = [token for token in tokens if abs(float(token)) <= digits.LIMIT] or ["0"]
    table, fault = read(" ".join(tokens), len(tokens))
    assert fault is None
    assert same_bits(table[0], [float(token) for token in tokens])


def test_thousands_of_numerals_read_as_float():
    """As those above, but many, which are drawn faster."""
    rng = random.Random(0)

    def run(least: int) -> str:
        return "".join(rng.choices("0123456789", k=rng.randint(least, 24)))

    tokens = []
    for _ in range(30_000):
        whole, exponent = run(0), rng.choice(["", "", f"{rng.choice('eE')}{rng.randint(-330, 14)}"])
        fraction = "." + run(1) if not whole or rng.random() < 0.5 else ""
        token = rng.choice(["", "-", "+"]) + whole + fraction + exponent
        if abs(float(token)) <= digits.LIMIT:
            tokens.append(token)
    assert len(tokens) > 10_000
    table, fault = read(" ".join(tokens), len(tokens))
    assert fault is None
    expected = [float(token) for token in tokens]
    wrong = [token for token, x, y in zip(tokens, table[0], expected, strict=True) if not same_bits(x, y)]
    assert not wrong


@pytest.mark.parametrize("style", ["{!r}", "{:.6g}", "{:.6f}", "{:.15g}", "{:.16g}", "{:.18e}", "{:.3e}"])
def test_printed_doubles_read_as_float(style):
    rng = np.random.default_rng(1)
    values = rng.normal(size=(3000, 7)) * 10.0 ** rng.integers(-12, 6, size=(3000, 7))
    text = "\n".join(" ".join(style.format(v) for v in row) for row in values.tolist())
    table, fault = read(text, 7)
    assert fault is None
    assert same_bits(table, [[float(t) for t in line.split()] for line in text.split("\n")])
    assert same_bits(table, digits.read_table_plain(text.encode()))


HARD = """
    90071992547409.93 9007199254740.993 900719925474099.3
    0.500000000000000166533453693773481063544750213623046875
    -0 -0.0 +0 123456789012345.678 1e-320 4.9e-324 1e-400 0e999 1e-22 1e-23 .5 5. 12345678901234567e-10
    0.000000000000000000000000000000000001 999999999999999.9 2.2250738585072011e-308 7.62852e-016
"""


def test_hard_roundings():
    table, fault = read("\t".join(HARD.split()), len(HARD.split()))
    assert fault is None
    assert same_bits(table[0], [float(token) for token in HARD.split()])


def test_lines():
    table, fault = read("# a comment\n\n 1\t2 \r\n\n// 9 9 9\n3  4\n  ", 2)
    assert fault is None and table.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("text", "kind", "line", "row", "column", "token"),
    [
        ("1 2\n3\n5 6\n", digits.SHORT, 1, 1, 1, ""),
        ("1 2\n3", digits.SHORT, 1, 1, 1, ""),
        ("1 2\n\n3 4 5\n", digits.LONG, 2, 1, 2, "5"),
        ("1 2\n3 x7\n", digits.BAD, 1, 1, 1, "x7"),
        ("1 nan\n", digits.BAD, 0, 0, 1, "nan"),
        ("1 -inf\n", digits.BAD, 0, 0, 1, "-inf"),
        ("1 1e999\n", digits.BAD, 0, 0, 1, "1e999"),
        ("1 1e16\n", digits.BAD, 0, 0, 1, "1e16"),
        ("1 1_0\n", digits.BAD, 0, 0, 1, "1_0"),
        ("1 1.2.3\n", digits.BAD, 0, 0, 1, "1.2.3"),
        ("1 -\n", digits.BAD, 0, 0, 1, "-"),
        ("1 .\n", digits.BAD, 0, 0, 1, "."),
        ("1 2e\n", digits.BAD, 0, 0, 1, "2e"),
        ("1 2e+\n", digits.BAD, 0, 0, 1, "2e+"),
        ("1 0x1\n", digits.BAD, 0, 0, 1, "0x1"),
        ("1 2\0\n", digits.BAD, 0, 0, 1, "2\0"),
        ("1 " + "9" * 50_000 + "\n", digits.BAD, 0, 0, 1, "9" * 40),
    ],
)
def test_faults(text, kind, line, row, column, token):
    table, fault = read(text, 2)
    assert fault == digits.Fault(kind, line, row, column, token)
    assert table.shape == (row, 2)


def test_rows_are_bounded_by_what_is_expected_and_by_the_data():
    table, fault = read("1 2\n3 4\n5 6\n", 2, most_rows=2)
    assert fault is not None and fault.kind == digits.TOO_MANY and fault.line == 2
    assert table.tolist() == [[1, 2], [3, 4]]
    table, fault = read("1 2\n", 2, most_rows=10**15)
    assert fault is None and len(table) == 1


finite = st.floats(allow_nan=False, allow_infinity=False)
ordinary = st.one_of(
    finite,
    st.floats(-1e6, 1e6),
    st.decimals(-1000, 1000, places=6).map(float),
    st.integers(-(10**6), 10**6).map(lambda n: n / 64),  # exact ties
)


@settings(max_examples=500, deadline=None)
@given(st.lists(ordinary, min_size=1, max_size=30), st.integers(0, 18))
def test_fixed_decimals_equal_python(values, decimals):
    table = np.array([values])
    assert digits.write_table(table, decimals) == digits.write_table_plain(table, decimals)


@settings(max_examples=500, deadline=None)
@given(st.lists(ordinary, min_size=1, max_size=30))
def test_shortest_reads_back_the_same_double(values):
    text = digits.write_table(np.array([values])).decode()
    assert same_bits([float(token) for token in text.split()], values)


@settings(max_examples=500, deadline=None)
@given(st.integers(-(10**14), 10**14), st.integers(0, 22))
def test_shortest_repeats_the_printed_digits(mantissa, places):
    value = float(f"{mantissa}e-{places}")
    sign = "-" if value < 0 else ""
    whole = str(abs(mantissa)).rjust(places + 1, "0")
    expected = whole if places == 0 else f"{whole[:-places]}.{whole[-places:]}".rstrip("0").rstrip(".")
    assert digits.write_table(np.array([[value]])).decode() == f"{sign}{expected}\n"


def test_long_tables_are_written_whole():
    rng = np.random.default_rng(2)
    values = rng.normal(size=(5000, 31)).round(5)
    values[::7, 3] = math.pi * 1e-9  # needs Python's repr now and then
    text = digits.write_table(values)
    assert text.count(b"\n") == 5000
    table, fault = read(text, 31)
    assert fault is None and same_bits(table, values)
