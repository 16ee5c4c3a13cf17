"""``python -m motion``: what it prints and writes, and how it fails."""

import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from motion import axes, bvh, cli, dancecard, kinematics, quat, sources

EXAMPLES = ["info", "roles", "convert"]


@pytest.fixture
def run(capsys):
    """Run a command; returns exit code, standard output and standard error."""

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main([str(a) for a in arguments])
        out = capsys.readouterr()
        return stop.value.code, out.out, out.err

    return call


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def test_info_table_and_json(run, walker_files):
    code, out, _ = run("info", walker_files)
    assert code == 0 and "net_turn_deg" in out and "straight.bvh" in out
    code, out, _ = run("info", walker_files / "straight.bvh", "--json")
    (row,) = json.loads(out)
    assert code == 0
    assert list(row)[:4] == ["file", "frames", "fps", "seconds"]
    assert row["frames"] == 300 and row["fps"] == 60 and row["joints"] == 22 and row["unit_to_m"] == 1
    assert row["mean_speed_mps"] == pytest.approx(1.2, rel=0.01) and row["forward_share"] > 0.99


def test_info_says_a_common_folder_once_on_a_terminal(monkeypatch):
    rows = [{"file": "clips/cmu/a/1.bvh", "frames": 1}, {"file": "clips/cmu/2.bvh", "frames": 2}]
    assert cli._short_paths(rows) == (rows, None)  # rows of a pipe stand for themselves
    monkeypatch.setattr(sys, "stdout", types.SimpleNamespace(isatty=lambda: True))
    short, title = cli._short_paths(rows)
    assert title == f"in {Path('clips/cmu')}"
    assert short == [{"file": str(Path("a/1.bvh")), "frames": 1}, {"file": "2.bvh", "frames": 2}]
    mixed = [*rows, {"file": "/elsewhere/3.bvh", "frames": 3}]
    assert cli._short_paths(mixed) == (mixed, None)


@pytest.mark.parametrize("option", ["--fps", "--source-fps"])
def test_info_with_a_stated_rate_and_unit(run, walker_files, option):
    _, out, _ = run("info", walker_files / "straight.bvh", "--json", option, 30, "--source-unit", "cm")
    (row,) = json.loads(out)
    assert row["fps"] == 30 and row["unit_to_m"] == 0.01
    assert row["mean_speed_mps"] == pytest.approx(0.006, rel=0.01)


def test_roles_and_their_overrides(run, walker_files, tmp_path):
    file = walker_files / "straight.bvh"
    code, out, _ = run("roles", file)
    assert code == 0 and "LeftToe" in out
    overrides = tmp_path / "roles.toml"
    overrides.write_text('[roles]\nleft_toe = "LeftFoot"\nhead = ""\n')
    _, out, _ = run("roles", file, "--json", "--roles", overrides)
    found = json.loads(out)
    assert found["roles"]["left_toe"] == "LeftFoot"
    assert set(found["absent"]) == {"root", "head"} and "Head" in found["other_joints"]


def test_convert_keeps_the_motion(run, walker_files, tmp_path):
    source, target = walker_files / "left_turn.bvh", tmp_path / "out" / "copy.bvh"
    code, out, _ = run("convert", source, target, "--unit", "cm")
    assert code == 0 and out == ""
    copy = sources.load(target)
    assert copy.unit_to_m == 0.01
    np.testing.assert_allclose(world(copy), world(sources.load(source)), atol=1e-5)
    assert list(target.parent.iterdir()) == [target]


