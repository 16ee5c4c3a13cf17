"""Coverage: what a course asks for is known by hand, what is near by brute force."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from bench import coverage
from bench.cli import main
from mm.course import Course, VelocityKey, Waypoint


def script(*keys, seconds=10.0, name="script"):
    return Course(name=name, velocity=tuple(VelocityKey(**key) for key in keys), seconds=seconds)


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def test_a_straight_way_asks_for_its_speed_and_no_turn():
    found = coverage.asked(script({"time": 0.0, "velocity": (0.0, 1.5)}), 60.0, seconds=10)
    assert len(found) == pytest.approx(10 / coverage.EVERY, abs=1)
    np.testing.assert_allclose(found[-1], [1.5, 0, 0], atol=1e-3)
    assert np.all(np.diff(found[:, 0]) >= -1e-6)  # it speeds up from rest


@pytest.mark.parametrize(
    ("facing", "direction"), [((1.0, 0.0), -90), ((-1.0, 0.0), 90), ((0.0, -1.0), 180), ((1.0, 1.0), -45)]
)
def test_direction_is_from_the_facing_to_the_travel_and_left_is_positive(facing, direction):
    # It goes along +Z; who faces +X, the left, goes to its own right.
    course = script({"time": 0.0, "velocity": (0.0, 1.0), "facing": facing})
    last = coverage.asked(course, 60.0, seconds=10)[-1]
    assert abs(coverage.metrics.wrap(np.radians(last[1] - direction))) < 0.01


def test_a_circle_asks_for_the_turn_of_its_radius():
    corners = 24
    way = [
        Waypoint(position=(3 * np.sin(a), 3 * np.cos(a)), speed=1.2)
        for a in np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ]
    course = Course(name="ring", waypoints=tuple(way), closed=True, smooth=True, laps=3)
    found = coverage.asked(course, 60.0, seconds=30)[60:]
    assert np.median(found[:, 0]) == pytest.approx(1.2, abs=0.05)
    # From +Z towards +X, the left.
    assert np.median(found[:, 2]) == pytest.approx(np.degrees(1.2 / 3), rel=0.1)
    assert np.abs(np.median(found[:, 1])) < 15


def test_near_is_what_brute_force_finds():
    rng = np.random.default_rng(3)
    data, wanted = (
        np.stack([rng.uniform(0, 2, n), rng.uniform(-180, 180, n), rng.uniform(-90, 90, n)], axis=-1)
        for n in (400, 150)
    )
    wanted[:20, 0] *= 0.1
    wanted[20, 1], data[0] = 179.9, (wanted[20, 0], -179.9, wanted[20, 2])
    nearest, enough, closest = coverage.near(data, wanted, few=3)
    apart = np.abs(wanted[:, None] - data)
    apart[..., 1] = np.minimum(apart[..., 1], 360 - apart[..., 1])
    apart[wanted[:, 0] <= coverage.SLOW, :, 1] = 0
    shares = (apart / coverage.NEAR).max(axis=-1)
    np.testing.assert_allclose(nearest, shares.min(axis=1), atol=1e-9)
    np.testing.assert_array_equal(enough, (shares <= 1).sum(axis=1) >= 3)
    np.testing.assert_allclose(closest, data[shares.argmin(axis=1)])
    assert nearest[20] < 0.02


def test_without_data_everything_is_a_hole():
    nearest, enough, closest = coverage.near(np.zeros((0, 3)), np.ones((4, 3)))
    assert np.isinf(nearest).all() and not enough.any() and np.isnan(closest).all()


def test_frames_do_what_the_walker_was_told(database):
    states, findable = coverage.frames_of(database)
    ranges = database.ranges()
    for name, speed, turn in (("straight", 1.2, 0.0), ("left_turn", 1.2, 0.8), ("run", 3.0, 0.2)):
        which = database.names.index(name)
        assert not database.mirrored[which]
        rows = states[(ranges == which) & findable]
        assert np.median(rows[:, 0]) == pytest.approx(speed, abs=0.05)
        assert np.median(rows[:, 2]) == pytest.approx(np.degrees(turn), abs=3)
        assert np.abs(np.median(rows[:, 1])) < 5
    left_out = np.flatnonzero(~findable)
    assert len(left_out) == 20 * len(database.starts)  # a third of a second of each range
    assert set(database.stops - 1) <= set(left_out)


def test_what_the_data_does_is_covered_and_what_it_does_not_is_a_hole(database):
    ahead = script({"time": 0.0, "velocity": (0.0, 1.2)}, name="ahead")
    aside = script({"time": 0.0, "velocity": (0.0, 1.2), "facing": (1.0, 0.0)}, name="aside")
    found = coverage.measure(database, [ahead, aside], seconds=10, scale=False)
    rows = {row["course"]: row for row in found.by_course()}
    assert rows["ahead"]["covered"] > 0.9
    assert rows["aside"]["covered"] < 0.1
    assert rows["all"]["covered"] == pytest.approx(found.share)
    assert rows["all"]["seconds"] == pytest.approx(20, abs=0.1)
    worst = found.holes(1)[0]
    assert worst["courses"] == "aside"
    assert worst["speed m/s"] == pytest.approx(1.2, abs=0.1)
    assert worst["direction °"] == pytest.approx(-90, abs=5)
    assert worst["distance"] > 1
    holes = found.holes()
    assert sum(row["seconds"] for row in holes) == pytest.approx(coverage.EVERY * (~found.covered).sum())
    assert [row["seconds"] for row in holes] == sorted((row["seconds"] for row in holes), reverse=True)


def test_few_frames_are_no_choice(database):
    course = script({"time": 0.0, "velocity": (0.0, 1.2)})
    some, all_ = (
        coverage.measure(database, [course], seconds=10, scale=False, few=few) for few in (1, len(database))
    )
    assert np.array_equal(some.enough, some.covered) and some.enough.any()
    assert not all_.enough.any()


def test_a_crouch_that_is_asked_for_is_said(database):
    key = {"time": 0.0, "velocity": (0.0, 0.8), "gait": "crouch"}
    found = coverage.measure(database, [script(key, name="low")], seconds=2)
    assert found.crouches == ["low"]
    assert found.notes() == ["a crouch is asked for (low); the hips are low in 0.0 % of the frames"]
    assert coverage.measure(database, [script(key | {"gait": "walk"})], seconds=2).notes() == []


def test_the_command_prints_writes_and_gives_json(database, tmp_path):
    database.save(tmp_path / "walker.mmdb")
    arguments = ["coverage", str(tmp_path / "walker.mmdb"), "--courses", "circle,strafe", "--seconds", "10"]
    shown = CliRunner().invoke(main, [*arguments, "-o", str(tmp_path / "out")])
    assert shown.exit_code == 0, shown.output
    assert "Asked, but not there" in shown.stdout and "strafe" in shown.stdout
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(coverage.FILES)
    assert (tmp_path / "out" / "coverage.png").read_bytes().startswith(b"\x89PNG")
    facts = json.loads(CliRunner().invoke(main, [*arguments, "--json"]).stdout)
    assert 0 <= facts["covered"] <= 1
    assert [row["course"] for row in facts["courses"]] == ["circle", "strafe", "all"]
    assert facts["within"] == {"speed": 0.25, "direction": 22.5, "turn": 30.0}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--courses", "nope"), "no course 'nope'"),
        (("--few", "0"), "not in the range"),
        (("--seconds", "0"), "give a number above 0"),
        (("-o", "{db}"), "cannot write: it is a file"),
    ],
)
def test_bad_input_is_one_clear_line(database, tmp_path, options, expected):
    path = tmp_path / "walker.mmdb"
    database.save(path)
    result = CliRunner().invoke(main, ["coverage", str(path), *(o.format(db=path) for o in options)])
    assert result.exit_code == 2
    assert expected in result.stderr and result.stderr.startswith("error: ")
