"""Characters that pose rigs of their own: in a system, and from the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from test_retarget import other_joints, slides, stocky

from mm import courses
from mm.cli import main
from mm.controller import Controller
from mm.description import anatomy_of
from mm.recording import record
from mm.rigged import Rigged
from motion import axes, bvh, kinematics, quat, rig, sources
from motion.anatomy import anatomy
from motion.clip import Clip


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def quiet(steps, **_):
    yield from steps


def test_rigs_go_where_the_characters_go(database):
    rigged = Rigged(Controller(database, count=2), anatomy(rig.enlarge(stocky())))
    course = courses.load("circle")
    recording = record(rigged, course, seconds=4, spread=True, progress=quiet)
    plain = record(Controller(database, count=2), course, seconds=4, spread=True, progress=quiet)
    np.testing.assert_array_equal(recording["positions"], plain["positions"])
    assert recording["rig_positions"].shape == (240, 2, 191, 3)
    scale = rigged.retargeter.plan.scale
    clip = rigged.clip(recording, 1)
    hips = clip.skeleton.roles["hips"]
    place = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0][:, hips]
    own = recording.clip(1)
    theirs = kinematics.forward(own.skeleton, own.positions, own.rotations)[0][:, own.skeleton.roles["hips"]]
    np.testing.assert_allclose(place[:, [0, 2]], scale * theirs[:, [0, 2]], atol=0.05)
    # Feet that the controller has held for a while slide on the rig no more than on its own skeleton.
    held = recording["locked"][:, 1]
    long = np.stack(
        [np.convolve(held[:, c], np.ones(12), "full")[: len(held)] == 12 for c in range(2)], axis=-1
    )
    assert long.sum() > 50
    for share in (50, 95, 100):
        assert np.percentile(slides(clip, long), share) < np.percentile(slides(own, long), share)
    assert np.median(slides(clip, long)) < 1e-3
    assert rigged.memory()["rig"] == 191 * 13 * 4


def test_its_anatomy_comes_from_its_poses(database):
    body = anatomy_of(database, ranges=3)
    assert body.skeleton is database.skeleton
    assert np.isfinite(body.sole)


@pytest.fixture(scope="module")
def files(database, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rigged")
    database.save(folder / "walker.mmdb")
    target = other_joints()
    still = quat.identity(2, len(target))
    bvh.write(folder / "rig.bvh", Clip("rig", target, 60.0, np.tile(target.offsets, (2, 1, 1)), still))
    return folder


def run(files, *options, code=0):
    arguments = ["run", files / "walker.mmdb", "--course", "circle", "--seconds", "1", *options]
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_run_writes_the_rig_in_the_axes_asked_for(files, tmp_path):
    facts = json.loads(run(files, "--rig", files / "rig.bvh", "-o", tmp_path / "ours.bvh", "--json").stdout)
    assert facts["rig"].endswith("rig.bvh")
    run(
        files,
        *("--rig", files / "rig.bvh", "-o", tmp_path / "theirs.bvh"),
        *("--up", "z", "--forward", "x", "--handedness", "left", "--unit", "cm"),
    )
    ours = sources.load(tmp_path / "ours.bvh", unit_to_m=1.0)
    theirs = sources.load(tmp_path / "theirs.bvh", unit_to_m=0.01)
    assert set(ours.skeleton.names) == set(other_joints().names)
    a, b = (kinematics.forward(c.skeleton, c.positions, c.rotations)[0] for c in (ours, theirs))
    # Ours (left, up, forward) are x y z; theirs forward x, right y, up z.
    np.testing.assert_allclose(b, np.stack([a[..., 2], -a[..., 0], a[..., 1]], axis=-1), atol=1e-3)


def test_a_rig_of_other_axes_and_unit_is_the_same_rig(files, tmp_path):
    clip = axes.convert(sources.load(files / "rig.bvh"), up="z", forward="x", handedness="left")
    bvh.write(tmp_path / "theirs.bvh", clip, unit_to_m=0.0254)
    reading = "--rig-up", "z", "--rig-forward", "x", "--rig-handedness", "left", "--rig-unit", "inch"
    run(files, "--rig", files / "rig.bvh", "-o", tmp_path / "a.bvh")
    run(files, "--rig", tmp_path / "theirs.bvh", *reading, "-o", tmp_path / "b.bvh")
    a, b = (sources.load(tmp_path / f"{name}.bvh", unit_to_m=1.0) for name in "ab")
    np.testing.assert_allclose(a.positions, b.positions, atol=1e-4)
    np.testing.assert_allclose(np.abs(np.sum(a.rotations * b.rotations, axis=-1)), 1, atol=1e-6)
    run(files, "--rig", tmp_path / "theirs.bvh", *reading, "-o", tmp_path / "b.npz")
    np.testing.assert_allclose(sources.load(tmp_path / "b.npz").positions, b.positions, atol=1e-4)


def test_run_refuses_what_is_no_rig(files, tmp_path):
    assert "give --rig FILE too" in run(files, "--roles", "x.toml", code=2).stderr
    assert "no such file" in run(files, "--rig", tmp_path / "none.bvh", code=2).stderr
    assert "give --rig FILE too" in run(files, "--rig-up", "z", code=2).stderr
    assert "it is a folder" in run(files, "--rig", files, code=2).stderr
    assert "name a .bvh, .npz or .glb file" in run(files, "-o", tmp_path / "x.fbx", code=2).stderr
    out = run(files, "--rig", files / "rig.bvh", "-o", files / "rig.bvh", code=2).stderr
    assert "rig.bvh" in out
    assert "lie along one axis" in run(files, "--up", "z", "--forward", "-z", code=2).stderr
