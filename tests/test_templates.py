"""TOML to start from reads back as what it was written from."""

from __future__ import annotations

import tomllib
from dataclasses import fields

import pytest

from mm import courses
from mm.course import Course
from mm.settings import Settings
from motion import config, templates


@pytest.mark.parametrize("name", courses.names())
def test_a_course_is_read_back(name):
    course = courses.load(name).scaled(walk=1.4, run=3.3)
    text = templates.compact(course)
    assert config.from_dict(Course, tomllib.loads(text)) == course


def test_a_waypoint_is_a_line_and_defaults_are_left_out():
    lines = templates.compact(courses.load("thesis")).splitlines()
    assert '    { position = [-25.0, -25.0], speed = 10.5, gait = "run" },' in lines
    assert "closed = true" in lines
    assert not any(line.startswith(("smooth", "stick", "laps")) for line in lines)


def test_odd_text_and_keys_are_quoted():
    course = Course(
        description='a "b" \\ c\nd',
        seconds=1.0,
        velocity=({"time": 0, "velocity": (0, 1)},),
        scale={"a b": 2.0},
    )
    assert config.from_dict(Course, tomllib.loads(templates.compact(course))) == course


def test_settings_stand_under_what_they_mean():
    text = templates.explained(Settings())
    assert config.from_dict(Settings, tomllib.loads(text)) == Settings()
    lines = text.splitlines()
    assert lines[lines.index("search_interval = 0.1") - 1] == "# time between searches."
    # Two that share an explanation stand below it together; None, which TOML has not, is a comment.
    assert lines[lines.index("maximal_distance = 0.15") + 1].startswith("maximal_angle = 1.57")
    assert "# foot_height = (not set)" in lines
    for field in fields(Settings):
        at = next(i for i, line in enumerate(lines) if line.removeprefix("# ").startswith(f"{field.name} ="))
        assert lines[at - 1], f"{field.name} is not explained"
    assert max(map(len, lines)) <= templates.WIDTH
