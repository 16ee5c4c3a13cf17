"""From any format to any that is written, and files with several animations through the commands."""

import json

import gltf_files
import numpy as np
import pytest

from mm import build
from motion import cli, kinematics, npz, sources, writers
from motion.errors import UserError


@pytest.fixture
def run(capsys):
    """Run a command; returns exit code, standard output and standard error."""

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main([str(a) for a in arguments])
        out = capsys.readouterr()
        return stop.value.code, out.out, out.err

    return call


@pytest.fixture
def hero(walker_clips, tmp_path):
    """A file of two animations, straight and left_turn."""
    (tmp_path / "in").mkdir()
    return gltf_files.of_clips(walker_clips[:2]).write(tmp_path / "in" / "hero.glb")


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def test_convert_to_npz_keeps_every_bit(run, walker_files, tmp_path):
    source = walker_files / "run.bvh"
    assert run("convert", source, tmp_path / "a.npz")[0] == 0
    original, copy = sources.load(source), sources.load(tmp_path / "a.npz")
    for a, b in ((original.positions, copy.positions), (original.rotations, copy.rotations)):
        np.testing.assert_array_equal(a, b)
    assert copy.unit_to_m == 1 and copy.skeleton.roles == original.skeleton.roles
    assert run("convert", tmp_path / "a.npz", tmp_path / "b.bvh")[0] == 0
    np.testing.assert_allclose(world(sources.load(tmp_path / "b.bvh")), world(original), atol=1e-5)


def test_convert_says_axes_and_unit_in_npz(run, walker_files, tmp_path):
    options = ["--up", "z", "--forward", "x", "--handedness", "left", "--unit", "cm"]
    assert run("convert", walker_files / "run.bvh", tmp_path / "a.npz", *options)[0] == 0
    with np.load(tmp_path / "a.npz") as found:
        assert [str(found[k]) for k in ("up", "forward", "handedness")] == ["z", "x", "left"]
        assert found["unit_to_m"] == 0.01
    copy = sources.load(tmp_path / "a.npz")
    np.testing.assert_allclose(world(copy), world(sources.load(walker_files / "run.bvh")), atol=1e-9)


def test_a_folder_into_npz(run, walker_files, tmp_path):
    assert run("convert", walker_files, tmp_path / "out", "--format", "npz")[0] == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["left_turn.npz", "right_turn.npz", "run.npz", "stand.npz", "straight.npz"]


def test_animations_go_into_a_folder_of_their_file_s_name(run, hero, walker_clips, tmp_path):
    assert run("convert", hero, tmp_path / "out")[0] == 0
    paths = sources.find(tmp_path / "out")
    assert [str(p.relative_to(tmp_path / "out")) for p in paths] == [
        "hero/left_turn.bvh",
        "hero/straight.bvh",
    ]
    np.testing.assert_allclose(world(sources.load(paths[0])), world(walker_clips[1]), atol=1e-5)
    assert run("convert", f"{hero}#straight", tmp_path / "one.npz")[0] == 0
    np.testing.assert_allclose(world(sources.load(tmp_path / "one.npz")), world(walker_clips[0]), atol=1e-6)


def test_info_and_roles_of_an_animation(run, hero):
    code, out, _ = run("info", hero, "--json")
    rows = json.loads(out)
    assert code == 0 and [row["file"] for row in rows] == [f"{hero}#left_turn", f"{hero}#straight"]
    assert rows[1]["mean_speed_mps"] == pytest.approx(1.2, rel=0.01)
    code, out, _ = run("roles", f"{hero}#straight", "--json")
    assert code == 0 and json.loads(out)["roles"]["left_toe"] == "LeftToe"


@pytest.mark.filterwarnings("always::motion.errors.Note")
def test_info_of_an_smpl_file_says_once_that_bones_are_guessed(run, tmp_path):
    for name in "ab":
        poses, trans = np.zeros((30, 156)), np.tile([0.0, 0, 1], (30, 1))
        np.savez(tmp_path / f"{name}.npz", poses=poses, trans=trans, mocap_framerate=60.0)
    code, out, err = run("info", tmp_path, "--json")
    assert code == 0 and len(json.loads(out)) == 2
    notes = [line for line in err.splitlines() if line.startswith("note: ")]
    assert len(notes) == 1 and "do not say how long bones are" in notes[0]


@pytest.mark.parametrize(
    ("source", "target", "options", "message"),
    [
        (
            "hero.glb",
            "a.bvh",
            (),
            "holds 2 animations; name a folder, or one of them, such as hero.glb#left_turn",
        ),
        ("hero.glb#straight", "a.npz", ("--format", "bvh"), "not a .bvh file; leave out --format"),
        ("hero.glb#jump", "a.npz", (), "no animation 'jump'; the file has straight, left_turn"),
        ("hero.glb#straight", "a.fbx", (), "cannot write .fbx files; name a .bvh, .npz or .glb file"),
        ("hero.glb", "x/hero", ("--format", "fbx"), "'fbx' is not one of"),
        ("", "a.npz", (), "not a folder"),
    ],
)
def test_faults(run, hero, tmp_path, source, target, options, message):
    code, _, err = run("convert", hero.parent / source, tmp_path / "out" / target, *options)
    assert code == 2 and message in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_nothing_is_written_over_what_is_read(hero, walker, tmp_path):
    npz.write(tmp_path / "a.npz", walker)
    with pytest.raises(UserError, match="would write over its source"):
        writers.targets(tmp_path / "a.npz", tmp_path / "a.npz")
    with pytest.raises(UserError, match="would be written over"):
        writers.targets(hero, tmp_path / "out", others=[str(tmp_path / "out" / "hero" / "straight.bvh")])


def test_a_database_takes_every_animation(hero, walker_clips):
    other = hero.with_name("other.glb")
    other.write_bytes(hero.read_bytes())
    db = build.build([hero.parent], mirror=False, exclude=["other.glb#left*"])
    assert db.names == ("left_turn", "hero/straight", "other/straight")
    assert (db.stops - db.starts).tolist() == [300] * 3
    with pytest.raises(
        UserError, match=r"no clip to exclude is named like 'jump\*'; the clips are left_turn, straight"
    ):
        build.build([hero], exclude=["jump*"])
