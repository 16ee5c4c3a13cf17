"""The comparison: a system whose truth is known, matching on a small database, what is left on disk."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import page_html
import pandas as pd
import pytest

from bench import plots, report, strips, systems, timing
from bench.comparison import DATA, compare, memory_mb
from features import terrain, terrain_made
from mm import quality
from mm.controller import Controller
from mm.course import Circle, Course, VelocityKey, Waypoint
from mm.courses import load
from mm.driver import Driver
from mm.driving import natural_seconds
from mm.recording import Recording
from mm.settings import Settings
from motion import figures, quat
from motion.errors import UserError
from motion.pose import Poses


class Obedient:
    """Does a share of what it is asked, at once: slides along in one pose, facing as asked."""

    def __init__(self, database, count, name, share=1.0):
        self.name, self.skeleton, self.fps, self.count = name, database.skeleton, database.fps, count
        self.share = share
        pose = database.poses[np.zeros(count, int)]
        self.pose = pose.copy()

    def reset(self, positions, yaws):
        self.position, self.yaw = np.array(positions, np.float64), np.array(yaws, np.float64)

    def step(self, command) -> Poses:
        self.position = self.position + self.share * command.velocity / self.fps
        self.yaw = np.array(command.yaw)
        self.pose.positions[:, 0] = np.stack(
            [self.position[:, 0], np.zeros(self.count), self.position[:, 1]], axis=-1
        )
        self.pose.rotations[:, 0] = quat.from_yaw(self.yaw)
        return self.pose

    def record(self):
        return {"transition": np.zeros(self.count, bool)}

    def memory(self):
        return {"pose": 1_500_000, "look up": 500_000}


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


STRAIGHT = Course(
    name="straight",
    waypoints=(Waypoint(position=(0.0, 0.0), speed=2.0), Waypoint(position=(0.0, 20.0), speed=2.0)),
)
STEPS = Course(
    name="steps",
    velocity=(
        VelocityKey(time=0.0, velocity=(0.0, 0.0)),
        VelocityKey(time=1.0, velocity=(0.0, 1.0)),
        VelocityKey(time=2.0, velocity=(1.5, 0.0)),
    ),
    seconds=4.0,
)


@pytest.fixture(scope="module")
def known(database):
    entries = [
        systems.Entry("obedient", lambda db, n, obstacles=(): Obedient(db, n, "obedient")),
        systems.Entry("half", lambda db, n, obstacles=(): Obedient(db, n, "half", share=0.5)),
    ]
    return compare(
        database, courses=[STRAIGHT, STEPS], systems=entries, seconds=5, timed_seconds=0.2, scale=False
    )


@pytest.fixture(scope="module")
def matched(database):
    return compare(
        database, courses=["circle", "start-stop"], systems=["mm-brute*"], seconds=3, timed_seconds=0.2
    )


def cell(result, system, column, course=None):
    table = result.summary if course is None else result.courses
    rows = table[table["system"] == system]
    return (rows if course is None else rows[rows["course"] == course])[column].item()


def test_an_obedient_system_has_no_error(known):
    straight = {"system": "obedient", "course": "straight"}
    assert cell(known, **straight, column="path_cm") == pytest.approx(0, abs=1e-3)
    assert cell(known, **straight, column="heading_deg") == pytest.approx(0, abs=1e-3)
    assert cell(known, **straight, column="speed_ratio") == pytest.approx(1, abs=1e-3)
    assert cell(known, **straight, column="speed_mps") == pytest.approx(2, abs=0.02)
    # It carries one pose about: every frame that moves glides, nothing ever pops, nothing is matched.
    assert cell(known, **straight, column="glide_share") == 1
    assert cell(known, **straight, column="transitions_per_s") == 0
    assert np.isnan(cell(known, **straight, column="pop_cm"))
    assert cell(known, **straight, column="ordinary_pop_cm") == pytest.approx(0, abs=1e-3)


def test_a_slow_system_is_seen_to_be_slow(known):
    assert cell(known, "half", "speed_ratio", "straight") == pytest.approx(0.5, abs=1e-3)
    assert cell(known, "half", "unanswered_share", "steps") > 0
    assert cell(known, "obedient", "unanswered_share", "steps") == 0
    # Smoothing over 0.2 s is all that stands between command and answer.
    assert cell(known, "obedient", "speed_response_s", "steps") <= 0.1 + 2 / 60
    assert cell(known, "obedient", "heading_response_s", "steps") <= 0.1 + 2 / 60


def test_all_systems_run_for_the_same_time(known, matched):
    for result in (known, matched):
        seconds = result.courses.groupby("course")["seconds"]
        assert (seconds.nunique() == 1).all()
    assert cell(known, "half", "seconds", "straight") == pytest.approx(5)
    assert cell(known, "obedient", "seconds", "steps") == pytest.approx(4)  # the course's own length


def test_memory_is_given_by_part_and_summed(known, database):
    assert cell(known, "half", "memory_mb") == pytest.approx(2)
    assert cell(known, "half", "memory_look_up_mb") == pytest.approx(0.5)
    assert memory_mb(Obedient(database, 1, "x")) == {
        "memory_mb": 2.0,
        "memory_pose_mb": 1.5,
        "memory_look_up_mb": 0.5,
    }


def test_the_summary_averages_courses_and_takes_the_worst_pop(matched):
    for column in ("skate_cm_s", "heading_deg", "transitions_per_s"):
        rows = matched.courses[matched.courses["system"] == "mm-brute"][column]
        assert cell(matched, "mm-brute", column) == pytest.approx(rows.mean())
    rows = matched.courses[matched.courses["system"] == "mm-brute"]["pop_cm"]
    assert cell(matched, "mm-brute", "pop_cm") == pytest.approx(rows.max())
    assert cell(matched, "mm-brute", "courses") == 2


def test_motion_matching_follows_walks_and_costs_time(matched):
    assert list(matched.summary["system"]) == [DATA, "mm-brute", "mm-brute-free"]
    assert cell(matched, "mm-brute", "path_cm", "circle") < 30
    assert cell(matched, "mm-brute", "transitions_per_s") > 0
    for column in ("frame_us", "frame_p99_us", "search_us", "projection_us", "foot_lock_us", "memory_mb"):
        assert cell(matched, "mm-brute", column) > 0
    # Locking is after the fact: the feet differ, the way does not.
    assert cell(matched, "mm-brute", "path_cm") == cell(matched, "mm-brute-free", "path_cm")
    assert cell(matched, "mm-brute", "skate_cm_s") < cell(matched, "mm-brute-free", "skate_cm_s")
    # The synthetic walker's own feet stand still.
    assert cell(matched, DATA, "skate_cm_s") < 0.5 * cell(matched, "mm-brute-free", "skate_cm_s")


def test_a_comparison_repeats_itself(database, matched):
    again = compare(
        database, courses=["circle", "start-stop"], systems=["mm-brute*"], seconds=3, timed_seconds=0.1
    )
    times = [c for c in matched.courses.columns if c.endswith(("_us", "_bytes"))]
    pd.testing.assert_frame_equal(matched.courses.drop(columns=times), again.courses.drop(columns=times))


def test_speeds_are_scaled_to_the_data_and_it_says_so(matched, database):
    assert any("scaled to the data" in note for note in matched.notes)
    fastest = max(waypoint.speed for waypoint in matched.played[0].waypoints)
    assert fastest == pytest.approx(matched.database["walk_mps"], rel=1e-3)
    assert matched.database["fingerprint"] == database.fingerprint


def test_a_system_that_the_database_cannot_have_is_left_out_with_a_note(database, monkeypatch):
    def impossible(database, count, *, obstacles=()):
        raise UserError("needs more data")

    monkeypatch.setattr(
        systems,
        "motion_matching",
        lambda indexes=None: [
            systems.Entry("obedient", lambda db, n, obstacles=(): Obedient(db, n, "obedient")),
            systems.Entry("big", impossible),
        ],
    )
    options = {"courses": [STEPS], "seconds": 1.0, "timed_seconds": 0.1}
    result = compare(database, **options)
    assert list(result.summary["system"]) == [DATA, "obedient"]
    assert any("big is left out: needs more data" in note for note in result.notes)
    with pytest.raises(UserError, match="needs more data"):
        compare(database, systems=["big"], **options)


def test_a_database_without_feet_is_compared_without_skate(database, tmp_path):
    footless = replace(database, contact_roles=(), contacts=database.contacts[:, :0])
    result = compare(footless, courses=["circle"], systems=["mm-brute-free"], seconds=1, timed_seconds=0.1)
    assert np.isnan(cell(result, "mm-brute-free", "skate_cm_s")) and np.isnan(
        cell(result, DATA, "glide_share")
    )
    assert cell(result, "mm-brute-free", "path_cm") >= 0
    report.save(result, tmp_path, command="")
    facts = json.loads((tmp_path / "summary.json").read_text())
    assert facts["summary"][1]["skate_cm_s"] is None and facts["database"]["foot_joints"] == []


def test_the_obstacles_of_a_course_are_in_the_way(database):
    ahead = replace(STRAIGHT, circles=(Circle(center=(0.3, 3.0), radius=0.5),))
    result = compare(
        database, courses=[STRAIGHT, ahead], systems=["mm-brute-free"], seconds=4, timed_seconds=0.1
    )
    clear, blocked = (np.linalg.norm(trace.walked - [0.3, 3.0], axis=1).min() for trace in result.traces)
    # The simulated object keeps the body's radius away, and the character may be that far from it.
    keeps = Settings().body_radius - Settings().maximal_distance
    assert clear < 0.4 and blocked > 0.5 + keeps - 0.01


def test_equal_runs_are_asked_and_judged_once(database, monkeypatch):
    asked, judged = [], []
    real_command, real_judge = Driver.command, quality.judge
    monkeypatch.setattr(Driver, "command", lambda *a: asked.append(a[0].course.name) or real_command(*a))
    monkeypatch.setattr(quality, "judge", lambda *a, **k: judged.append(k["course"]) or real_judge(*a, **k))
    shares = {"one": 1.0, "same": 1.0, "half": 0.5, "again": 1.0}
    entries = [
        systems.Entry(name, lambda db, n, obstacles=(), name=name: Obedient(db, n, name, share=shares[name]))
        for name in shares
    ]
    result = compare(database, courses=[STRAIGHT, STEPS], systems=entries, seconds=2, timed_seconds=0.1)
    assert judged == ["straight", "steps", "straight", "steps"]
    assert len(asked) == 2 * 2 * 120  # two ways a course
    numbers = result.courses[
        [c for c in result.courses if not c.endswith(("_us", "_bytes")) and c != "system"]
    ]
    for course in range(2):
        pd.testing.assert_series_equal(numbers.iloc[course], numbers.iloc[6 + course], check_names=False)
        assert numbers.iloc[4 + course]["speed_ratio"] < 0.6 * numbers.iloc[course]["speed_ratio"]
    assert [t.system for t in result.traces] == list(result.courses["system"])


HILLS = replace(terrain_made.make(4, "hills", size=(10, 10)), name="hills.txt")


@pytest.fixture(scope="module")
def uneven(database):
    return compare(
        database, courses=["circle"], systems=["mm-brute"], seconds=3, timed_seconds=0.2, ground=HILLS
    )


def test_level_ground_leaves_every_number_as_it_is(database, matched):
    level = terrain.Heightmap(np.zeros((9, 9), np.float32), 2.0)
    options = {"courses": ["circle", "start-stop"], "seconds": 3, "timed_seconds": 0.1}
    found = compare(database, systems=["mm-brute*"], ground=level, **options)
    for table in ("summary", "courses"):
        plain, put = getattr(matched, table), getattr(found, table)
        more = {"sink_cm", "sink_p99_cm", "hover_cm", "memory_ground_mb", "ground_us"}
        assert {c.removesuffix("_ci95") for c in set(put) - set(plain)} == more
        same = [c for c in plain if "_us" not in c and "_bytes" not in c and c != "memory_mb"]
        pd.testing.assert_frame_equal(put[same], plain[same])
    assert all(trace.same(other) for trace, other in zip(matched.traces, found.traces, strict=True))


def test_on_hills_feet_stand_and_ways_are_those_of_the_plane(uneven, matched):
    for column in ("path_cm", "speed_ratio", "heading_deg"):
        assert cell(uneven, "mm-brute", column) == cell(matched, "mm-brute", column, "circle")
    for name, most in (("sink_cm", 0.5), ("hover_cm", 1.0)):
        assert 0 <= cell(uneven, "mm-brute", name) < most and cell(uneven, DATA, name) < most
    assert cell(uneven, "mm-brute", "sink_cm") < cell(uneven, "mm-brute", "sink_p99_cm") < 5
    assert cell(uneven, "mm-brute", "ground_us") > 0
    heights = uneven.traces[0].poses[:, 0, 1]
    assert np.ptp(heights) > 0.1


def test_the_report_says_what_was_walked_on(uneven, tmp_path):
    assert any("hills.txt: 10.0 x 10.0 m" in note for note in uneven.notes)
    report.save(uneven, tmp_path, command="")
    facts = json.loads((tmp_path / "summary.json").read_text())
    assert facts["ground"]["name"] == "hills.txt" and facts["summary"][1]["sink_cm"] >= 0
    words = " ".join(Page((tmp_path / "report.html").read_text("utf-8")).text)
    assert "hills.txt" in words and "the ground beneath it" in words and "ground, m" in words
    assert {"sink cm", "hover cm"} <= set(report.brief(uneven.summary)[0])


def test_who_sees_the_ground_is_told_of_it_and_others_are_put_on_it(database):
    told = []

    def seeing(database, count, *, obstacles=(), **seen):
        told.append(seen)
        return Controller(database, count=count)

    entries = [
        systems.Entry("blind", seeing),
        systems.Entry("seeing", seeing, sees_ground=True),
        systems.Entry("footless", lambda db, n, obstacles=(): Obedient(db, n, "footless")),
    ]
    small = replace(HILLS, heights=HILLS.heights[:60, :60], origin=None)
    found = compare(database, courses=[STRAIGHT], systems=entries, seconds=2, timed_seconds=0.1, ground=small)
    assert told == [{}, {"ground": small}]
    assert list(found.courses["system"]) == ["blind", "seeing"]
    assert any("footless is left out: footless tells nothing of its feet" in note for note in found.notes)
    # It walks 4 m away from the middle of a ground of 2.3 m.
    assert any("% of the ways lie beyond the edges" in note for note in found.notes)
    # Poses that were not made for the ground do not rise with it, when they are said to have been.
    heights = [trace.poses[:, 0, 1] for trace in found.traces]
    assert np.ptp(heights[0]) > 0.05 and np.ptp(heights[1]) < 1e-6


def test_registered_systems_are_chosen_by_name_family_and_pattern(monkeypatch):
    monkeypatch.setattr(systems, "_REGISTERED", {})
    systems.register("lmm-small", lambda db, n, obstacles=(): None, "a test")
    assert [e.name for e in systems.choose(["lmm"])] == ["lmm-small"]
    names = [e.name for e in systems.choose(["mm-*-free"], indexes=["brute", "aabb"])]
    assert names == ["mm-brute-free", "mm-aabb-free"]
    assert [e.name for e in systems.choose(None, indexes=["brute"])] == [
        "mm-brute",
        "mm-brute-free",
        "lmm-small",
    ]
    with pytest.raises(
        UserError, match=r"no system 'gnn'; choose from mm-brute, mm-aabb, .*lmm-small.* -free"
    ):
        systems.choose(["gnn"])
    with pytest.raises(UserError, match="no search index 'nope'; choose from brute"):
        systems.choose(None, indexes=["nope"])


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_a_time_that_is_none_is_refused(database, seconds):
    with pytest.raises(UserError, match="above 0"):
        compare(database, courses=[STEPS], seconds=seconds)


def test_natural_length_of_a_course():
    assert natural_seconds(STRAIGHT) == pytest.approx(10)
    assert natural_seconds(STEPS) == pytest.approx(4)
    square = load("square")
    points = np.array([w.position for w in square.waypoints])
    around = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum()
    assert natural_seconds(square) == pytest.approx(square.laps * around / square.waypoints[0].speed)


class Page(HTMLParser):
    """Collects what a page refers to, and its text."""

    def __init__(self, text):
        super().__init__()
        self.links, self.text, self.tags = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href", "xlink:href") and not v.startswith("#")]

    def handle_data(self, data):
        self.text.append(data)


def test_the_report_is_whole_and_stands_alone(matched, tmp_path):
    paths = report.save(matched, tmp_path / "out", command="python -m bench compare clips")
    names = {str(path.relative_to(tmp_path / "out")) for path in paths}
    assert {"courses.csv", "report.html", "summary.csv", "summary.json", "tables/runs.csv"} <= names
    there = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert there == names
    summary = pd.read_csv(tmp_path / "out" / "summary.csv")
    np.testing.assert_allclose(
        summary["skate_cm_s"].to_numpy(float), matched.summary["skate_cm_s"].to_numpy(float)
    )
    facts = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert facts["summary"][1]["system"] == "mm-brute" and facts["summary"][0]["frame_us"] is None
    assert facts["command"] == "python -m bench compare clips" and facts["machine"]["numpy"]
    assert len(facts["courses"]) == 4
    text = (tmp_path / "out" / "report.html").read_text("utf-8")
    page = Page(text)
    page_html.check(text)
    words = " ".join(page.text)
    for expected in (
        "mm-brute-free",
        "circle",
        "start-stop",
        "scaled to the data",
        matched.database["fingerprint"],
    ):
        assert expected in words
    assert page.tags.count("svg") >= 4 + 2 * 2 + 2  # over all, two a course, film strips
    assert figures.INK not in text and "currentColor" in text


def test_equal_walks_are_drawn_once(matched):
    circle = [t for t in matched.traces if t.course == "circle"]
    assert len(plots.groups(circle, poses=False)) == 1
    assert len(plots.groups(circle)) == 2  # the feet differ
    alike = plots.groups(circle, poses=False)[0]
    assert plots.label(alike) == "mm-brute = mm-brute-free"
    assert plots.label(alike[:1]) == "mm-brute"
    assert plots.label([*alike, alike[0]]) == "mm-brute and 2 others alike"
    long = [replace(trace, system=f"{trace.system}-{'x' * 20}") for trace in alike]
    assert plots.label(long) == f"mm-brute-{'x' * 20} and 1 other alike"


def test_a_strip_looks_at_the_character_from_its_right():
    ahead_left_up = np.array([[0.0, 0, 0], [1.0, 2.0, 3.0]])  # left 1, up 2, ahead 3
    np.testing.assert_allclose(strips.project(ahead_left_up, 0.0)[1], [3, 2])
    np.testing.assert_allclose(strips.project(ahead_left_up, 0.0, "front")[1], [1, 2])
    np.testing.assert_allclose(strips.project(ahead_left_up, 0.0, "top")[1], [-1, 3])
    # Turned to face +X, what lies at +X is ahead.
    np.testing.assert_allclose(strips.project(ahead_left_up, np.pi / 2)[1], [1, 2], atol=1e-12)
    with pytest.raises(ValueError, match="side, front or top"):
        strips.project(ahead_left_up, 0.0, "behind")


def test_bones_of_the_two_sides_differ_in_colour(database):
    colours, skeleton = strips.bone_colours(database.skeleton), database.skeleton
    assert colours[skeleton.role("left_foot")] == strips.LEFT
    assert colours[skeleton.role("right_hand")] == strips.RIGHT
    assert colours[skeleton.role("head")] == strips.MIDDLE


def test_a_strip_is_a_picture(matched):
    with figures.style("test"):
        data = figures.png(strips.figure(matched.traces[0], feet=matched.feet))
    assert data.startswith(b"\x89PNG") and len(data) > 5000


def test_figures_of_a_strip_stand_on_the_line_of_the_ground(matched):
    from matplotlib.figure import Figure

    def slope(x, z):
        return 0.3 * x + 0.2 * z + 5.0

    trace = matched.traces[0]
    poses = trace.poses.copy()
    poses[..., 1] += slope(poses[:, :1, 0], poses[:, :1, 2])
    shown = {}
    for view in ("side", "front"):
        for name, bodies, ground in (("flat", trace.poses, None), ("slope", poses, slope)):
            axes = Figure().subplots()
            options = {} if ground is None else {"ground": ground}
            strips.draw(axes, trace.skeleton, bodies, trace.yaws, view=view, cell=1.0, **options)
            lines, bones = (c.get_segments() for c in sorted(axes.collections, key=lambda c: c.zorder))
            shown[name] = np.array(lines), np.array(bones)
        lines, bones = zip(shown["flat"], shown["slope"], strict=True)
        np.testing.assert_allclose(*bones, atol=1e-6)
        np.testing.assert_allclose(lines[0][..., 1], 0)
        for line, yaw in zip(lines[1], trace.yaws, strict=True):
            ahead, left = (np.sin(yaw), np.cos(yaw)), (np.cos(yaw), -np.sin(yaw))
            rise = np.dot((0.3, 0.2), ahead if view == "side" else left)
            assert line[:, 1] == pytest.approx(rise * (line[:, 0] - line[:, 0].mean()), abs=1e-5)


def test_feet_rest_where_the_synthetic_walker_puts_them(database):
    feet = quality.Feet.of(database)
    assert [database.skeleton.names[j] for j in feet.joints] == ["LeftToe", "RightToe"]
    np.testing.assert_allclose(feet.rest, feet.rest[0], atol=2e-3)
    assert 0 <= feet.rest[0] < 0.05


def test_a_recording_can_be_judged_from_its_file(database, tmp_path):
    from mm import recording

    system = Obedient(database, 1, "obedient")
    recording.record(system, STRAIGHT, seconds=2).save(tmp_path / "run.rec")
    tape = Recording.load(tmp_path / "run.rec")
    feet = quality.Feet.of(database)
    row, trace = quality.judge(tape.arrays, tape.skeleton, tape.fps, feet, tape.path, course="straight")
    assert row["path_cm"] == pytest.approx(0, abs=1e-3)
    assert trace.walked.shape == (120, 2) and trace.course == "straight"


def test_the_clock_pins_and_lets_go():
    import gc
    import os

    before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with timing.single_thread():
        assert not gc.isenabled()
        if before is not None:
            assert len(os.sched_getaffinity(0)) == 1
    assert gc.isenabled()
    if before is not None:
        assert os.sched_getaffinity(0) == before


def test_cost_columns():
    whole = np.full(100, 40e-6)
    whole[::10] = 240e-6
    searched = np.zeros(100, bool)
    searched[::10] = True
    cost = timing.Cost(
        whole, {"projection": np.where(searched, 200e-6, 1e-6), "foot lock": np.full(100, 5e-6)}, searched
    )
    row = cost.microseconds()
    assert row["frame_us"] == pytest.approx(40)
    assert row["frame_mean_us"] == pytest.approx(60)
    assert row["frame_p99_us"] == pytest.approx(240)
    assert row["search_us"] == pytest.approx(200)
    assert row["foot_lock_us"] == pytest.approx(5)
    both = timing.Cost.joined([cost, cost]).microseconds()
    assert both == pytest.approx(row)
