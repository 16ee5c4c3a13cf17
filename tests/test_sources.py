"""Every real clip loads as its manifest says; files are found; what is no motion is refused."""

from __future__ import annotations

import csv
import os
import shutil

import numpy as np
import pytest

from motion import bvh, sources, units
from motion.errors import UserError


@pytest.fixture(scope="module")
def manifest(data):
    with open(data / "manifest.csv", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_clip_of_the_manifest(data, manifest):
    wrong = []
    for row in manifest:
        clip = sources.load(data / row["file"])
        # Those files announce a wrong frame time of 0.0667; the manifest prints 1 / 0.016667 as 59.999.
        fps = 15 if "labelled_60fps" in row["file"] else float(row["fps"])
        agrees = (
            len(clip) == int(row["frames"])
            and abs(clip.fps / fps - 1) < 1e-4
            and len(clip.skeleton) == int(row["joints"])
            and abs(clip.unit_to_m / float(row["unit_to_m"]) - 1) < 1e-5
            and np.isfinite(clip.positions).all()
            and np.allclose(np.linalg.norm(clip.rotations, axis=-1), 1)
            and (np.sum(clip.rotations[1:] * clip.rotations[:-1], axis=-1) >= 0).all()
            and {"hips", "left_foot", "right_foot", "head"} <= set(clip.skeleton.roles)
        )
        if not agrees:
            wrong.append((row["file"], len(clip), clip.fps, len(clip.skeleton), clip.unit_to_m))
    assert wrong == []
    assert len(manifest) == 498


def test_stale_offsets_do_not_move_the_hips(data):
    """Bandai's hips: position channels replace an OFFSET that is metres away."""
    path = data / "bandai/dataset-1/dataset-1_dash_active_001.bvh"
    clip, document = sources.load(path), bvh.parse(path)
    hips = clip.skeleton.role("hips")
    assert document.names[hips] == "Hips"
    np.testing.assert_allclose(clip.positions[:, hips], document.values[:, 6:9] * 0.01)
    assert np.abs(document.offsets[hips] - document.values[0, 6:9]).max() > 100
    assert np.median(clip.positions[:, hips, 1]) == pytest.approx(0.85, abs=0.15)


def test_rate_unit_and_roles_can_be_given(walker, tmp_path):
    path = tmp_path / "walk.BVH"
    bvh.write(path, walker, unit_to_m=0.01)
    clip = sources.load(path)
    assert clip.unit_to_m == 0.01 and clip.fps == 60 and clip.name == "walk" and clip.source == path
    hips = clip.skeleton.role("hips")
    np.testing.assert_allclose(clip.positions[:, hips], walker.positions[:, 0], atol=1e-7)
    given = sources.load(path, fps=30, unit_to_m=0.02, roles={"hips": 3})
    assert given.fps == 30 and given.unit_to_m == 0.02 and given.skeleton.roles == {"hips": 3}
    np.testing.assert_allclose(given.positions, clip.positions * 2)
    for wrong in ({"fps": 0}, {"fps": float("nan")}, {"unit_to_m": -1}):
        with pytest.raises(UserError, match="give a positive number"):
            sources.load(path, **wrong)


@pytest.mark.parametrize("unit", units.UNITS.values(), ids=units.UNITS)
def test_a_file_in_any_unit_comes_in_metres(walker, tmp_path, unit):
    bvh.write(tmp_path / "a.bvh", walker, unit_to_m=unit)
    clip = sources.load(tmp_path / "a.bvh")
    assert clip.unit_to_m == unit
    np.testing.assert_allclose(clip.positions[:, 0], walker.positions[:, 0], atol=1e-5)


def test_acclaim_knows_its_unit(data):
    path = data / "cmu/asfamc/02/02_01.amc"
    clip = sources.load(path, unit_to_m=0.1)
    np.testing.assert_allclose(clip.positions, sources.load(path).positions / (2.54 / 45) * 0.1)


def test_other_formats(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"x")
    for function in (sources.load, sources.find):
        with pytest.raises(UserError, match=r"not a motion file; the formats are \.amc, \.bvh"):
            function(tmp_path / "a.fbx")


@pytest.fixture
def tree(walker, tmp_path):
    one = tmp_path / "b.bvh"
    bvh.write(one, walker.replace(positions=walker.positions[:3], rotations=walker.rotations[:3]))
    for name in ("a/z.bvh", "a/deep/er/c.BVH", "a/.hidden/d.bvh", ".trash/e.bvh", "a/._f.bvh"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(one, tmp_path / name)
    (tmp_path / "a" / "notes.txt").write_text("no motion")
    (tmp_path / "empty").mkdir()
    return tmp_path


def test_find(tree):
    expected = [tree / name for name in ("a/deep/er/c.BVH", "a/z.bvh", "b.bvh")]
    assert sources.find([tree]) == expected
    assert sources.find(tree) == expected
    assert sources.find(str(tree)) == expected
    assert sources.find([tree / "b.bvh", tree / "a", tree, tree / "a" / ".." / "b.bvh"]) == expected
    assert sources.find([tree / "b.bvh"]) == [tree / "b.bvh"]
    assert sources.find([tree / ".trash"]) == [tree / ".trash" / "e.bvh"]  # asked for by name


def test_a_file_whose_name_reads_like_an_animation_is_that_file(tree):
    odd = tree / "empty" / "hero.glb#Walk.bvh"
    assert sources.split(odd) == (tree / "empty" / "hero.glb", "Walk.bvh")
    shutil.copy(tree / "b.bvh", odd)
    assert sources.find([tree / "empty"]) == [odd]
    assert len(sources.load(odd)) == 3


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["empty"], "empty: no clips in this folder; the formats are"),
        (["b.bvh", "missing"], "missing: no such file or folder"),
        (["a/notes.txt"], "not a motion file; the formats are"),
        ([], "no sources given"),
    ],
)
def test_what_is_not_found(tree, names, message):
    with pytest.raises(UserError, match=message):
        sources.find([tree / name for name in names])


