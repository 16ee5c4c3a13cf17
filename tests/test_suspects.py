"""Remarks on clips: a sound one gets none, a damaged one is named with frame and number."""

from __future__ import annotations

import numpy as np
import pytest

from mm import suspects
from mm.build import build
from motion import bvh, sources


@pytest.fixture
def clip(walker_files):
    return sources.load(walker_files / "straight.bvh")


def _moved(clip, frames, offset):
    """The clip with its hips elsewhere during some frames."""
    positions = clip.positions.copy()
    positions[frames, 0] += offset
    return clip.replace(positions=positions)


def test_sound_clips_get_no_remark(walker_files):
    clips = [sources.load(path) for path in sources.find(walker_files)]
    assert suspects.captures(clips, [clip.name for clip in clips], [0] * len(clips)) == []
    assert suspects.contacts(build(walker_files, jobs=1)) == []


def test_a_jump_is_named_with_frame_and_speed(clip):
    # Half a metre to the side within a sixtieth of a second, and back.
    broken = _moved(clip, slice(100, 103), (0.5, 0, 0))
    (line,) = suspects.captures([clip, broken], ["sound", "broken"], [0, 10])
    assert line == "a broken capture? hips faster than 15 m/s: broken (30 m/s to frame 110)"
    slower = _moved(clip, slice(100, 103), (0.2, 0, 0))
    assert suspects.captures([slower], ["slower"], [0]) == []


def test_hips_below_the_ground_are_named(clip):
    depth = clip.positions[:, 0, 1] + 0.5
    sunk = clip.replace(positions=clip.positions - np.where([[[0, 1, 0]]], depth[:, None, None], 0))
    (line,) = suspects.captures([sunk], ["sunk"], [0])
    assert "hips 0.3 m or more below the ground: sunk (-0.50 m at frame" in line


def test_the_hips_may_be_any_joint(walker_files):
    clip = sources.load(walker_files / "straight.bvh")
    roles = {**clip.skeleton.roles, "hips": clip.skeleton.role("head")}
    moved = clip.replace(skeleton=clip.skeleton.with_roles(roles))
    head = suspects._hips(moved)
    assert (head[:, 1] > clip.positions[:, 0, 1] + 0.3).all()


def test_many_are_counted(clip):
    broken = _moved(clip, slice(100, 103), (0.5, 0, 0))
    (line,) = suspects.captures([broken] * 8, list("abcdefgh"), [0] * 8)
    assert line.endswith("e (30 m/s to frame 100) and 3 more") and " f (" not in line


def test_moving_without_touching_the_ground(clip, tmp_path):
    # Carried along twice as fast, no foot ever stands still.
    drift = np.arange(len(clip))[:, None] / 60 * np.array([0, 0, 1.2])
    positions = clip.positions.copy()
    positions[:, 0] += drift
    bvh.write(tmp_path / "carried.bvh", clip.replace(positions=positions))
    bvh.write(tmp_path / "walked.bvh", clip)
    notes: list[str] = []
    build(tmp_path, jobs=1, note=notes.append)
    (line,) = notes
    assert line == (
        "1 of 2 clips move but touch the ground in less than 5% of the frames, so that no foot is held: "
        "carried (2.4 m/s)"
    )


def test_known_defects_are_found(data, tmp_path):
    notes: list[str] = []
    build(data / "cmu" / "known_bad", roles_only=True, note=notes.append)
    assert any("hips faster than 15 m/s" in line and "09_10 (231 m/s to frame 4)" in line for line in notes)
    assert any("below the ground: 07_12 (-0.3" in line for line in notes)
