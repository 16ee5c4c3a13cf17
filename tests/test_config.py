"""TOML to dataclasses: what is accepted, and how a fault is told."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion import config
from motion.config import ConfigError
from motion.errors import UserError


@dataclass(frozen=True)
class Wheel:
    radius: float
    kind: Literal["road", "mud"] = "road"

    def __post_init__(self) -> None:
        if self.radius <= 0:
            raise ConfigError("radius", f"expected a positive number, found {self.radius:g}")


@dataclass(frozen=True)
class Car:
    name: str
    wheels: tuple[Wheel, ...] = ()
    doors: int = 4
    electric: bool = False
    size: tuple[float, float] = (4.0, 1.8)
    notes: str | None = None
    parts: dict[str, float] = field(default_factory=dict)
    spare: Wheel | None = None
    manual: Path | None = None


FULL = """\
name = "beetle"
doors = 2
size = [4, 1.5]
manual = "book.txt"

[parts]
"door left" = 20

[spare]
radius = 0.3

[[wheels]]
radius = 0.3

[[wheels]]
radius = 0.4
kind = "mud"
"""


def fault(tmp_path: Path, text: str) -> UserError:
    path = tmp_path / "car.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        config.load(Car, path)
    assert caught.value.path == str(path)
    return caught.value


def test_reads_every_kind_of_field(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text(FULL)
    car = config.load(Car, path)
    assert car == Car(
        "beetle",
        (Wheel(0.3), Wheel(0.4, "mud")),
        2,
        size=(4.0, 1.5),
        parts={"door left": 20.0},
        spare=Wheel(0.3),
        manual=Path("book.txt"),
    )
    assert isinstance(car.size[0], float)


def test_dump_and_load_round_trip(tmp_path):
    car = Car("a", (Wheel(1.5, "mud"),), notes="two\nlines", parts={"x": math.inf}, manual=Path("b/c"))
    config.dump(car, tmp_path / "car.toml")
    assert config.load(Car, tmp_path / "car.toml") == car
    assert [path.name for path in tmp_path.iterdir()] == ["car.toml"]


@given(
    st.builds(
        Car,
        st.text(),
        st.lists(st.builds(Wheel, st.floats(1e-300, 1e300), st.sampled_from(["road", "mud"]))).map(tuple),
        st.integers(-(2**63), 2**63 - 1),
        st.booleans(),
        st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)),
        st.none() | st.text(),
        st.dictionaries(st.text(), st.floats(allow_nan=False)),
    )
)
def test_toml_text_round_trip(car):
    assert config.from_dict(Car, tomllib.loads(config.dumps(car))) == car


@pytest.mark.parametrize(
    ("text", "line", "parts"),
    [
        (FULL + 'kindd = "mud"\n', 18, ["wheels[1].kindd: unknown key", "radius, kind"]),
        (FULL.replace("doors", "dors"), 2, ["dors: unknown key", "doors", "electric"]),
        (FULL.replace('"mud"', '"mad"'), 17, ["wheels[1].kind", "'mad'", "choose from road, mud"]),
        (FULL.replace("0.4", '"big"'), 16, ["wheels[1].radius: expected a number, found 'big'"]),
        (FULL.replace("0.4", "-1"), 16, ["wheels[1].radius: expected a positive number, found -1"]),
        (FULL.replace("0.4", "nan"), 16, ["wheels[1].radius: expected a number, found nan"]),
        (FULL.replace("doors = 2", "doors = 2.5"), 2, ["doors: expected a whole number, found 2.5"]),
        (FULL.replace("doors = 2", "doors = true"), 2, ["doors: expected a whole number, found True"]),
        (FULL.replace("doors = 2", "electric = 1"), 2, ["electric: expected true or false, found 1"]),
        (FULL.replace("[4, 1.5]", "[4, 1.5, 2]"), 3, ["size: expected 2 values, found 3"]),
        (FULL.replace("[4, 1.5]", "4"), 3, ["size: expected a list, found 4"]),
        (FULL.replace("[4, 1.5]", '[4, "x"]'), 3, ["size[1]: expected a number, found 'x'"]),
        (FULL.replace("= 20", "= []"), 7, ["parts.door left: expected a number, found a list"]),
        (FULL.replace('name = "beetle"\n', ""), None, ["name: missing key"]),
        ('name = "x"\nwheels = [\n {radius = 1},\n {raduis = 1},\n]\n', 4, ["wheels[1].raduis: unknown key"]),
        ('name = "x"\nspare = 3\n', 2, ["spare: expected a table, found 3"]),
        ('name = "x"\nname = "y"\n', 2, ["not valid TOML"]),
        ('name = "x"\ndoors = \n', 2, ["not valid TOML"]),
    ],
)
def test_a_fault_names_key_line_and_choices(tmp_path, text, line, parts):
    error = fault(tmp_path, text)
    assert error.line == line
    for part in parts:
        assert part in str(error)


def test_a_missing_or_binary_file_is_told(tmp_path):
    with pytest.raises(UserError, match="cannot read: No such file"):
        config.load(Car, tmp_path / "none.toml")
    (tmp_path / "bin.toml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(UserError, match="not a text file"):
        config.load(Car, tmp_path / "bin.toml")


def test_a_byte_order_mark_and_carriage_returns_are_accepted(tmp_path):
    path = tmp_path / "car.toml"
    path.write_bytes(b"\xef\xbb\xbf" + FULL.replace("\n", "\r\n").encode())
    assert config.load(Car, path).name == "beetle"


def test_where_stands_before_the_key():
    with pytest.raises(UserError, match=r"^settings\.doors: expected a whole number"):
        config.from_dict(Car, {"name": "x", "doors": "two"}, where="settings")


def test_what_a_file_leaves_out_is_as_in_the_base(tmp_path):
    base = Car("beetle", wheels=(Wheel(0.3),), doors=2, parts={"door": 20.0}, spare=Wheel(0.3, "mud"))
    path = tmp_path / "car.toml"
    path.write_text("electric = true\n[spare]\nradius = 0.4\n[parts]\nroof = 9\n")
    found = config.load(Car, path, base=base)
    assert found == Car(
        "beetle", (Wheel(0.3),), 2, True, parts={"door": 20.0, "roof": 9.0}, spare=Wheel(0.4, "mud")
    )
    path.write_text("doors = 3\nwheels = []\n[spare]\nsize = 3\n")
    with pytest.raises(UserError, match=r"car.toml:4: spare.size: unknown key; choose from radius, kind"):
        config.load(Car, path, base=base)
    path.write_text("spare = 3\n")
    with pytest.raises(UserError, match=r"car.toml:1: spare: expected a table"):
        config.load(Car, path, base=base)


def test_validate_coerces_what_code_gives():
    @dataclass(frozen=True)
    class Point:
        at: tuple[float, ...]

        def __post_init__(self) -> None:
            config.validate(self)

    assert Point([1, 2]).at == (1.0, 2.0)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="at: expected a list"):
        Point("12")  # type: ignore[arg-type]


def test_a_failed_write_leaves_nothing(tmp_path):
    (tmp_path / "car.toml").mkdir()
    with pytest.raises(UserError, match="cannot write"):
        config.dump(Car("x"), tmp_path / "car.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["car.toml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 20_000, "nested too deeply"),
        ("a = " + "9" * 5_000, "not valid TOML"),
        ("search_interval = " + "9" * 400, "expected a number, found 999.*line"),
        ("search_interval = -1", r"file.toml:1: search_interval: -1.0 is out of range; .* 0 to 1,000,000"),
        ("search_interval = inf", "search_interval: inf is out of range"),
        ("ignore_end = 1e7", "ignore_end: 10000000.0 is out of range"),
        ('\nsynchronization = "none at all"', "toml:2: synchronization: .*no choice; choose from adjust"),
    ],
)
def test_files_that_would_overflow(tmp_path, text, message):
    from mm.settings import Settings

    (tmp_path / "file.toml").write_text(text)
    with pytest.raises(UserError, match=message.replace(".*line", "")) as caught:
        config.load(Settings, tmp_path / "file.toml")
    assert len(str(caught.value)) < 1000