@pytest.mark.parametrize(
    ("patterns", "left"),
    [
        (["b"], ["a/deep/er/c.BVH", "a/z.bvh"]),  # a stem
        (["a/deep/*"], ["a/z.bvh", "b.bvh"]),  # a path from the source on
        (["[bc]", "z"], None),
        (["c", "b*"], ["a/z.bvh"]),
    ],
)
def test_excluded_clips_are_left_out(tree, patterns, left):
    if left is None:
        with pytest.raises(UserError, match="all 3 clips are excluded"):
            sources.find(tree, exclude=patterns)
    else:
        assert sources.find(tree, exclude=patterns) == [tree / name for name in left]


def test_a_pattern_that_excludes_nothing_is_named(tree):
    with pytest.raises(UserError, match=r"like 'jump\*'; the clips are c, z, b"):
        sources.find(tree, exclude=["z", "jump*"])


def test_loops_of_links_pipes_and_skeletons_beside_clips(tmp_path):
    (tmp_path / "good.bvh").write_text("x")
    (tmp_path / "loop.bvh").symlink_to(tmp_path / "loop.bvh")
    assert {p.name for p in sources.find(tmp_path)} == {"good.bvh", "loop.bvh"}
    os.mkfifo(tmp_path / "pipe.bvh")
    with pytest.raises(UserError, match="not a regular file"):
        sources.find(tmp_path / "pipe.bvh")
    (tmp_path / "01_01.amc").write_text("x")
    (tmp_path / "01.ASF").write_text("x")
    assert tmp_path / "01.ASF" in sources.inputs(tmp_path / "01_01.amc")


def test_a_folder_that_cannot_be_read_is_not_passed_over(tmp_path, monkeypatch):
    (tmp_path / "secret").mkdir()
    (tmp_path / "good.bvh").write_text("x")
    scandir = os.scandir

    def refuse(path):
        if str(path).endswith("secret"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)  # the tests may run as one who can read everything
    with pytest.raises(UserError, match="secret: cannot read this folder: Permission denied"):
        sources.find(tmp_path)
