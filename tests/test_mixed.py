"""Corpora of several skeletons, rates, units and axes become one database on one skeleton."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import synthetic
from click.testing import CliRunner

from bench.cli import main as bench
from mm import skeletons
from mm.build import build
from mm.cli import main
from mm.database import Database
from mm.intake import Report
from motion import axes, bvh, kinematics, subset
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton

SIZE = 0.6


def _other(name: str, *, fps: float = 60, **options: float) -> Clip:
    """The walker at another size, without hands."""
    clip = synthetic.walk(name, fps=fps, **options)  # type: ignore[arg-type]
    clip = subset.subset(clip, [j for j in clip.skeleton.names if not j.endswith("Hand")])
    old = clip.skeleton
    ends = {j: SIZE * offset for j, offset in old.end_sites.items()}
    skeleton = Skeleton(old.names, old.parents, SIZE * old.offsets, old.roles, ends)
    return clip.replace(skeleton=skeleton, positions=SIZE * clip.positions)


@pytest.fixture(scope="module")
def mixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same walk as a.bvh; at another size, rate, unit and with other joints and axes as b.bvh."""
    folder = tmp_path_factory.mktemp("mixture")
    bvh.write(folder / "a.bvh", synthetic.walk("a", turn=0.4))
    odd = axes.convert(_other("b", fps=30, turn=0.4), up="z", forward="-y", scale=1 / 0.0254)
    bvh.write(folder / "b.bvh", odd)
    (folder / "clips.toml").write_text('[[clips]]\nfiles = "b"\nunit = "inch"\nup = "z"\n')
    return folder


def _world(db: Database, name: str) -> np.ndarray:
    r = db.names.index(name)
    poses = db.poses[db.starts[r] : db.stops[r]]
    return kinematics.forward(db.skeleton, poses.positions.astype(float), poses.rotations.astype(float))[0]


def test_one_walk_on_two_skeletons_is_one_walk_on_either(mixture: Path) -> None:
    """Sizes differ by one factor, so on either skeleton both are the same motion but for planted feet."""
    for file, factor in (("a.bvh", 1.0), ("b.bvh", SIZE)):
        notes: list[str] = []
        db = build(mixture, skeleton=mixture / file, mirror=False, note=notes.append)
        assert db.names == ("a", "b") and (db.stops - db.starts).tolist() == [300, 299]
        assert "1 of 2 clips have other joints and are retargeted by their roles" in notes
        a, b = _world(db, "a")[:299], _world(db, "b")
        apart = np.linalg.norm(a - b, axis=-1)
        assert np.median(apart) < 0.01 * factor and np.percentile(apart, 99) < 0.06 * factor
        expected = synthetic.HIPS * factor
        assert abs(b[:, db.skeleton.role("hips"), 1].mean() - expected) < 0.02 * factor
        speed = np.linalg.norm(db.poses.velocities[db.starts[1] + 30 : db.stops[1] - 30, 0], axis=-1)
        np.testing.assert_allclose(speed.mean(), 1.2 * factor, atol=0.03)
        assert (db.contacts[:299] == db.contacts[300:]).mean() > 0.9


def test_without_its_rules_a_clip_that_lies_on_the_ground_is_left_out(mixture: Path) -> None:
    files = [mixture / "a.bvh", mixture / "b.bvh"]  # not the folder, in which the rules lie
    report = Report()
    assert build(files, skeleton=files[0], mirror=False, report=report).names == ("a",)
    assert report.gone == {files[1]}
    alone = build(files[1], source_unit="inch", source_up="z", mirror=False)
    assert abs(alone.poses.positions[:, 1, 1].mean() - SIZE * synthetic.HIPS) < 0.02


def test_the_built_in_skeleton(mixture: Path, tmp_path: Path) -> None:
    out = tmp_path / "db"
    done = CliRunner().invoke(main, ["build", str(mixture), "-o", str(out), "--skeleton", "dancecard"])
    assert done.exit_code == 0, done.output
    db = Database.load(out)
    figure = skeletons.built_in("dancecard").skeleton
    assert db.skeleton.names[-len(figure) :] == figure.names and db.names[::2] == ("a", "b")
    ratio = subset.leg_length(figure, figure.offsets) / (2 * synthetic.THIGH)
    speed = np.linalg.norm(db.poses.velocities[:, 0], axis=-1)
    np.testing.assert_allclose(np.median(speed), 1.2 * ratio, atol=0.05)
    with pytest.raises(UserError, match="no built-in skeleton 'foxtrot'; choose from dancecard"):
        skeletons.built_in("foxtrot")


