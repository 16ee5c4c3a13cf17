"""Courses: the ready-made ones, what a file may say, and how speeds are scaled to data."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mm import courses
from mm.course import Box, Circle, Course, RandomUser, StickKey, VelocityKey, Waypoint
from motion import config
from motion.errors import UserError

TRIANGLE = tuple(Waypoint(position=p, speed=1.0) for p in ((0, 0), (0, 4), (3, 4)))

# Table 3.1 of the thesis: position, speed.
THESIS = [(-30, 40, 2.5), (-50, 0, 2.5), (-25, -25, 10.5), (25, -40, 10.5), (10, -10, 2.0), (25, 50, 2.5)]


@pytest.mark.parametrize("name", courses.names())
def test_every_ready_made_course_loads_and_survives_plain_data(name):
    course = courses.load(name)
    assert course.name == name and course.description
    assert config.from_dict(Course, course.to_dict()) == course


def test_the_promised_courses_are_there():
    promised = (
        "thesis circle square star wave figure-of-eight start-stop turn-180 strafe speed-steps random still"
    )
    assert set(promised.split()) <= set(courses.names())


def test_the_thesis_course_is_its_table():
    course = courses.load("thesis")
    assert [(*w.position, w.speed) for w in course.waypoints] == THESIS
    assert [w.gait for w in course.waypoints] == ["walk", "walk", "run", "run", "crouch", "walk"]
    assert [w.facing for w in course.waypoints] == [None, (-0.5, -0.5), None, None, None, (0, -1)]
    assert course.closed


def test_the_thesis_course_at_human_speeds_is_a_lap_of_a_minute_or_two():
    from mm.driver import Driver

    course = courses.load("thesis").scaled(walk=1.4, run=3.5)
    assert 60 < Driver(course).nominal < 120
    assert [w.speed for w in course.waypoints] == pytest.approx([1.4, 1.4, 3.5, 3.5, 1.12, 1.4])
    assert course.waypoints[1].position == (-25, 0)
    assert "scaled" in course.description and "lengths x 0.5" in course.description
    assert course.scale == pytest.approx({"walk": 1.4 / 2.5, "run": 3.5 / 10.5, "size": 0.5})


def test_scaling_twice_is_scaling_to_the_second():
    once = courses.load("thesis").scaled(walk=1.0, run=2.0)
    twice = courses.load("thesis").scaled(walk=3.0, run=5.0).scaled(walk=1.0, run=2.0)
    assert twice.scale == pytest.approx(once.scale) and twice.description == once.description
    np.testing.assert_allclose([w.speed for w in twice.waypoints], [w.speed for w in once.waypoints])


def test_a_size_alone_leaves_speeds():
    course = courses.load("thesis").scaled(size=0.1)
    assert course.waypoints[0].position == (-3, 4) and course.waypoints[2].speed == 10.5


def test_data_that_only_walks_walks_all_of_it():
    course = courses.load("thesis").scaled(walk=1.3)
    assert max(w.speed for w in course.waypoints) == pytest.approx(1.3)
    assert max(k.speed for k in courses.load("speed-steps").scaled(walk=1.3).velocity) == pytest.approx(1.3)


def test_data_that_only_runs_runs_all_of_it():
    assert courses.load("circle").scaled(run=3.0).waypoints[0].speed == pytest.approx(3.0)


def test_a_sticks_speeds_scale_and_are_capped():
    speeds = courses.load("strafe").scaled(walk=1.4, run=2.0).speeds
    assert speeds.walk == pytest.approx((1.4, 1.2, 1.0)) and speeds.run == pytest.approx((2.0, 1.5, 1.25))
    assert courses.load("strafe").scaled(max_speed=1.3).speeds.walk == pytest.approx((1.3, 1.3, 1.25))
    assert max(w.speed for w in courses.load("thesis").scaled(max_speed=3).waypoints) == 3


def test_velocities_keep_their_directions():
    course = Course(velocity=(VelocityKey(time=0, velocity=(3, 4)),), seconds=1).scaled(walk=1)
    assert course.velocity[0].velocity == pytest.approx((0.6, 0.8))


@pytest.mark.parametrize("speed", [0, -1, math.nan, math.inf])
def test_scaling_to_a_speed_that_is_none(speed):
    with pytest.raises(UserError, match="walk"):
        courses.load("circle").scaled(walk=speed)


def test_an_unknown_name_lists_the_courses():
    with pytest.raises(UserError, match=r"no course 'cicle'.*circle.*thesis"):
        courses.load("cicle")


def test_a_missing_file(tmp_path):
    with pytest.raises(UserError, match="cannot read"):
        courses.load(tmp_path / "none.toml")


def test_a_file_of_ones_own_is_named_by_its_file(tmp_path):
    path = tmp_path / "mine.toml"
    config.dump(Course(waypoints=TRIANGLE), path)
    assert courses.load(path) == Course(waypoints=TRIANGLE, name="mine")


WAYPOINTS = "waypoints = [{position = [0, 0], speed = 1}, {position = [0, 4], speed = 1}]\n"


@pytest.mark.parametrize(
    "text, message",
    [
        (WAYPOINTS + "lap = 2", "lap: unknown key; choose from .*laps"),
        ("waypoints = [{position = [0, 0], sped = 1}]", r"waypoints\[0\]\.sped: unknown key; choose.*speed"),
        ("waypoints = []", "nothing; give one of waypoints, stick, velocity and random"),
        ("", "nothing; give one of"),
        (WAYPOINTS + "random = {}\nseconds = 3", "waypoints and random"),
        ("waypoints = [{position = [0, 0], speed = 1}]", "waypoints: 1 of them; give at least 2"),
        (WAYPOINTS.replace("speed = 1", "speed = -1", 1), r"waypoints\[0\]\.speed: -1.0 is not above 0"),
        (WAYPOINTS.replace("speed = 1", "speed = 0", 1), r"waypoints\[0\]\.speed: 0.0 is not above 0"),
        (WAYPOINTS.replace("speed = 1", "speed = nan", 1), r"waypoints\[0\]\.speed: expected a number"),
        (WAYPOINTS.replace("speed = 1", "speed = inf", 1), r"waypoints\[0\]\.speed: inf is not finite"),
        (
            WAYPOINTS.replace("speed = 1", 'speed = "1"', 1),
            r"waypoints\[0\]\.speed: expected a number, found '1'",
        ),
        (WAYPOINTS.replace("[0, 4]", "[0, 4, 1]"), r"waypoints\[1\]\.position: expected 2 values, found 3"),
        (WAYPOINTS.replace("[0, 4]", "[0, inf]"), r"waypoints\[1\]\.position: .*not finite"),
        (WAYPOINTS.replace("[0, 4]", "[0, 0]"), r"waypoints\[0\]: in the same place as the next"),
        (
            WAYPOINTS.replace("speed = 1", 'speed = 1, gait = "jog"', 1),
            "'jog' is no choice; .*walk, run, crouch",
        ),
        (
            WAYPOINTS.replace("speed = 1", "speed = 1, facing = [0, 0]", 1),
            r"\[0\]\.facing: a direction of length 0",
        ),
        (WAYPOINTS + "laps = 2", "laps: 2 on an open way; set closed"),
        (WAYPOINTS + "laps = 0\nclosed = true", "laps: 0"),
        (WAYPOINTS + "closed = 1", "closed: expected true or false"),
        (WAYPOINTS + "closed = true\nsmooth = true", "waypoints: 2 of them; give at least 3"),
        (WAYPOINTS + "corner_speed = 0", "corner_speed"),
        (WAYPOINTS + "seconds = 0", "seconds: 0.0 is not above 0"),
        (WAYPOINTS + "[[circles]]\ncenter = [1, 1]\nradius = -1", r"circles\[0\]\.radius"),
        (WAYPOINTS + "[[boxes]]\ncenter = [1, 1]\nsize = [0, 1]", r"boxes\[0\]\.size"),
        ("stick = [{time = 0}]", "seconds: missing key"),
        ("seconds = 2\nstick = [{time = 1}]", r"stick\[0\]\.time: 1.0; the first key's time is 0"),
        ("seconds = 2\nstick = [{time = 0}, {time = 1}, {time = 1}]", r"stick\[2\]\.time: 1.0 after 1.0"),
        ("seconds = 2\nstick = [{time = 0, move = [0, 2]}]", r"stick\[0\]\.move: tilt .* from -1 to 1"),
        ("seconds = 2\nvelocity = [{time = 0}]", r"velocity\[0\]\.velocity: missing key"),
        ("seconds = 2\n[random]\nstop = 2", r"random\.stop: share 2.0"),
        ("seconds = 2\n[random]\nhold = [2, 1]", r"random\.hold"),
        ("seconds = 2\n[random]\nseed = -1", r"random\.seed"),
        (WAYPOINTS + "[speeds]\nwalk = [1, 1, -1]", r"speeds\.walk"),
        (WAYPOINTS + "[", "not valid TOML"),
    ],
)
def test_faults_name_the_key(tmp_path, text, message):
    path = tmp_path / "course.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        courses.load(path)
    assert str(path) in str(caught.value)


def test_code_is_checked_as_files_are():
    with pytest.raises(UserError, match="gait"):
        Waypoint(position=(0, 0), speed=1, gait="trot")  # type: ignore[arg-type]
    with pytest.raises(UserError, match="closed = true leads back"):
        Course(waypoints=(*TRIANGLE, TRIANGLE[0]), closed=True)


def test_a_random_user_is_the_same_for_the_same_seed_and_no_one_elses():
    assert RandomUser(seed=3).keys(20) == RandomUser(seed=3).keys(20)
    assert RandomUser(seed=3).keys(20) != RandomUser(seed=4).keys(20)
    # A longer script begins as the shorter one.
    assert RandomUser(seed=3).keys(40)[:5] == RandomUser(seed=3).keys(20)[:5]


def test_a_random_user_keeps_to_its_shares():
    keys = RandomUser(stop=0.25, run=0.5, strafe=0.1, hold=(0.5, 1.5)).keys(4000)
    gaps = np.diff([k.time for k in keys])
    assert gaps.min() >= 0.5 and gaps.max() <= 1.5 and gaps.mean() == pytest.approx(1, abs=0.05)
    assert np.mean([k.move == (0, 0) for k in keys]) == pytest.approx(0.25, abs=0.04)
    assert np.mean([k.gait == "run" for k in keys]) == pytest.approx(0.5, abs=0.04)
    assert np.mean([k.strafe for k in keys]) == pytest.approx(0.1, abs=0.04)
    assert {k.gait for k in keys} == {"walk", "run"}


def test_a_random_user_who_crouches_does_so_in_its_share():
    keys = RandomUser(run=0.5, crouch=0.3, hold=(0.5, 1.5)).keys(4000)
    shares = [np.mean([k.gait == gait for k in keys]) for gait in ("crouch", "run", "walk")]
    np.testing.assert_allclose(shares, [0.3, 0.35, 0.35], atol=0.03)


def test_obstacles_are_rows_for_a_controller_and_scale_with_the_way():
    course = Course(
        waypoints=TRIANGLE,
        circles=(Circle(center=(1, 2), radius=0.5),),
        boxes=(Box(center=(3, 4), size=(2, 6)),),
    )
    np.testing.assert_allclose(course.obstacles(), [[1, 2, 0, 0, 0.5], [3, 4, 1, 3, 0]])
    np.testing.assert_allclose(course.scaled(size=2).obstacles(), 2 * course.obstacles())
    assert Course(waypoints=TRIANGLE).obstacles().shape == (0, 5)


def test_a_stick_course_spells_its_random_user_out():
    course = courses.load("random")
    assert course.script() == course.random.keys(course.seconds)
    assert Course(stick=(StickKey(time=0),), seconds=1).script() == (StickKey(time=0),)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"seconds": 1e9}, "seconds"),
        ({"seconds": 1.0, "hold": (1e-9, 1.0)}, "hold"),
        ({"waypoints": [(i, 0) for i in range(1001)]}, "waypoints"),
        ({"waypoints": [(0, 0), (1e6, 0)]}, "position"),
        ({"waypoints": [(0, 0), (1, 0), (1, 1)], "closed": True, "laps": 10**9}, "laps"),
    ],
)
def test_courses_without_end_are_refused(changes, key):
    with pytest.raises(UserError) as caught:
        ways = [Waypoint(position=p, speed=1) for p in changes.pop("waypoints", [])]
        hold = changes.pop("hold", (1.0, 2.0))
        script = {} if ways else {"random": RandomUser(hold=hold)}
        Course(**{**changes, **script}, waypoints=tuple(ways))
    assert key in str(caught.value)
