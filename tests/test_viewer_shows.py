from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mm.recording import Recording
from motion import kinematics, quat, root
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton
from viewer import shows
from viewer.scene import Labels, Solids
from viewer.stage import Stage


def recording(clip: Clip, places: list[tuple[float, float]]) -> Recording:
    """Characters that do the same at several places (x, z)."""
    count = len(places)
    grounded = root.ground(clip)
    positions = np.repeat(grounded.positions[:, None], count, axis=1).astype(np.float32)
    positions[:, :, 0, [0, 2]] += np.array(places, np.float32)
    rotations = np.repeat(grounded.rotations[:, None], count, axis=1).astype(np.float32)
    commands = {
        "command_velocity": np.zeros((len(clip), count, 2), np.float32),
        "command_yaw": np.zeros((len(clip), count), np.float32),
    }
    arrays = {"positions": positions, "rotations": rotations} | commands
    return Recording("mm-exact", grounded.skeleton, clip.fps, arrays, step_seconds=np.zeros(len(clip)),
                     stage_seconds=np.zeros((len(clip), 0)))  # fmt: skip


def test_poses_at_frames_are_the_clips_and_lie_between_them_else(walker: Clip) -> None:
    show = shows.of_clip(walker)
    world, turned = kinematics.forward(walker.skeleton, walker.positions, walker.rotations)
    positions, rotations = show.pose(30 / walker.fps)
    assert positions.shape == (1, len(walker.skeleton) + 1, 3)
    np.testing.assert_allclose(positions[0, 1:], world[30], atol=1e-4)
    assert quat.angle_between(rotations[0, 1:].astype(float), turned[30]).max() < 1e-3
    between, _ = show.pose(30.5 / walker.fps)
    np.testing.assert_allclose(between[0, 1:], (world[30] + world[31]) / 2, atol=3e-3)
    assert show.seconds == pytest.approx((len(walker) - 1) / walker.fps)


def test_before_the_start_and_after_the_end_it_stands_still(walker: Clip) -> None:
    show = shows.of_clip(walker)
    assert show.seconds is not None
    for outside, inside in ((-3.0, 0.0), (99.0, show.seconds)):
        np.testing.assert_array_equal(show.pose(outside)[0], show.pose(inside)[0])


def test_a_recording_shows_all_its_characters(walker: Clip, tmp_path: Path) -> None:
    recording(walker, [(0, 0), (2, 1), (-1, 3)]).save(tmp_path / "lap.rec")
    show = shows.load(tmp_path / "lap.rec")
    assert (show.name, show.count) == ("lap", 3)
    positions, _ = show.pose(1.0)
    np.testing.assert_allclose(
        positions[1] - positions[0], np.tile([2, 0, 1], (positions.shape[1], 1)), atol=1e-5
    )


def test_files_are_told_apart_and_faults_are_named(walker_files: Path, tmp_path: Path) -> None:
    assert shows.load(walker_files / "run.bvh").name == "run"
    with pytest.raises(UserError, match=r"none\.bvh: no such file"):
        shows.load(tmp_path / "none.bvh")
    (tmp_path / "notes.txt").write_text("no motion")
    with pytest.raises(UserError, match="not a motion file"):
        shows.load(tmp_path / "notes.txt")


def test_what_has_no_roles_is_shown_as_bones() -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0], np.int32), np.array([[0, 0, 0], [0, 1.0, 0]]))
    clip = Clip("stick", skeleton, 30.0, np.tile(skeleton.offsets, (3, 1, 1)), quat.identity(3, 2))
    show = shows.of_clip(clip)
    assert len(show.body.parts) == 1
    assert Stage([show]).tall == pytest.approx(1.0)
    with pytest.raises(UserError, match="no frames"):
        shows.of_clip(clip.replace(positions=clip.positions[:0], rotations=clip.rotations[:0]))


def test_a_single_show_stands_where_it_is(walker: Clip) -> None:
    moved = walker.replace(
        positions=walker.positions + np.eye(len(walker.skeleton), 1)[:, :1] * [3.0, 0, -2.0]
    )
    stage = Stage([shows.of_clip(moved)])
    stage.move_to(0.5)
    expected, _ = stage.shows[0].pose(0.5)
    np.testing.assert_array_equal(stage.pose(0, 0.5)[0], expected)
    np.testing.assert_allclose(stage.roots, expected[:, 0])
    layer = next(iter(stage.scene.layers.values()))
    assert isinstance(layer, Solids)
    np.testing.assert_allclose(
        layer.transforms[0, :, :, 3], expected[0, stage.shows[0].body.joints], atol=1e-5
    )


def test_several_begin_side_by_side_facing_ahead(walker_clips: list[Clip]) -> None:
    turned = [c.replace(rotations=c.rotations.copy(), positions=c.positions.copy()) for c in walker_clips[:3]]
    quarter = quat.from_yaw(np.array(np.pi / 2))
    turned[1].positions[:, 0] = quat.rotate(quarter, turned[1].positions[:, 0])
    turned[1].rotations[:, 0] = quat.mul(quarter, turned[1].rotations[:, 0])
    stage = Stage([shows.of_clip(clip) for clip in turned], names=True)
    np.testing.assert_allclose(stage.yaws, 0, atol=1e-3)
    np.testing.assert_allclose(stage.roots[:, 2], 0, atol=1e-5)
    gaps = np.diff(stage.roots[:, 0])
    assert (gaps > 0.8).all() and np.ptp(gaps) < 1e-5
    names = stage.scene.layers["names"]
    assert isinstance(names, Labels) and names.visible
    assert list(names.texts) == [clip.name for clip in turned]
    stage.move_to(1.0)
    # All of them walk; the names stay above them.
    assert (stage.roots[:, 2] > 0.8).all()
    np.testing.assert_allclose(names.positions[:, [0, 2]], stage.roots[:, [0, 2]], atol=1e-5)
    assert (names.positions[:, 1] > 1.6).all()


def test_a_stage_tells_how_far_its_shows_go(walker_clips: list[Clip]) -> None:
    stage = Stage([shows.of_clip(walker_clips[0])])
    middles, corners = stage.boxes([0.0, 1.0, 2.0])
    assert middles[2, 2] - middles[0, 2] == pytest.approx(2.4, abs=0.15)  # at 1.2 m/s
    np.testing.assert_array_equal(middles[:, 1], 0)
    for time, box in zip((0.0, 1.0, 2.0), corners, strict=True):
        joints = stage.pose(0, time)[0][0]
        assert (joints > box.min(axis=0)).all() and (joints < box.max(axis=0)).all()
    assert stage.seconds == pytest.approx(walker_clips[0].seconds, abs=0.02)
    with pytest.raises(ValueError, match="no shows"):
        Stage([])