def test_bench_takes_the_same_options(mixture: Path, tmp_path: Path) -> None:
    out = tmp_path / "report"
    arguments = ["--skeleton", str(mixture / "a.bvh"), "--courses", "circle", "--indexes", "brute"]
    once = ["--repeats", "1", "--no-crowds"]
    done = CliRunner().invoke(
        bench, ["compare", str(mixture), *arguments, "--seconds", "1", "-o", str(out), "--no-check", *once]
    )
    assert done.exit_code == 0, done.output
    assert Database.load(out / "database.mmdb").names == ("a", "a", "b", "b")


def test_a_skeleton_that_does_not_tell_how_it_stands(mixture: Path, tmp_path: Path) -> None:
    lame = _other("lame", seconds=1.0)
    (tmp_path / "roles.toml").write_text('[[clips]]\nfiles = "lame"\nroles = { left_leg = "" }\n')
    bvh.write(tmp_path / "lame.bvh", lame)
    report, notes = Report(), []
    db = build(
        [mixture / "a.bvh", tmp_path / "lame.bvh"],
        clips=tmp_path / "roles.toml",
        skeleton=mixture / "a.bvh",
        report=report,
        note=notes.append,
    )
    assert set(db.names) == {"a"} and [loss.kind for loss in report.losses] == ["skeleton"]
    path = tmp_path / "lame.bvh"
    assert f"left out 1 clip with 20 joints, such as {path}: no joint plays the role left_leg" in notes
    with pytest.raises(UserError, match="no clip of 1 can be retargeted; the first: no joint plays"):
        build(tmp_path / "lame.bvh", clips=tmp_path / "roles.toml", skeleton=mixture / "a.bvh")
    with pytest.raises(UserError, match="no joint plays the role left_leg") as caught:
        build(
            [mixture / "a.bvh", tmp_path / "lame.bvh"],
            clips=tmp_path / "roles.toml",
            skeleton=tmp_path / "lame.bvh",
        )
    assert caught.value.path == str(tmp_path / "lame.bvh")


def test_people_of_five_sets_and_a_dog(data: Path) -> None:
    """A clip of each set on LAFAN's skeleton: feet stand, heights and speeds are people's, the dog is out."""
    lafan = data / "lafan1/locomotion_60fps/walk1_subject1_walk2_filtered.bvh"
    sources = [
        lafan,
        data / "cmu/asfamc/02/02_01.amc",
        data / "cmu/daz_bvh/02/02_02.bvh",
        data / "bandai/dataset-2/dataset-2_walk_normal_001.bvh",
        data / "pfnn/animations/LocomotionFlat04_000.bvh",
        data / "dog_mann/D1_010_KAN01_004.bvh",
    ]
    report, notes = Report(), []
    db = build(sources, skeleton=lafan, mirror=False, report=report, note=notes.append)
    assert len(db.names) == 5 and any("cannot move a biped as a quadruped moves" in line for line in notes)
    assert [loss.path.parent.name for loss in report.losses if loss.kind == "skeleton"] == ["dog_mann"]
    toes = [db.skeleton.role(role) for role in ("left_toe", "right_toe")]
    for r, name in enumerate(db.names):
        world, contacts = _world(db, name), db.contacts[db.starts[r] : db.stops[r]] != 0
        both = contacts[1:] & contacts[:-1]
        slides = np.linalg.norm(np.diff(world[:, toes], axis=0), axis=-1)[both] * 60
        assert np.mean(slides) < 0.1, name
        assert world[:, toes, 1].min() > -0.07, name
        assert 0.75 < np.median(world[:, db.skeleton.role("hips"), 1]) < 1.05, name
        assert np.percentile(np.linalg.norm(np.diff(world[:, 0], axis=0), axis=-1), 99) * 60 < 4, name
