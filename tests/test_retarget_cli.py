"""``python -m motion retarget`` from the outside."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from test_retarget import degrees_apart, other_joints

from motion import bvh, kinematics, quat, sources
from motion.cli import main
from motion.clip import Clip


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "hero.bvh"
    target = other_joints()
    still = quat.identity(2, len(target))
    bvh.write(path, Clip("hero", target, 60.0, np.tile(target.offsets, (2, 1, 1)), still))
    return path


def motion(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result.stderr


def test_files_and_folders_go_onto_the_skeleton(walker_files, rig_file, tmp_path):
    said = motion("retarget", walker_files, "--to", rig_file, "-o", tmp_path / "out")
    assert "wrote 5 files" in said
    before = sources.load(walker_files / "run.bvh")
    after = sources.load(tmp_path / "out" / "run.bvh", unit_to_m=1.0)
    assert set(after.skeleton.names) == set(other_joints().names)
    apart = degrees_apart(before, after)
    assert max(apart[f"{side}_{part}"] for side in ("left", "right") for part in ("arm", "forearm")) < 0.05
    motion("retarget", walker_files / "run.bvh", "--to", rig_file, "-o", tmp_path / "one.bvh", "--no-feet")
    free = sources.load(tmp_path / "one.bvh", unit_to_m=1.0)
    apart = degrees_apart(before, free)
    apart.pop("hips")
    assert max(apart.values()) < 0.05


def test_roles_of_either_skeleton_can_be_told(walker_files, rig_file, tmp_path):
    (tmp_path / "roles.toml").write_text('[roles]\nleft_hand = ""\nright_hand = ""\n')
    out = tmp_path / "out.bvh"
    for option in ("--roles", "--to-roles"):
        motion(
            "retarget", walker_files / "run.bvh", "--to", rig_file, "-o", out, option, tmp_path / "roles.toml"
        )
        moved = sources.load(out)
        wrist = moved.rotations[:, moved.skeleton.index("left_wrist")]
        np.testing.assert_allclose(np.ptp(wrist, axis=0), 0, atol=1e-6)


def test_axes_of_the_source_can_be_told(walker_files, rig_file, tmp_path):
    clip = tmp_path / "z.bvh"
    motion("convert", walker_files / "run.bvh", clip, "--up", "z", "--forward", "-y")
    motion("retarget", clip, "--to", rig_file, "-o", tmp_path / "a.bvh", "--source-up", "z")
    motion("retarget", walker_files / "run.bvh", "--to", rig_file, "-o", tmp_path / "b.bvh")
    a, b = sources.load(tmp_path / "a.bvh"), sources.load(tmp_path / "b.bvh")
    np.testing.assert_allclose(a.positions, b.positions, atol=1e-3)


def test_what_is_written_has_the_unit_and_axes_of_the_skeleton(walker_files, rig_file, tmp_path):
    theirs = "--up", "z", "--forward", "x", "--handedness", "left", "--unit", "inch"
    motion("convert", rig_file, tmp_path / "theirs.bvh", *theirs)
    motion("retarget", walker_files / "run.bvh", "--to", rig_file, "-o", tmp_path / "ours.bvh")
    read = "--to-up", "z", "--to-forward", "x", "--to-handedness", "left", "--to-unit", "inch"
    rig = "--to", tmp_path / "theirs.bvh", *read
    motion("retarget", walker_files / "run.bvh", *rig, "-o", tmp_path / "out.bvh")
    motion("retarget", walker_files / "run.bvh", *rig, "-o", tmp_path / "out.npz")
    ours = sources.load(tmp_path / "ours.bvh", unit_to_m=1.0)
    written, archive = (
        sources.load(tmp_path / "out.bvh", unit_to_m=0.0254),
        sources.load(tmp_path / "out.npz"),
    )
    a, b = (kinematics.forward(c.skeleton, c.positions, c.rotations)[0] for c in (ours, written))
    # Ours (left, up, forward) are x y z; theirs forward x, right y, up z.
    np.testing.assert_allclose(b, np.stack([a[..., 2], -a[..., 0], a[..., 1]], axis=-1), atol=1e-3)
    rig_offsets = sources.load(tmp_path / "theirs.bvh", unit_to_m=0.0254).skeleton.offsets
    np.testing.assert_allclose(written.skeleton.offsets[1:], rig_offsets[1:], atol=1e-6)
    np.testing.assert_allclose(archive.positions, ours.positions, atol=1e-5)  # an archive says its axes


def test_bad_input_is_one_line(walker_files, rig_file, tmp_path):
    out = tmp_path / "out.bvh"
    assert "Missing option '--to'" in motion("retarget", walker_files, "-o", out, code=2)
    said = motion("retarget", walker_files, walker_files / "run.bvh", "--to", rig_file, "-o", out, code=2)
    assert "name a folder for several sources" in said
    said = motion("retarget", rig_file, "--to", walker_files / "run.bvh", "-o", rig_file, code=2)
    assert "write over its source" in said
    said = motion("retarget", walker_files / "run.bvh", "--to", rig_file, "-o", rig_file, code=2)
    assert "hero.bvh" in said
    said = motion("retarget", walker_files / "run.bvh", "--to", walker_files, "-o", out, code=2)
    assert "it is a folder; name one motion file" in said
    (tmp_path / "roles.toml").write_text('[roles]\nhips = ""\n')
    for option, file in (("--roles", walker_files / "run.bvh"), ("--to-roles", rig_file)):
        said = motion("retarget", walker_files / "run.bvh", "--to", rig_file, "-o", out, option,
                      tmp_path / "roles.toml", code=2)  # fmt: skip
        assert f"{file}: no joint plays the role hips" in said
        assert said.count("\n") == 1
    assert not out.exists()
