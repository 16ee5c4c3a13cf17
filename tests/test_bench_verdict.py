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
        r"The smallest that keeps mm-exact's quality is lmm-PSD: 2 MB \(50 times less\) and 15\d µs a frame "
        r"\([\d.]+ times as much\)\. Faster, for more memory: lmm-D \(8[\d.]+ µs, 20 MB\) then mm-exact "
        r"\(5[\d.]+ µs, 100 MB\)\.",
        text,
    )
    assert "still is" not in text and "None fails on any course." in text
    found = verdict.of(found)
    assert found.keeps == ("mm-exact", "lmm-PSD", "lmm-D")
    assert found.budgets == ("lmm-PSD", "lmm-D", "mm-exact")


def test_who_is_smaller_but_worse_is_named_as_such():
    found = measured({"mm-exact": MM, "pfnn-constant": (1.0, 10.0, WORSE), "lmm-D": (20.0, 80.0, {})})
    text = sentences(found)
    assert "The smallest that keeps mm-exact's quality is lmm-D: 20 MB" in text
    assert re.search(
        r"Smaller and faster still is pfnn-constant, 1 MB and 10[\d.]* µs a frame, but it has more foot "
        r"skate \(\+10[\d.]* ± [\d.]+ cm/s\)\.",
        text,
    )
    assert verdict.of(found).keeps == ("mm-exact", "lmm-D")
    line = verdict.of(found).systems["pfnn-constant"]
    assert "more foot skate (+10" in line and "no significant difference in distance from the path" in line


def test_nothing_keeps_the_quality_but_the_yardstick():
    text = sentences(measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, WORSE)}))
    assert "No other system keeps mm-exact's quality" in text and "Smaller still is lmm-PSD" in text


def test_more_memory_for_no_less_time_is_not_advised():
    text = sentences(measured({"mm-exact": (100.0, 50.0, {}), "small": (5.0, 50.0, {})}))
    assert "quality is small: 5 MB" in text and "100 MB)" not in text
    assert "None that takes more memory is shown to be faster." in text


def test_ties_are_told_as_ties():
    found = measured({"mm-exact": MM, "lmm-D": (20.0, 50.1, {}), "lmm-PSD": (2.0, 150.0, {})})
    text = sentences(found)
    assert "Faster, for more memory: lmm-D (5" in text and "100 MB)" not in text
    assert verdict.of(found).budgets == ("lmm-PSD", "lmm-D")
    assert "is shown to be better than mm-exact in foot skate, distance from the path or jerk." in text
    # Two of the very same motion.
    same = found.runs[found.runs["system"] == "mm-exact"].assign(system="mm-kdtree")
    rows = found.summary[found.summary["system"] == "mm-exact"].assign(system="mm-kdtree")
    both = replace(found, summary=pd.concat([found.summary, rows]), runs=pd.concat([found.runs, same]))
    assert verdict.of(both).systems["mm-kdtree"].endswith("the same motion.")
    assert "No system is shown to be better" in sentences(both)


def test_who_is_better_is_told_with_how_much():
    found = measured({"mm-exact": MM, "lmm-D": (20.0, 80.0, {"skate_cm_s": 5.0})})
    text = sentences(found)
    assert re.search(r"Better than mm-exact: lmm-D in foot skate \(−5[\d.]* ± [\d.]+ cm/s\)\.", text)
    assert "No system is shown to be better than mm-exact in distance from the path or jerk." in text
    smooth = sentences(measured({"mm-exact": MM, "lmm-PSD": (2.0, 150.0, {"jerk_m_s3": 60.0})}))
    assert re.search(r"Better than mm-exact: lmm-PSD in jerk \(−[\d.]+ ± [\d.]+ m/s³\)\.", smooth)


