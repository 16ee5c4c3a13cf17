"""Names of codecs: what they mean, and what is no codec."""

from __future__ import annotations

import pytest

from mm.codecs.codec import Codec, parse
from motion.errors import UserError

NAMES = {
    "float32": Codec(),
    "float16": Codec("float16"),
    "recomputed": Codec(recomputed=True),
    "float16+recomputed": Codec("float16", recomputed=True),
    "quantised-11": Codec("quantised", 11, True),
    "keyframes-0.5": Codec(recomputed=True, keyframes=0.5),
    "keyframes-2+quantised-16": Codec("quantised", 16, True, 2.0),
    "keyframes-0.125+float16": Codec("float16", 0, True, 0.125),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_a_codec_and_back(name: str) -> None:
    assert parse(name) == NAMES[name]
    assert parse(name.split("+")) == NAMES[name] == parse(name.split("+")[::-1])
    assert parse(name).name == name


def test_velocities_are_recomputed_of_what_is_rounded_anyway() -> None:
    assert parse("recomputed+quantised-11") == parse("quantised-11")
    assert parse("quantised-11", features="pq").features == "pq"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("zip", "no codec 'zip'"),
        ("", "no codec ''"),
        ("quantised", "no codec 'quantised'"),
        ("quantised--3", "no codec"),
        ("quantised-5", "5 bits"),
        ("quantised-19", "19 bits"),
        ("float16+quantised-11", "in two ways"),
        ("quantised-11+quantised-12", "in two ways"),
        ("recomputed+recomputed", "no codec 'recomputed'"),
        ("float16-2", "no codec"),
        ("keyframes", "no codec"),
        ("keyframes-nan", "no codec"),
        ("keyframes-0", "an error of 0 cm"),
        ("keyframes-101", "an error of 101 cm"),
        ("keyframes-1+keyframes-2", "no codec 'keyframes-2'"),
        ("features", "no codec 'features'"),
        ("features-4bit", "'4bit'.*8bit, pq"),
        ("features-pq+features-8bit", "no codec 'features-8bit'"),
    ],
)
def test_what_is_no_codec(name: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        parse(name)


def test_features_stand_in_the_whole_name() -> None:
    whole = "keyframes-0.5+quantised-11+features-8bit"
    codec = parse(whole)
    assert codec == Codec("quantised", 11, True, 0.5, "8bit") and codec.whole_name == whole
    assert codec.name == "keyframes-0.5+quantised-11"
    assert (
        parse("features-pq").whole_name == "float32+features-pq" and parse("float16").whole_name == "float16"
    )
    assert parse("float16+features-pq", features="8bit").features == "pq"


def test_unknown_features() -> None:
    with pytest.raises(UserError, match=r"'4bit'.*8bit, pq"):
        parse("float16", features="4bit")
