"""``python -m features terrain`` and ``heightmap``: what they print and write, and how they fail."""

from __future__ import annotations

import json

import numpy as np
import pytest
import synthetic

from features import terrain, terrain_made, terrain_picture
from features.cli import main
from motion import bvh


def run(capsys, *arguments) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main([*map(str, arguments)])
    return int(caught.value.code or 0), *capsys.readouterr()


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clips") / "walk.bvh"
    bvh.write(path, synthetic.walk("walk", turn=synthetic.weave))
    return path


def test_a_made_heightmap_is_what_the_seed_says(capsys, tmp_path):
    path = tmp_path / "map.txt"
    code, out, error = run(capsys, "heightmap", "--kind", "hills", "--seed", 5, "--size", 6, 4, "-o", path)
    assert (code, out) == (0, "") and "wrote 153 x 103 heights" in error
    made = terrain_made.make(5, "hills", size=(6, 4))
    np.testing.assert_allclose(terrain.load(path, level=0).heights, made.heights, atol=1e-5)


def test_a_walk_on_flat_ground_is_fitted_and_drawn(capsys, clip, tmp_path):
    path = tmp_path / "map.txt"
    run(capsys, "heightmap", "--size", 8, 8, "-o", path)
    arguments = ("terrain", clip, "--map", path, "--patches", 100, "--grounds", 3)
    code, out, _ = run(capsys, *arguments, "--plot", tmp_path / "pictures", "--json")
    (row,) = json.loads(out)
    assert code == 0 and row["seconds"] == 5 and row["stretches"] == 2
    assert row["contact_mm"] < 1 and row["contact_p95_mm"] < 10 and row["sunk_mm"] < 30
    assert (tmp_path / "pictures/walk.png").read_bytes().startswith(b"\x89PNG")
    table = run(capsys, *arguments)[1]
    assert "contact_p95_mm" in table and "walk.bvh" in table


def test_maps_are_made_where_none_is_given(capsys, clip):
    code, out, _ = run(capsys, "terrain", clip, "--patches", 50, "--grounds", 1, "--json")
    assert code == 0 and json.loads(out)[0]["contact_mm"] < 1


def test_faults_are_one_line(capsys, clip, tmp_path):
    hole = tmp_path / "hole.txt"
    hole.write_text("1 2 3\n4 nan 6\n")
    for arguments, message in (
        (("terrain", clip, "--map", hole), f"{hole}:2: 'nan' is no height"),
        (("terrain", clip, "--map", tmp_path / "none.txt"), "none.txt"),
        (("terrain", clip, "--patches", 10, "--grounds", 11), "ask for fewer"),
        (("terrain", tmp_path / "no.bvh"), "no.bvh"),
        (("heightmap", "--size", 1000, 1000, "-o", tmp_path / "big.txt"), "make it smaller"),
        (("heightmap", "--scale", "nan", "-o", tmp_path / "big.txt"), "--scale"),
    ):
        code, out, error = run(capsys, *arguments)
        assert (code, out) == (2, "")
        assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not (tmp_path / "big.txt").exists()


@pytest.mark.parametrize("command", ["terrain", "heightmap"])
def test_help_ends_with_an_example(capsys, command):
    last = run(capsys, command, "--help")[1].strip().split("\n\n")[-1]
    assert last.strip().startswith(f"Example: python -m features {command}")


def test_the_picture_shows_the_ground_where_it_is():
    """Axes are x, z and, upwards, y; contacts are where the feet are."""
    feet = np.array([[[0.0, 0.1, 0.0]], [[0.5, 0.2, 2.0]], [[1.0, 0.4, 3.0]]])
    figure = terrain_picture.figure(lambda x, z: 0.1 * x, feet, np.array([[1], [0], [1]]), title="up")
    axes = figure.axes[0]
    low, high = sorted(axes.get_xlim())
    assert (low, high) == pytest.approx((-0.5, 1.5)) and axes.get_ylim() == pytest.approx((-0.5, 3.5))
    assert axes.get_xlim()[0] > axes.get_xlim()[1]  # +X goes left for who looks along +Z
    dots = axes.collections[-1]._offsets3d
    np.testing.assert_allclose(np.stack([np.asarray(row) for row in dots]), [[0, 1], [0, 3], [0.1, 0.4]])
