"""Intervals of means and paired differences, against values known from elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from bench import intervals


def runs(values):
    """Rows of {system: {course: [a value a seed]}}."""
    return pd.DataFrame(
        [
            {"system": system, "course": course, "seed": seed, "x": value}
            for system, courses in values.items()
            for course, seeds in courses.items()
            for seed, value in enumerate(seeds)
        ]
    )


def test_an_interval_is_students():
    values = np.array([4.1, 5.3, 3.9, 6.0, 4.4])
    found = intervals.of_means(values)
    low, high = scipy.stats.t.interval(0.95, 4, values.mean(), scipy.stats.sem(values))
    assert (found.mean - found.half, found.mean + found.half) == pytest.approx((low, high))
    assert found.units == 5 and found.p == pytest.approx(scipy.stats.ttest_1samp(values, 0).pvalue)
    # By hand: of 1 and 3 the error is 1, and 95 % of t with one degree of freedom lie within 12.706.
    assert intervals.of_means(np.array([1.0, 3.0])).half == pytest.approx(12.706, abs=1e-3)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(3)
    hit = 0
    for _ in range(1000):
        found = intervals.of_means(rng.normal(10, 2, 7))
        hit += abs(found.mean - 10) <= found.half
    assert 0.93 < hit / 1000 < 0.97


def test_seeds_of_a_course_are_no_more_witnesses():
    few = runs({"a": {"one": [1.0], "two": [2.0], "three": [4.0]}})
    many = runs({"a": {"one": [1.0] * 50, "two": [2.0] * 50, "three": [4.0] * 50}})
    assert intervals.of_runs(few, "x") == intervals.of_runs(many, "x")
    # Courses count alike, however many seeds they have.
    assert intervals.of_runs(runs({"a": {"one": [1.0] * 9, "two": [3.0]}}), "x").mean == 2


def test_of_one_course_its_seeds_are_counted():
    found = intervals.of_runs(runs({"a": {"one": [1.0, 2.0, 3.0], "none": [math.nan]}}), "x")
    assert found.units == 3 and found.half == pytest.approx(scipy.stats.t.ppf(0.975, 2) / math.sqrt(3))


def test_without_two_numbers_nothing_is_known():
    for values, mean in (([], math.nan), ([math.nan], math.nan), ([5.0, math.nan], 5.0)):
        found = intervals.of_means(np.array(values))
        np.testing.assert_equal((found.mean, found.half, found.p), (mean, math.nan, math.nan))


def test_differences_are_of_the_same_courses_and_seeds():
    """Courses differ by far more than systems do: only the pairs show it."""
    table = runs(
        {
            "a": {"flat": [1.0, 1.1], "hard": [50.0, 60.0], "odd": [9.0, 8.0]},
            "b": {"flat": [2.0, 2.2], "hard": [51.1, 61.0], "odd": [10.1, math.nan], "only": [1e6]},
        }
    )
    found = intervals.paired(table, "b", "a", "x")
    expected = scipy.stats.ttest_1samp([1.05, 1.05, 1.1], 0)
    assert found.mean == pytest.approx(3.2 / 3) and found.p == pytest.approx(expected.pvalue)
    assert intervals.of_runs(table[table["system"] == "a"], "x").half > 50 * found.half


def test_holms_correction_by_hand():
    assert intervals.corrected([0.01, 0.04, 0.03, math.nan]) == pytest.approx(
        [0.03, 0.06, 0.06, math.nan], nan_ok=True
    )
    assert intervals.corrected([0.9, 0.8]) == [1.0, 1.0]
    assert intervals.corrected([]) == []


def test_a_difference_that_is_always_there_and_one_that_never_is():
    courses = {"one": [1.0], "two": [2.0], "three": [5.0]}
    more = {name: [value + by] for (name, (value,)), by in zip(courses.items(), (1, 1.1, 0.9), strict=True)}
    noisy = {"one": [2.0], "two": [1.0], "three": [5.5]}
    table = runs({"a": courses, "same": courses, "more": more, "noisy": noisy})
    found = intervals.differences(table, "a", ["x"]).set_index("system")
    assert list(found.index) == ["same", "more", "noisy"]
    assert list(found["significant"]) == [False, True, False]
    assert found.loc["same", "difference"] == 0 and found.loc["more", "difference"] == pytest.approx(1)
    # Who is the same is no comparison, which others would have to be corrected for.
    alone = intervals.differences(table, "a", ["x"], ["noisy", "more"]).set_index("system")
    assert alone.loc["noisy", "p"] == found.loc["noisy", "p"]


def test_what_is_the_same_everywhere_is_known_as_well_as_its_signs():
    """Two courses on which someone answers one frame later are no proof, ten are."""
    for units, p in ((2, 0.5), (3, 0.25), (10, 2 / 1024)):
        found = intervals.of_means(np.full(units, 1 / 60))
        assert (found.mean, found.half, found.p) == (pytest.approx(1 / 60), 0, p)
        assert found.p == pytest.approx(scipy.stats.binomtest(units, units, 0.5).pvalue)


def test_chance_is_seldom_called_a_difference():
    rng = np.random.default_rng(1)
    called = 0
    for _ in range(40):
        names = ["a", *(f"s{i}" for i in range(4))]
        table = runs({name: {f"c{i}": rng.normal(0, 1, 1) for i in range(5)} for name in names})
        called += intervals.differences(table, "a", ["x"])["significant"].any()
    assert called <= 6  # 2 are expected
