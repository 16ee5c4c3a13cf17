"""What the numbers are said to mean."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.data import verdict


def found(near, spare, price):
    """100 frames, of which so many are there twice, and spare."""
    frames = np.arange(100)
    twice = SimpleNamespace(near=frames < near, spare=frames < spare)
    return SimpleNamespace(twice=twice, price=price, clips=SimpleNamespace(seconds=60.0))


@pytest.mark.parametrize(
    ("near", "spare", "price", "expected"),
    [
        (0, 0, 0.0, "Of 1.0 minutes 0.0% is there twice, no stretch of it could be left out."),
        (30, 20, 0.004, "30.0% is there twice, and 20.0% (12.0 s) could be left out"),
        (30, 20, 0.004, "costs 0.40% more. Worth it where memory counts."),
        (30, 3, 0.004, "costs 0.40% more. Hardly worth it."),
        (30, 20, 0.03, "costs 3.00% more. That is a price: look at the stretches first."),
        (30, 20, float("inf"), "That is a price"),
        (30, 20, None, "could be left out. Worth it"),
    ],
)
def test_what_is_there_twice_is_worth_its_price_or_not(near, spare, price, expected):
    assert expected in verdict.twice(found(near, spare, price))


def test_of_many_names_the_first_are_said():
    assert verdict._some(["a", "b"], "more") == "a, b"
    assert verdict._some([*"abcde"], "columns") == "a, b, c and 2 more columns"