def test_convert_a_folder_with_every_change(run, walker_files, tmp_path):
    options = [
        "--fps",
        30,
        "--mirror",
        "--ground",
        "--start",
        1,
        "--stop",
        3,
        "--joints",
        "Hips,Spine2,LeftUpLeg,RightUpLeg",
    ]
    code, _, _ = run("convert", walker_files, tmp_path / "out", *options)
    assert code == 0
    names = sorted(path.name for path in walker_files.iterdir())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    clip = sources.load(tmp_path / "out" / "left_turn.bvh")
    assert clip.fps == 30 and len(clip) == 60
    assert clip.skeleton.names == ("root", "Hips", "LeftUpLeg", "RightUpLeg", "Spine2")
    original = world(sources.load(walker_files / "left_turn.bvh"))[60:180:2]
    np.testing.assert_allclose(world(clip)[:, 1], original[:, 0] * [-1, 1, 1], atol=1e-5)
    np.testing.assert_allclose(world(clip)[:, 2], original[:, 5] * [-1, 1, 1], atol=1e-5)


@pytest.mark.parametrize("options", [("--up", "z"), ("--up", "z", "--forward", "x", "--handedness", "left")])
def test_other_axes_out_and_in(run, walker_files, tmp_path, options):
    source = walker_files / "right_turn.bvh"
    run("convert", source, tmp_path / "z.bvh", *options)
    there = sources.load(tmp_path / "z.bvh")
    np.testing.assert_allclose(world(there)[..., 2], world(sources.load(source))[..., 1], atol=1e-5)
    back = [f"--source-{option[2:]}" if option.startswith("--") else option for option in options]
    run("convert", tmp_path / "z.bvh", tmp_path / "y.bvh", *back)
    np.testing.assert_allclose(
        world(sources.load(tmp_path / "y.bvh")), world(sources.load(source)), atol=1e-5
    )
    _, out, _ = run("info", tmp_path / "z.bvh", "--json", *back)
    assert json.loads(out)[0]["net_turn_deg"] < -180


def test_asf_amc_to_bvh(run, data, tmp_path):
    source = data / "cmu/asfamc/02/02_01.amc"
    code, _, _ = run("convert", source, "-o", tmp_path)
    assert code == 0
    original, copy = sources.load(source), sources.load(tmp_path / "02_01.bvh")
    np.testing.assert_allclose(world(copy), world(original), atol=1e-5)
    assert copy.unit_to_m == pytest.approx(original.unit_to_m)


def test_a_rest_pose_before_the_capture_is_left_out_unless_asked_for(run, data, tmp_path):
    source = data / "cmu/daz_bvh/02/02_01.bvh"
    run("convert", source, tmp_path / "cut.bvh")
    run("convert", source, tmp_path / "whole.bvh", "--keep-lead-in")
    assert len(sources.load(tmp_path / "whole.bvh")) == 344
    assert 326 <= len(sources.load(tmp_path / "cut.bvh")) < 344


