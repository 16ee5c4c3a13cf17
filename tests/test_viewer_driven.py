"""``python -m viewer`` with databases, models and runs: who is driven, what is exported, what is refused."""

from __future__ import annotations

from pathlib import Path

import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from mm.recording import Recording
from motion import gltf, kinematics, sources
from viewer.cli import main
from viewer.offscreen import DRAWABLE


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], prog_name="python -m viewer")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("driven")
    data = lmm_models.database()
    data.save(folder / "walk.mmdb")
    lmm_models.model(data).save(folder / "walk.lmm")
    return folder


def test_systems_are_filmed_side_by_side_and_exported(files: Path, tmp_path: Path) -> None:
    out, made = tmp_path / "two.png", tmp_path / "run.rec"
    args = (files / "walk.mmdb", files / "walk.lmm", "--course", "circle", "--from", "0.5", "--to", "0.6")
    result = run(*args, "--offscreen", out, "--size", "160x90", "--export", made)
    assert result.exit_code == 0, result.output
    with Image.open(out) as found:
        left, right = np.split(np.asarray(found), 2, axis=1)
    assert left.std() > 5 and right.std() > 5  # somebody is in both
    for name in ("mm", "lmm"):
        again = Recording.load(tmp_path / f"run-{name}.rec")
        assert len(again) == 7 and again.course is not None and again.course.name == "circle"


def test_a_run_becomes_a_strip_and_motion_again(files: Path, tmp_path: Path) -> None:
    run(files / "walk.mmdb", "--course", "circle", "--to", "0.5", "--export", tmp_path / "lap.rec")
    whole = Recording.load(tmp_path / "lap.rec")
    out = tmp_path / "lap.glb"
    result = run(tmp_path / "lap.rec", "--offscreen", tmp_path / "strip.png", "--filmstrip", 4, "--size",
                 "160x50", "--export", out, "--to", "0.25")  # fmt: skip
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "strip.png") as found:
        assert found.size == (160, 50)
    clip, skin = sources.load(out), gltf.skin(out)
    assert len(clip) == 16 and skin is not None
    world = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]
    mine = whole.clip(0)
    expected = kinematics.forward(mine.skeleton, mine.positions, mine.rotations)[0]
    np.testing.assert_allclose(world, expected[:16], atol=1e-4)
    # Each vertex of the body hangs near its joint.
    rest = -skin.bind[skin.joints[:, 0], :, 3]
    assert np.linalg.norm(skin.vertices - rest, axis=-1).max() < 0.6
    again = run(out, "--offscreen", tmp_path / "worn.png", "--size", "80x60")
    assert again.exit_code == 0, again.output


def test_a_database_beside_a_run_only_explains_it(files: Path, tmp_path: Path) -> None:
    run(files / "walk.mmdb", "--course", "circle", "--to", "0.5", "--export", tmp_path / "lap.rec")
    args = (tmp_path / "lap.rec", files / "walk.mmdb", "--show", "candidates,panel,costs", "--size", "320x90")
    result = run(*args, "--offscreen", tmp_path / "a.png", "--from", "0.4")
    assert result.exit_code == 0, result.output
    result = run(*args, "--systems", "mm", "--offscreen", tmp_path / "b.png", "--from", "0.4", "--ghost")
    assert result.exit_code == 0, result.output  # the run and who is driven: two


def test_all_that_can_be_drawn_is_told_of() -> None:
    said = run("--help").output
    assert all(f"\n    {name} " in said or f"\n  {name} " in said for name in DRAWABLE)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--systems", "pfnn"], "no system 'pfnn'; choose from mm, lmm"),
        (["--course", "nowhere"], "no course 'nowhere'"),
        (["--settings", "pfnn=a.toml"], "settings for 'pfnn', which is not driven; choose from mm, lmm"),
        (["--heights-spacing", "1"], "--heights-spacing is that of a heightmap"),
        (["--heights", "none.txt"], "none.txt: cannot read"),
    ],
)
def test_faults_are_one_line(options: list[str], said: str, files: Path, tmp_path: Path) -> None:
    out = ["--offscreen", tmp_path / "x.png"]
    result = run(files / "walk.mmdb", files / "walk.lmm", *options, *out)
    assert result.exit_code == 2 and said in result.output
    assert result.output.count("error:") == 1 and list(tmp_path.iterdir()) == []
