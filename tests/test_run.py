"""``mm run`` and ``mm courses`` from the outside, on a small synthetic database."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from mm.build import build
from mm.cli import main
from mm.courses import load, names
from mm.database import Database
from mm.description import Description
from mm.recording import Recording
from mm.runs import fitted, summarise
from mm.settings import Settings
from motion import bvh, config
from motion.errors import UserError
from motion.skeleton import Skeleton


@pytest.fixture(scope="module")
def db(walker_mmdb):
    return walker_mmdb


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
    assert "out.bvh" in text and "us_per_character" in text and "path_error" not in text


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


def test_times_are_per_character_without_the_first_second():
    recording = Recording(
        system="point",
        skeleton=Skeleton(("root",), np.array([-1]), np.zeros((1, 3)), {"root": 0}),
        fps=2.0,
        arrays={
            "positions": np.zeros((5, 2, 1, 3), np.float32),
            "rotations": np.tile(np.float32([1, 0, 0, 0]), (5, 2, 1, 1)),
            "command_velocity": np.zeros((5, 2, 2), np.float32),
        },
        step_seconds=np.array([9.0, 9.0, 2e-6, 4e-6, 18e-6]),
    )
    facts = summarise(recording)
    assert next(name for name in facts if name.startswith("us_")) == "us_per_character"
    assert facts["us_per_character"] == pytest.approx(2) and facts["us_per_character_mean"] == pytest.approx(
        4
    )
    assert facts["course"] is None and facts["characters"] == 2
    # A recording of the first two of eight.
    assert summarise(recording, 8)["us_per_character"] == pytest.approx(0.5)
    assert summarise(recording, 8)["characters"] == 8


@pytest.fixture(scope="module")
def tagged(walker_files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tagged")
    (folder / "tags.csv").write_text("tag,clips\nrunning,run\nturn,*_turn\nmoving,run\nmoving,*t*\n")
    build([walker_files], jobs=1, tags=folder / "tags.csv").save(folder / "walker.mmdb")
    return folder / "walker.mmdb"


def test_only_frames_with_the_tags_asked_for_play(tagged, tmp_path):
    tape, database = tmp_path / "run.rec", Database.load(tagged)
    course = ("--course", "circle", "--seconds", 4, "--record", tape)

    def played():
        frames = Recording.load(tape)["frame"]
        return database.tags[frames[60:]]  # the first search may come after a moment

    mm("run", tagged, *course)
    turn, running = database.tag_mask(["turn"]), database.tag_mask(["running"])
    assert (played() & turn).any()  # which is what it would like best
    mm("run", tagged, *course, "--forbid-tag", "turn", "--forbid-tag", "running")
    assert not (played() & (turn | running)).any()
    mm("run", tagged, *course, "--require-tag", "moving", "--require-tag", "running")
    assert (played() & running).all()


@pytest.mark.parametrize(
    "options, message",
    [
        (("--require-tag", "flying"), "no tag 'flying'; the database's tags are running, turn, moving"),
        (("--require-tag", "running", "--forbid-tag", "moving"), "no frame with running and without moving"),
    ],
)
def test_tags_that_no_frame_has(tagged, options, message):
    assert message in mm("run", tagged, "--course", "circle", *options, code=2).stderr


def test_courses_are_fitted_to_the_data_unless_as_written(db):
    description, course = Description.of(Database.load(db)), load("thesis")
    assert fitted(course, description, as_written=True) is course
    scaled = fitted(course, description, running=2.5)
    assert scaled.waypoints[0].speed == pytest.approx(1.2, rel=0.05)
    assert scaled.waypoints[2].speed == pytest.approx(2.5)
    with pytest.raises(UserError, match="as written and scaled"):
        fitted(course, description, walk=1.0, as_written=True)


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


def test_a_course_is_written_to_start_from(tmp_path):
    mine = tmp_path / "mine.toml"
    mm("courses", "thesis", "--walk", 1.4, "--run", 3.5, "-o", mine)
    written = load(mine)
    assert replace(written, name="thesis") == load("thesis").scaled(walk=1.4, run=3.5)
    assert written.name == "mine"
    assert "no course to write" in mm("courses", "-o", mine, code=2).stderr


def test_the_course_in_the_help_is_one(tmp_path):
    lines = mm("run", "--help").stdout.splitlines()
    start = next(i for i, line in enumerate(lines) if "A course file" in line)
    (tmp_path / "help.toml").write_text("\n".join(lines[start + 1 : start + 4]))
    assert [w.gait for w in load(tmp_path / "help.toml").waypoints] == ["walk", "run"]


def test_settings_are_printed_and_written(tmp_path):
    mine = tmp_path / "mine.toml"
    mm("settings", "-o", mine)
    assert config.load(Settings, mine) == Settings()
    assert mm("settings").stdout == mine.read_text()


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
