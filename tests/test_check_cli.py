"""``motion check``: what it prints and writes, its exit codes, and how it fails."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import synthetic

from motion import axes, bvh, cli, sources
from motion.check import check


@pytest.fixture
def run(capsys):
    """Run the command; returns exit code, standard output and standard error."""

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main(["check", *map(str, arguments)])
        out = capsys.readouterr()
        return stop.value.code, out.out, out.err

    return call


@pytest.fixture
def folder(tmp_path):
    """A folder with a clean clip, one whose body jumps at frame 200, and one at a wrong rate."""
    clip = synthetic.walk("clean", seconds=6.0)
    positions = clip.positions.copy()
    positions[200:, 0, 2] += 0.8
    source = tmp_path / "clips"
    (source / "b").mkdir(parents=True)
    bvh.write(source / "clean.bvh", clip, unit_to_m=0.01)
    bvh.write(source / "b" / "jump.bvh", clip.replace(positions=positions), unit_to_m=0.01)
    bvh.write(source / "slow.bvh", clip.replace(fps=15.0), unit_to_m=0.01)
    return source


def test_a_clean_clip_exits_with_0(run, folder):
    code, out, err = run(folder / "clean.bvh")
    assert (code, out) == (0, "") and "1 of 1 clips without findings" in err


def test_a_table_of_findings_exits_with_1(run, folder):
    code, out, err = run(folder)
    assert code == 1 and "clean.bvh" not in out
    jump, slow = (line for line in out.splitlines() if ".bvh" in line)
    assert "jump.bvh" in jump and "teleport" in jump and " 200 " in jump and "3.33-3.35" in jump
    assert "slow.bvh" in slow and " rate " in slow and " all " in slow
    assert "1 of 3 clips without findings; rate in 1, teleport in 1; 361 of 1,080 frames" in err or (
        "teleport in 1, rate in 1" in err
    )


def test_rules_about_clips_are_followed(run, folder, tmp_path):
    (folder / "clips.toml").write_text('[[clips]]\nfiles = "slow"\nfps = 60\n')
    code, out, err = run(folder)
    assert code == 1 and "jump.bvh" in out and "slow.bvh" not in out
    assert "clips.toml has rules for 1 of 3 clips" in err
    rules = '[[clips]]\nfiles = "slow"\nfps = 60\nup = "z"\n[[clips]]\nfiles = "jump"\nexclude = true\n'
    (folder / "clips.toml").write_text(rules)
    upright = sources.load(folder / "slow.bvh")
    bvh.write(folder / "slow.bvh", axes.convert(upright, up="z", forward="-y"), unit_to_m=0.01)
    code, out, err = run(folder, "--trim", "-o", tmp_path / "good")
    assert code == 0 and "2 of 2 clips without findings" in err
    written = sources.load(tmp_path / "good" / "slow_0.bvh", fps=60)
    as_it_was = sources.load(folder / "slow.bvh", fps=60)
    np.testing.assert_allclose(written.positions, as_it_was.positions, atol=1e-6)
    (folder / "clips.toml").write_text('[[clips]]\nfiles = "nobody"\nfps = 60\n')
    code, _, err = run(folder)
    assert code == 2 and "no clip is named like 'nobody'" in err


def test_json_lists_every_clip(run, folder):
    code, out, _ = run(folder, "--json")
    jump, clean, slow = json.loads(out)
    assert code == 1 and clean["findings"] == [] and clean["good"] == [[0, 360]]
    (found,) = jump["findings"]
    assert (found["kind"], found["start"], found["stop"], found["fatal"]) == ("teleport", 200, 201, True)
    assert jump["good"] == [[0, 200], [201, 360]] and jump["frames"] == 360 and jump["fps"] == 60
    assert slow["good"] == [] and slow["findings"][0]["kind"] == "rate"
    code, out, _ = run(folder / "slow.bvh", "--json", "--fps", 60)
    assert code == 0 and json.loads(out)[0]["fps"] == 60


def test_trim_writes_what_is_good_and_nothing_else(run, folder, tmp_path):
    out = tmp_path / "out"
    code, _, err = run(folder, "--trim", "-o", out)
    written = sorted(p.relative_to(out).as_posix() for p in out.rglob("*.*"))
    assert code == 0 and "wrote 3 files" in err
    assert written == ["b/jump_0.bvh", "b/jump_1.bvh", "clean_0.bvh"]
    whole, second = sources.load(folder / "b" / "jump.bvh"), sources.load(out / "b" / "jump_1.bvh")
    assert second.unit_to_m == whole.unit_to_m == 0.01 and second.fps == whole.fps
    np.testing.assert_allclose(second.positions, whole.positions[201:], atol=1e-6)
    assert all(check(sources.load(path)) == [] for path in out.rglob("*.bvh"))


def test_trim_writes_the_rate_given_and_leaves_short_spans_out(run, folder, tmp_path):
    code, _, _ = run(folder / "slow.bvh", "--trim", "-o", tmp_path / "a", "--fps", 60)
    assert code == 0 and sources.load(tmp_path / "a" / "slow_0.bvh").fps == 60
    run(folder / "b", "--trim", "-o", tmp_path / "b", "--minimum", 3)
    assert [p.name for p in (tmp_path / "b").iterdir()] == ["jump_0.bvh"]


def test_trim_keeps_the_axes_of_the_files(run, folder, tmp_path):
    with pytest.raises(SystemExit):
        cli.main(["convert", str(folder / "b"), str(tmp_path / "z"), "--up", "z"])
    axes = ("--source-up", "z")
    code, out, _ = run(tmp_path / "z", "--json", *axes)
    assert code == 1 and [f["kind"] for f in json.loads(out)[0]["findings"]] == ["teleport"]
    run(tmp_path / "z", "--trim", "-o", tmp_path / "t", *axes)
    whole, first = sources.load(tmp_path / "z" / "jump.bvh"), sources.load(tmp_path / "t" / "jump_0.bvh")
    np.testing.assert_allclose(first.positions, whole.positions[:200], atol=1e-6)


def test_a_picture_of_each_clip_with_findings(run, folder, tmp_path):
    run(folder, "--plot", tmp_path / "pictures")
    pictures = sorted((tmp_path / "pictures").rglob("*.png"))
    assert [p.name for p in pictures] == ["jump.png", "slow.png"]
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in pictures)


def test_a_file_that_cannot_be_read_is_reported_among_the_others(run, folder):
    (folder / "cut.bvh").write_text((folder / "clean.bvh").read_text()[:2000])
    code, out, err = run(folder)
    assert code == 1 and "unreadable" in out and "cut.bvh" in out and "1 cannot be read" in err
    code, out, _ = run(folder / "cut.bvh", "--json")
    assert code == 1 and "cut.bvh" in json.loads(out)[0]["unreadable"]


def test_wrong_usage(run, folder, tmp_path):
    for arguments, words in (
        ((folder, "--trim"), "--trim and -o"),
        ((folder, "-o", tmp_path / "x"), "--trim and -o"),
        ((tmp_path / "none",), "no such file or folder"),
        ((folder, "--trim", "-o", folder / "clean.bvh"), "not a folder"),
        ((folder, "--fps", 0), "out of range"),
        ((folder, "--exclude", "nobody*"), "no clip to exclude"),
    ):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "") and err.startswith("error: ") and words in err, arguments
        assert not (tmp_path / "x").exists()


def test_an_input_is_never_written_over(run, folder):
    shutil.copy(folder / "clean.bvh", folder / "clean_0.bvh")
    before = (folder / "clean_0.bvh").read_bytes()
    code, _, err = run(folder, "--trim", "-o", folder)
    assert code == 2 and "clean_0.bvh" in err
    assert (folder / "clean_0.bvh").read_bytes() == before


def test_clips_of_one_name_in_one_folder_are_told_apart(run, folder, tmp_path):
    shutil.copy(folder / "clean.bvh", folder / "b" / "clean.bvh")
    code, _, _ = run(folder / "clean.bvh", folder / "b" / "clean.bvh", "--trim", "-o", tmp_path / "o")
    names = sorted(p.name for p in (tmp_path / "o").rglob("*.bvh"))
    assert code == 0 and names == ["clean_0.bvh", "clean_bvh_0.bvh"]