def test_what_answers_nothing_is_not_as_good_for_what_it_answers():
    """Of commands that were not answered no time is known: how many those are is held against a system."""
    quick = {"speed_response_s": 0.5, "unanswered_share": 0.0}
    seldom = quick | {"unanswered_share": odd("steps", 1.0, 0.4)}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, quick), "lmm-D": (20.0, 80.0, seldom)}))
    assert found.keeps == ("mm-exact",)
    assert "has more commands left unanswered (+52 ± 33.3 %)" in found.paragraph


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
    assert "lmm-PSD: 2 MB (50 times less) and 1" in text
    said = re.search(
        r"That holds on average: 5 courses cannot rule out that it has up to ([\d.]+) cm/s more foot skate "
        r"\(([\d.]+) is allowed\)\.",
        text,
    )
    assert said and float(said[1]) > float(said[2]) == pytest.approx(2.5, rel=0.05)


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
    assert "Better than" not in found.paragraph and found.budgets == ("mm-exact",)


def test_what_is_of_a_system_and_not_of_its_runs_is_not_tested():
    """The error of decoded poses is the same in all runs: it is known, however few courses there are."""
    decoded = {"mm-exact": 0.0, "lmm-D": 0.3, "mm-exact-float16": 0.0, "pfnn-cubic": math.nan}
    systems = {n: (9.0, 9.0, {"pose_cm": lambda course, v=v: v}) for n, v in decoded.items()}
    found = measured(systems)
    few = replace(found, runs=found.runs[found.runs["course"].isin(COURSES[:2])])
    lines = verdict.of(few).systems
    assert "more error of decoded poses (+0.3 cm)" in lines["lmm-D"]
    assert "no difference at all in error of decoded poses" in lines["mm-exact-float16"]
    assert "decoded" not in lines["pfnn-cubic"] and not few.lost("pfnn-cubic")


def test_of_many_that_fail_some_are_named():
    lost = {"stall_s": odd("strafe", 7.0, 0.1)}
    systems = {"mm-exact": MM} | {f"mann-{i}": (1.0, 5.0, lost) for i in range(8)}
    text = sentences(measured(systems))
    assert "8 systems fail: mann-0, mann-1, mann-2, mann-3 and 4 others." in text


def test_what_breaks_motion_matching_as_well_is_the_courses_fault():
    stalls = {"stall_s": odd("strafe", 7.0, 0.1)}
    found = verdict.of(measured({"mm-exact": (100.0, 50.0, stalls), "lmm-D": (20.0, 80.0, stalls)}))
    assert list(found.breaks) == ["mm-exact"] and set(found.keeps) == {"mm-exact", "lmm-D"}
    assert (
        "mm-exact itself stands still for 7 s when asked to go on strafe; others fail there if they do"
        in found.paragraph
    )
    assert "No other fails on any course." in found.paragraph and "still is mm-exact" not in found.paragraph


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
    assert "In a crowd of 4,096 the cheapest is mm-exact, 7 µs a character (too close to call: lmm-D)" in text
    assert "lmm-D); the most expensive is lmm-PSD, 9 µs." in text
    worse = systems | {"mm-exact": MM, "lmm-D": (20.0, 80.0, WORSE)}
    faster = [*crowd[:-1], ("lmm-D", 4096, 1.0, 0.9, 1.1)]
    text = sentences(measured(worse, faster))
    assert (
        "lmm-D, 1 µs a character, which does not keep the quality; of those that do it is mm-exact, 7 µs"
        in text
    )
    alone = sentences(measured(systems, crowd[:1]))
    assert "In a crowd of 1 mm-exact takes 50 µs a character." in alone


def test_missing_systems_and_numbers():
    assert verdict.of(Measured(pd.DataFrame(), pd.DataFrame())).paragraph == "No system was measured."
    # Without motion matching nothing is held against anything, and all the rest is told.
    without = verdict.of(measured({"pfnn-cubic": (9.0, 900.0, {}), "pfnn-constant": (50.0, 100.0, {})}))
    assert without.reference is None and "no exact motion matching among them" in without.paragraph
    assert (
        "The smallest that fails on no course is pfnn-cubic: 9 MB" in without.paragraph and not without.rule
    )
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