def test_fit_takes_the_bones_of_another_file(run, data, tmp_path):
    folder = data / "cmu/asfamc"
    code, _, _ = run("convert", folder / "02/02_01.amc", tmp_path / "a.bvh", "--fit", folder / "16/16_11.amc")
    assert code == 0
    fitted, other = sources.load(tmp_path / "a.bvh").skeleton, sources.load(folder / "16/16_11.amc").skeleton
    np.testing.assert_allclose(fitted.offsets[1:], other.offsets[1:], atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("info",), "Missing argument"),
        (("info", "{no}"), "no such file or folder"),
        (("info", "{empty}"), "no clips in this folder"),
        (("info", "{in}", "--fps", "0"), "0"),
        (("info", "{broken}"), "broken.bvh"),
        (("roles", "{in}", "--roles", "{no}"), "cannot read"),
        (("convert", "{in}"), "give one place to write to"),
        (("convert", "{in}", "{out}/x.bvh", "-o", "{out}/y.bvh"), "give one place to write to"),
        (("convert", "{in}", "{out}/x.amc"), "cannot write .amc files"),
        (("convert", "{in}", "{in}"), "would write over its source"),
        (("convert", "{folder}", "{folder}"), "would write over its source"),
        (("convert", "{folder}", "{out}/x.bvh"), "not a folder"),
        (("convert", "{in}", "{out}/x.bvh", "--up", "z", "--forward", "-z"), "lie along one axis"),
        (("convert", "{in}", "{out}/x.bvh", "--unit", "parsec"), "no unit"),
        (("convert", "{in}", "{out}/x.bvh", "--unit", "1e-300"), "no unit"),
        (("convert", "{in}", "{out}/x.bvh", "--fit", "{folder}"), "name one motion file"),
        (("convert", "{in}", "{out}/x.bvh", "--joints", " , "), "names no joint"),
        (("convert", "{in}", "{out}/x.bvh", "--start", "9"), "it has 300 frames"),
        (("convert", "{in}", "{out}/x.bvh", "--joints", "Hips,Paw"), "straight.bvh: no joint 'Paw'"),
    ],
)
def test_faults_are_one_line_and_leave_nothing(run, walker_files, tmp_path, arguments, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.bvh").write_bytes((walker_files / "straight.bvh").read_bytes()[:3000])
    places = {
        "{in}": walker_files / "straight.bvh",
        "{folder}": walker_files,
        "{no}": tmp_path / "none",
        "{empty}": tmp_path / "empty",
        "{broken}": tmp_path / "broken.bvh",
    }
    given = [places.get(a, a.replace("{out}", str(tmp_path / "out"))) for a in arguments]
    code, out, err = run(*given)
    assert code == 2 and out == ""
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert not (tmp_path / "out").exists()


def test_two_files_are_not_written_into_one(run, data, tmp_path):
    for name in ("02_01.bvh", "02_01.amc"):
        (tmp_path / "in").mkdir(exist_ok=True)
        folder = "daz_bvh/02" if name.endswith("bvh") else "asfamc/02"
        (tmp_path / "in" / name).symlink_to(data / "cmu" / folder / name)
    code, _, err = run("convert", tmp_path / "in", tmp_path / "out")
    assert code == 2 and "as would" in err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", EXAMPLES)
def test_every_command_has_help_with_an_example(run, command):
    code, out, _ = run(command, "--help")
    assert code == 0 and f"Example: python -m motion {command}" in out


def test_rules_about_clips_are_followed_by_every_command_that_reads(run, tmp_path, walker):
    folder = tmp_path / "clips"
    (folder / "old").mkdir(parents=True)
    turned = axes.convert(walker, up="z", forward="-y")
    bvh.write(folder / "old" / "walk.bvh", turned, unit_to_m=0.0254)
    (folder / "clips.toml").write_text('[[clips]]\nfiles = "old/*"\nunit = "inch"\nup = "z"\nfps = 30\n')
    told = json.loads(run("info", folder, "--json")[1])[0]
    assert told["fps"] == 30 and told["hip_height_m"] == pytest.approx(0.87, abs=0.05)
    run("convert", folder, "-o", tmp_path / "out", "--unit", "m")
    clip = sources.load(tmp_path / "out" / "old" / "walk.bvh")
    np.testing.assert_allclose(clip.positions[:, 0], walker.positions[:, 0], atol=1e-5)
    run("retarget", folder, "--to", tmp_path / "out" / "old" / "walk.bvh", "-o", tmp_path / "r")
    moved = sources.load(tmp_path / "r" / "old" / "walk.bvh")
    np.testing.assert_allclose(moved.positions[:, 0], walker.positions[:, 0], atol=0.03)


def test_convert_says_that_it_leaves_out_a_rest_pose(run, tmp_path):
    clip = dancecard.generate(3)[0].clip
    rotations = np.concatenate([quat.identity(1, len(clip.skeleton)), clip.rotations])
    positions = np.concatenate([clip.positions[:1], clip.positions])
    bvh.write(tmp_path / "t.bvh", clip.replace(rotations=rotations, positions=positions))
    done = run("convert", tmp_path / "t.bvh", "-o", tmp_path / "out.bvh")
    kept = run("convert", tmp_path / "t.bvh", "-o", tmp_path / "all.bvh", "--keep-lead-in")
    frames = [len(sources.load(tmp_path / f"{name}.bvh")) for name in ("out", "all")]
    assert frames == [len(clip), len(clip) + 1]
    assert "1 of 1 files begin with a rest pose" in done[2] and "rest pose" not in kept[2]
