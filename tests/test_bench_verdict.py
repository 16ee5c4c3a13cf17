"""The verdict, on tables that were made up so that the answer is known."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench import verdict
from bench.verdict import Measured

COURSES = ("circle", "star", "strafe", "random", "steps")
SOUND = {"skate_cm_s": 10.0, "path_cm": 5.0, "jerk_m_s3": 150.0, "stall_s": 0.2, "speed_ratio": 1.0}


def measured(systems, crowd=(), seeds=2):
    """Tables of {system: (MB, µs, metrics)}; metrics are numbers, which wobble, or of the course."""
    runs = []
    for i, (system, (_, time, metrics)) in enumerate(systems.items()):
        noise = np.random.default_rng(i).normal(0, 0.02, len(COURSES))  # of systems that do alike
        for c, course in enumerate(COURSES):
            for seed in range(seeds):
                wobble = 1 + 0.01 * c + noise[c]
                row = {"system": system, "course": course, "seed": seed, "broke": 0.0}
                for name, value in (SOUND | metrics).items():
                    row[name] = value(course) if callable(value) else value * wobble
                row["frame_mean_us"] = math.nan if seed else time * wobble
                runs.append(row)
    table = pd.DataFrame(runs)
    means = table.drop(columns=["course", "seed"]).groupby("system", sort=False).mean().reset_index()
    means["memory_mb"] = [memory for memory, _, _ in systems.values()]
    names = ("system", "characters", "us", "least_us", "most_us")
    return Measured(means, table, pd.DataFrame([dict(zip(names, row, strict=True)) for row in crowd]))


def odd(course, there, elsewhere):
    """A metric that is another on one course."""
    return lambda at: there if at == course else elsewhere


MM = (100.0, 50.0, {})
WORSE = {"skate_cm_s": 20.0}


def sentences(found):
    return verdict.of(found).paragraph


def test_the_smallest_that_keeps_the_quality_is_named_and_what_time_it_costs():
    found = measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, {}), "lmm-D": (20.0, 80.0, {})})
    text = sentences(found)
    assert re.search(
        r"lmm-PSD is the smallest, with 2 MB \(50 times less\) and 15\d µs .* times as much", text
    )
    assert "who has 20 MB gets a cheaper frame from lmm-D, 8" in text
    assert "who has 100 MB gets a cheaper frame from mm-exact, 5" in text
    assert "The cheapest frame of one character among these is mm-exact's" in text
    assert verdict.of(found).keeps == ("mm-exact", "lmm-PSD", "lmm-D") and "None breaks." in text


def test_who_is_smaller_but_worse_is_named_as_such():
    found = measured({"mm-exact": MM, "pfnn-constant": (1.0, 10.0, WORSE), "lmm-D": (20.0, 80.0, {})})
    text = sentences(found)
    assert "lmm-D is the smallest" in text
    assert "Smaller without that is pfnn-constant, with 1 MB: it has too much foot skate." in text
    assert "pfnn-constant takes 10" in text and "without that quality" in text
    assert verdict.of(found).keeps == ("mm-exact", "lmm-D")
    line = verdict.of(found).systems["pfnn-constant"]
    assert "more foot skate (+10" in line and "no significant difference in distance from the path" in line


def test_nothing_keeps_the_quality_but_the_yardstick():
    text = sentences(measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, WORSE)}))
    assert "None but mm-exact keeps the quality" in text and "Smaller without that is lmm-PSD" in text


def test_more_memory_for_no_less_time_is_not_advised():
    text = sentences(measured({"mm-exact": (100.0, 50.0, {}), "small": (5.0, 50.0, {})}))
    assert "small is the smallest" in text and "who has 100 MB" not in text


def test_ties_are_told_as_ties():
    found = measured({"mm-exact": MM, "lmm-D": (20.0, 50.1, {}), "lmm-PSD": (2.0, 150.0, {})})
    text = sentences(found)
    cheapest = re.search(r"among these is (.*)'s, [\d.]+ µs \(not significantly less than (.*)\)\.", text)
    assert set(cheapest.groups()) == {"mm-exact", "lmm-D"}
    assert "In foot skate and distance from the path none is shown to be ahead of another." in text
    # Two of the very same motion.
    same = found.runs[found.runs["system"] == "mm-exact"].assign(system="mm-kdtree")
    rows = found.summary[found.summary["system"] == "mm-exact"].assign(system="mm-kdtree")
    both = replace(found, summary=pd.concat([found.summary, rows]), runs=pd.concat([found.runs, same]))
    assert verdict.of(both).systems["mm-kdtree"].endswith("the same motion.")
    assert "none is shown to be ahead" in sentences(both)


def test_a_difference_in_noise_is_not_called_one():
    """Half as much again in the mean, but of one course alone."""
    much = {"skate_cm_s": odd("star", 35.0, 10.0)}
    found = verdict.of(measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, much)}))
    assert "foot skate (" not in found.systems["lmm-PSD"]
    assert "no significant difference in foot skate" in found.systems["lmm-PSD"]
    # Nor is it shown to be as good.
    assert found.keeps == ("mm-exact",)
    slight = {"skate_cm_s": odd("star", 16.0, 10.0)}
    text = sentences(measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, slight)}))
    assert "(kept in the mean; its intervals reach further)" in text


@pytest.mark.parametrize(
    ("metrics", "how"),
    [
        ({"stall_s": odd("strafe", 7.0, 0.1)}, "stands still for 7 s when asked to go on strafe"),
        ({"path_max_cm": odd("star", 900.0, 30.0)}, "is 900 cm off the path on star"),
        ({"speed_ratio": odd("circle", 0.4, 1.0)}, "goes 40 % of the way that it is asked on circle"),
        ({"broke": odd("random", 1.0, 0.0)}, "shows poses that are no numbers on random"),
    ],
)
def test_who_breaks_is_told_with_the_course_and_keeps_nothing(metrics, how):
    sound = {"path_max_cm": 30.0}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, sound), "mann-4": (1.0, 5.0, sound | metrics)}))
    assert found.breaks == {"mann-4": how} and found.keeps == ("mm-exact",)
    assert f"mann-4 {how}." in found.paragraph and f"it {how}" in found.systems["mann-4"]
    assert "least with mann-4" not in found.paragraph


def test_what_breaks_motion_matching_as_well_is_the_courses_fault():
    stalls = {"stall_s": odd("strafe", 7.0, 0.1)}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, stalls), "lmm-D": (20.0, 80.0, stalls)}))
    assert list(found.breaks) == ["mm-exact"]


def test_crowds_and_who_did_as_well():
    crowd = [
        *(("mm-exact", 1, 50.0, 49, 51), ("lmm-PSD", 1, 150.0, 140, 160)),
        *(
            ("mm-exact", 4096, 7.0, 6.9, 7.4),
            ("lmm-PSD", 4096, 9.0, 8.9, 9.4),
            ("lmm-D", 4096, 7.2, 7.1, 7.3),
        ),
    ]
    systems = {"mm-exact": MM, "lmm-PSD": (2.0, 150.0, {}), "lmm-D": (20.0, 80.0, {})}
    text = sentences(measured(systems, crowd))
    assert "Of crowds of 4,096, mm-exact's is the cheapest, 7 µs a character" in text
    assert "but lmm-D did as well in some of the repeats; lmm-PSD takes 9 µs" in text
    alone = sentences(measured(systems, crowd[:1]))
    assert "In a crowd of 1 mm-exact takes 50 µs a character." in alone


def test_missing_systems_and_numbers():
    assert verdict.of(Measured(pd.DataFrame(), pd.DataFrame())).paragraph == "No system was measured."
    # Without motion matching nothing is held against anything, and all the rest is told.
    without = verdict.of(measured({"pfnn-cubic": (9.0, 900.0, {}), "pfnn-constant": (50.0, 100.0, {})}))
    assert without.reference is None and "no exact motion matching among them" in without.paragraph
    assert "pfnn-cubic is the smallest, with 9 MB" in without.paragraph
    # Feet that are not held stand for those that are.
    free = verdict.of(measured({"mm-exact-free": MM, "lmm-D-free": (20.0, 80.0, {})}))
    assert free.reference == "mm-exact-free"
    # No path anywhere: nothing is said of it. None of one system: it is not known to be as good.
    nowhere = {"path_cm": math.nan}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, nowhere), "lmm-D": (20.0, 80.0, nowhere)}))
    assert "path" not in found.paragraph and found.keeps == ("mm-exact", "lmm-D")
    found = verdict.of(measured({"mm-exact": MM, "lmm-D": (20.0, 80.0, nowhere)}))
    assert found.keeps == ("mm-exact",)
    # Networks decode no poses of frames, which is no fault of theirs.
    decoded, without = {"pose_cm": 0.0}, {"pose_cm": math.nan}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, decoded), "mann-4": (9.0, 80.0, without)}))
    assert found.keeps == ("mm-exact", "mann-4")
    # Costs that nobody took.
    found = verdict.of(measured({"mm-exact": (math.nan, math.nan, {}), "lmm-D": (20.0, math.nan, {})}))
    assert "nan" not in found.paragraph and "nan" not in " ".join(found.systems.values())


def test_one_run_alone_tests_nothing_and_says_so():
    found = measured({"mm-exact": MM, "lmm-D": (20.0, 80.0, WORSE)}, seeds=1)
    one = found.runs[found.runs["course"] == "star"]
    text = sentences(replace(found, runs=one))
    assert "of one run no difference can be tested" in text and "mm-exact's, 5" in text
    assert "more foot skate" not in verdict.of(replace(found, runs=one)).systems["lmm-D"]
