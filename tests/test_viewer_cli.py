from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from viewer.cli import main


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], prog_name="python -m viewer")


def size_of(path: Path) -> tuple[int, int]:
    with Image.open(path) as found:
        return found.size


def test_a_clip_becomes_a_picture(walker_files: Path, tmp_path: Path) -> None:
    out = tmp_path / "walk.png"
    result = run(walker_files / "straight.bvh", "--offscreen", out, "--size", "80x60", "--from", "1")
    assert result.exit_code == 0, result.output
    assert size_of(out) == (80, 60)
    assert f"wrote 1 picture to {out}" in result.output


def test_several_become_a_film(walker_files: Path, tmp_path: Path) -> None:
    files = [walker_files / f"{name}.bvh" for name in ("straight", "run")]
    result = run(*files, "--offscreen", tmp_path / "f.gif", "--size", "80x60", "--to", "0.4", "--dark")
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "f.gif") as found:
        assert found.n_frames == 11  # 0.4 s at 25 a second, both ends
        assert np.asarray(found.convert("RGB")).mean() < 80


def test_poses_become_a_strip(walker_files: Path, tmp_path: Path) -> None:
    out = tmp_path / "strip.png"
    result = run(walker_files / "run.bvh", "--offscreen", out, "--filmstrip", 4, "--size", "160x50")
    assert result.exit_code == 0, result.output
    assert size_of(out) == (160, 50)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--offscreen", "x.avi"], "x.avi: no picture or film is named so; name it *.png, *.gif, *.mp4"),
        (["--offscreen", "x.gif", "--filmstrip", "3"], "x.gif: a film strip is one picture; name it *.png"),
        (["--offscreen", "x.png", "--size", "big"], "'big' is no size; give pixels as 1280x720"),
        (["--offscreen", "x.png", "--from", "99"], "nothing from 99 to 4.98333 s; the longest lasts 4.98 s"),
        (["--offscreen", "x.gif", "--from", "2", "--to", "1"], "--to 1 is before --from 2"),
        (["--offscreen", "x.gif", "--from", "1", "--to", "1"], "nothing from 1 to 1 s; the longest"),
        (
            ["--offscreen", "x.png", "--show", "bones"],
            "nothing is called 'bones' that could be shown; choose",
        ),
        (["--offscreen", "x.png", "--show", "none,match"], "--show names things to draw, and none; leave"),
        (
            ["--offscreen", "x.png", "--filmstrip", "60", "--size", "100x90"],
            "--size 100 is too narrow for 60 poses; give it 480 pixels or fewer poses",
        ),
        (["--offscreen", "x.png", "--ghost"], "a ghost needs two characters, here is one; choose two"),
        (["--offscreen", "x.png", "--course", "thesis"], "nobody is driven over a course; give a database"),
        (["--fps", "30"], "--fps is nothing for a window; leave it out, or draw without one"),
        (["--apart"], "--apart is nothing for a window"),
        (["--export", "x.fbx"], "x.fbx: motion is not exported so; name it *.bvh, *.glb, *.rec"),
        (["--export", "x.rec"], "straight is a clip, of which there is no run; export it as .bvh or .glb"),
    ],
)
def test_faults_are_one_line(
    options: list[str], said: str, walker_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(walker_files / "straight.bvh", *options)
    assert list(tmp_path.iterdir()) == []
    assert result.exit_code == 2
    assert said in result.output
    assert result.output.count("error:") == 1 and result.output.strip().count("\n") == 0


def test_a_clip_is_not_written_over(walker_files: Path, tmp_path: Path) -> None:
    picture = tmp_path / "clip.png"
    picture.write_bytes(b"kept")
    result = run(picture, "--offscreen", picture)
    assert result.exit_code == 2 and "would be written over" in result.output
    assert picture.read_bytes() == b"kept"