def test_one_system_alone_is_compared_to_none():
    found = verdict.of(measured({"mm-exact": MM}))
    assert re.fullmatch(
        r"1 system on 5 courses, 10 runs each\. Motion matching with exact search, mm-exact, is the "
        r"yardstick: 100 MB and 5[\d.]+ µs a frame\.",
        found.paragraph,
    )
    assert not found.rule and not found.systems


def test_one_run_alone_tests_nothing_and_says_so():
    found = measured({"mm-exact": MM, "lmm-D": (20.0, 80.0, WORSE)}, seeds=1)
    one = found.runs[found.runs["course"] == "star"]
    text = sentences(replace(found, runs=one))
    assert "of one run no difference can be tested" in text and "Better" not in text and "shown" not in text
    assert "more foot skate" not in verdict.of(replace(found, runs=one)).systems["lmm-D"]


def number(text):
    return float(text.replace(",", ""))


@pytest.mark.parametrize("seed", range(6))
def test_whatever_the_tables_are_what_it_says_is_in_them(seed):
    """Of systems drawn at random every claim is looked up."""
    rng = np.random.default_rng(seed)
    systems = {}
    for name in ("mm-exact", *(f"lmm-{i}" for i in range(rng.integers(1, 8)))):
        metrics = {"skate_cm_s": rng.uniform(8, 14), "path_cm": rng.uniform(4, 8)}
        if rng.random() < 0.25 and name != "mm-exact":
            metrics["stall_s"] = odd(rng.choice(COURSES), 7.0, 0.1)
        if rng.random() < 0.2:
            metrics["path_cm"] = math.nan
        systems[name] = (rng.uniform(1, 100), rng.uniform(10, 100), metrics)
    crowd = [(name, 256, us := rng.uniform(1, 20), 0.95 * us, 1.05 * us) for name in systems]
    found = measured(systems, crowd)
    judged, text = verdict.of(found), sentences(found)
    memory, time = ({n: found.of(n, column) for n in systems} for column in (verdict.MEMORY, verdict.COST))
    keeps, own = judged.keeps, found.summary.set_index("system")
    for name in set(systems) - set(keeps):
        more = [own[m][name] - max(1.25 * own[m]["mm-exact"], own[m]["mm-exact"] + slack)
                for m, slack in (("skate_cm_s", 1.0), ("path_cm", 2.0))]  # fmt: skip
        assert name in judged.breaks or not all(
            one <= 0 or math.isnan(own["path_cm"]["mm-exact"]) for one in more
        )
    assert list(judged.budgets) == sorted(judged.budgets, key=memory.get)
    assert [time[n] for n in judged.budgets] == sorted((time[n] for n in judged.budgets), reverse=True)
    if said := re.search(r"The smallest that keeps mm-exact's quality is (\S+): ([\d.,]+) MB", text):
        assert said[1] == min(keeps, key=memory.get) and number(said[2]) == pytest.approx(
            memory[said[1]], rel=0.01
        )
    else:
        assert set(keeps) <= {"mm-exact"}
    said = re.search(r"Faster, for more memory: ([^:]+)\. [A-Z]", text)
    for name, megabytes in re.findall(r"(\S+) \([\d.,]+ µs, ([\d.,]+) MB", said[1] if said else ""):
        smaller = [n for n in keeps if memory[n] < memory[name]]
        assert name in keeps and number(megabytes) == pytest.approx(memory[name], rel=0.01)
        assert all(time[name] < time[n] for n in judged.budgets if n in smaller)
    for words, name in re.findall(r"(Smaller|Faster|Smaller and faster) still is (\S+),", text):
        assert name not in keeps
        assert "aster" not in words or time[name] < min(time[n] for n in keeps)
        assert "maller" not in words or memory[name] < min(memory[n] for n in keeps)
    cheapest = re.search(r"In a crowd of 256 the cheapest is (\S+),", text)[1]
    assert cheapest == min(crowd, key=lambda row: row[2])[0]
    assert ("None fails" in text) == (not judged.breaks)
    assert all(f"{name} " in text or "others" in text for name in judged.breaks)
