"""``bench courses``: a few systems on each course, and pictures of the courses."""

from __future__ import annotations

import json

import linear_models
import pytest
from click.testing import CliRunner

from bench import comparison as comparing
from bench import driven, report
from bench.cli import main
from lmm.model import Model
from mm import courses as library
from mm.course import Course, VelocityKey
from mm.database import Database
from motion import config


@pytest.fixture(scope="module")
def folder(walker_database, tmp_path_factory):
    folder, database = tmp_path_factory.mktemp("courses"), walker_database
    database.save(folder / "walker.mmdb")
    linear_models.fitted(database).save(folder / "walker.lmm")
    config.dump(Course(velocity=(VelocityKey(time=0, velocity=(0, 1)),), seconds=1), folder / "ahead.toml")
    (folder / "user.csv").write_text("time,move_x,move_z\n0,0,1\n0.5,1,0\n")
    return folder


COURSES = ("--courses", "ahead.toml,user.csv", "--seconds", "1")


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, ["courses", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_a_row_a_course_and_system_that_is_compare_s(folder):
    shown = bench(folder / "walker.mmdb", *COURSES, "--systems", "mm-brute,mm-exact", "--json").stdout
    rows = json.loads(shown)["courses"]
    assert {(row["system"], row["course"]) for row in rows} == {
        (system, course) for system in ("mm-brute", "mm-exact") for course in ("ahead", "user")
    }
    database, ahead = Database.load(folder / "walker.mmdb"), library.load(folder / "ahead.toml")
    theirs = comparing.compare(database, courses=[ahead], systems=["mm-exact"], seconds=1).courses.iloc[0]
    ours = next(row for row in rows if row["system"] == "mm-exact" and row["course"] == "ahead")
    for name in ("skate_cm_s", "heading_deg", "speed_mps"):
        assert ours[name] == pytest.approx(theirs[name])


def test_the_table_goes_by_course_and_each_has_a_picture(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "save", lambda *_, **__: [])  # as `bench compare` has it, tested there
    asked = ("--systems", "mm-brute,mm-exact", "-o", tmp_path / "out")
    (tmp_path / "out").mkdir()
    shown = bench(folder / "walker.mmdb", *COURSES, *asked).stdout
    lines = [line.split() for line in shown.splitlines() if line.startswith("mm-")]
    assert [(line[0], line[2]) for line in lines] == [
        (system, course) for course in ("ahead", "user") for system in ("mm-brute", "mm-exact")
    ]
    for name in ("ahead.png", "user.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")


def test_models_that_take_no_database_come_along(folder):
    model = Model.load(folder / "walker.lmm")
    chosen = driven.standard(Database.load(folder / "walker.mmdb"), {"lmm": model})
    assert [entry.name for entry in chosen] == ["mm-exact", "lmm-PSD"]


def test_all_ready_made_courses_by_default(folder, monkeypatch):
    class Asked(Exception):
        pass

    def compare(database, **asked):
        assert [course.name for course in asked["courses"]] == library.names()
        assert asked["systems"] == ("mm-exact",) and asked["scale"] is False
        raise Asked

    monkeypatch.setattr(comparing, "compare", compare)
    with pytest.raises(Asked):
        CliRunner().invoke(
            main, ["courses", str(folder / "walker.mmdb"), "--no-scale"], catch_exceptions=False
        )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--courses", "cicle"), "no course 'cicle'"),
        (("--systems", "lmm"), "without a model"),
        (("-o", "walker.mmdb"), "it is a file"),
    ],
)
def test_bad_input(arguments, message):
    stderr = bench("walker.mmdb", *arguments, code=2).stderr
    assert message in stderr, stderr
