"""``mm run`` and ``mm courses`` from the outside, on a small synthetic database."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from mm.build import build
from mm.cli import main
from mm.course import load, names
from mm.database import Database
from mm.recording import Recording
from mm.run import fitted
from motion import bvh
from motion.errors import UserError


@pytest.fixture(scope="module")
def db(walker_files, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "walker.mmdb"
    build([walker_files], jobs=1).save(path)
    return path


def mm(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_a_run_writes_a_motion_a_recording_and_a_summary(db, tmp_path):
    out, tape = tmp_path / "out.bvh", tmp_path / "run.rec"
    course = ("--course", "circle", "--seconds", 8)
    facts = json.loads(mm("run", db, *course, "-o", out, "--record", tape, "--json").stdout)
    recording, clip = Recording.load(tape), bvh.read(out)
    assert facts["frames"] == len(recording) == len(clip) == 480 and facts["seconds"] == pytest.approx(8)
    assert clip.skeleton.names == recording.skeleton.names
    # What stands in the file is what was recorded, to the digits printed.
    np.testing.assert_allclose(clip.positions[:, 0], recording["positions"][:, 0, 0], atol=2e-5)
    # A walker that has a left turn follows a circle to the left, at the data's own walking speed.
    assert facts["path_error_cm"] < 25
    assert facts["asked_speed_mps"] == pytest.approx(1.2, rel=0.05)
    assert facts["speed_mps"] == pytest.approx(facts["asked_speed_mps"], rel=0.2)
    assert facts["transitions_per_s"] == pytest.approx(recording["transition"].mean() * 60)
    assert facts["searches_per_s"] >= facts["transitions_per_s"] > 0
    assert "walk x 0.686" in facts["description"]
    assert recording.database == Database.load(db).fingerprint and recording.schema is not None


def test_a_run_is_the_same_every_time(db, tmp_path):
    outs = [tmp_path / "a.bvh", tmp_path / "b.bvh"]
    for out in outs:
        mm("run", db, "--course", "random", "--seconds", 3, "-o", out)
    assert outs[0].read_bytes() == outs[1].read_bytes()


def test_the_table_names_what_was_written(db, tmp_path):
    out = tmp_path / "out.bvh"
    text = mm("run", db, "--course", "still", "--seconds", 1, "-o", out).stdout
    assert "out.bvh" in text and "us_per_frame" in text and "path_error" not in text


def test_options_reach_the_controller(db, tmp_path):
    settings = tmp_path / "settings.toml"
    settings.write_text("search_interval = 0.5\n")
    tape = tmp_path / "run.rec"
    mm(
        *("run", db, "--course", "circle", "--seconds", 2, "--record", tape, "--count", 3, "--spread"),
        *("--index", "brute", "--settings", settings, "--no-foot-lock", "--walk", 0.9),
    )
    recording = Recording.load(tape)
    assert recording.count == 3 and "brute" in recording.system
    assert recording.settings["search_interval"] == 0.5 and recording.settings["foot_lock"] is False
    assert not recording["locked"].any()
    assert np.linalg.norm(recording["command_velocity"][60], axis=-1) == pytest.approx(0.9)
    starts = recording["positions"][0, :, 0]
    assert np.linalg.norm(starts[0] - starts[1]) > 1


def test_a_crowd_without_a_recording_keeps_a_few(db):
    facts = json.loads(mm("run", db, "--course", "still", "--seconds", 0.2, "--count", 40, "--json").stdout)
    assert facts["characters"] == 40


def test_courses_are_fitted_to_the_data_unless_as_written(db):
    database, course = Database.load(db), load("thesis")
    assert fitted(course, database, as_written=True) is course
    scaled = fitted(course, database, running=2.5)
    assert scaled.waypoints[0].speed == pytest.approx(1.2, rel=0.05)
    assert scaled.waypoints[2].speed == pytest.approx(2.5)
    with pytest.raises(UserError, match="as written and scaled"):
        fitted(course, database, walk=1.0, as_written=True)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("--course", "cirle"), "no course 'cirle'"),
        (("--course", "circle", "--index", "magic"), "magic"),
        (("--course", "circle", "--character", "1"), "no character 1"),
        (("--course", "circle", "--settings", "none.toml"), "none.toml"),
        (("--course", "circle", "-o", "."), "it is a folder"),
        (("--course", "circle", "--seconds", "0"), "seconds"),
        ((), "--course"),
    ],
)
def test_faults_are_one_line(db, arguments, message):
    result = mm("run", db, *arguments, code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and message in result.stderr


def test_a_settings_file_with_an_unknown_key(db, tmp_path):
    settings = tmp_path / "settings.toml"
    settings.write_text("foot_lock = true\nfoot_loc = true\n")
    result = mm("run", db, "--course", "circle", "--settings", settings, code=2)
    assert f"{settings}:2: foot_loc: unknown key" in result.stderr and "foot_lock" in result.stderr


def test_courses_are_listed():
    rows = json.loads(mm("courses", "--json").stdout)
    assert [row["name"] for row in rows] == names()
    assert all(row["seconds"] > 0 and row["description"] for row in rows)
    assert "figure-of-eight" in mm("courses").stdout


def test_a_course_is_described_and_drawn(tmp_path):
    picture = tmp_path / "thesis.png"
    arguments = ("courses", "thesis", "--walk", 1.4, "--run", 3.5, "--plot", picture, "--json")
    facts = json.loads(mm(*arguments).stdout)
    # Half of the table's 283.6 m.
    assert facts["metres"] == pytest.approx(141.8, abs=0.1)
    assert facts["course"]["waypoints"][2]["speed"] == pytest.approx(3.5)
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


def test_drawing_needs_a_course(tmp_path):
    assert "no course to draw" in mm("courses", "--plot", tmp_path / "x.png", code=2).stderr


def test_captured_walks_take_a_lap_of_the_thesis_course(data, tmp_path):
    db = tmp_path / "cmu16.mmdb"
    build([data / "cmu" / "asfamc" / "16"]).save(db)
    facts = json.loads(mm("run", db, "--course", "thesis", "--json").stdout)
    # A lap of a minute or two at the data's speeds, kept to within a hand's breadth on the mean.
    assert 60 < facts["seconds"] < 150
    assert facts["path_error_cm"] < 10
    assert facts["speed_mps"] == pytest.approx(facts["asked_speed_mps"], rel=0.1)
    assert facts["transitions_per_s"] < facts["searches_per_s"] / 2


def test_obstacles_are_kept_clear_of(db, tmp_path):
    tape = tmp_path / "run.rec"
    mm("run", db, "--course", "obstacles", "--record", tape)
    recording = Recording.load(tape)
    x, z, half_x, half_z, radius = recording.course.obstacles().T
    away = np.abs(recording["simulation_position"] - np.stack([x, z], axis=-1))
    outside = np.maximum(away - np.stack([half_x, half_z], axis=-1), 0)
    # The simulated object keeps its body radius of 0.3 m, and comes out at the other end.
    assert (np.linalg.norm(outside, axis=-1) - radius).min() > 0.29
    assert recording.roots()[0][-1, 0, 1] > 22
