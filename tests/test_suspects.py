"""Remarks on clips: sound ones get none, one that is carried along is named."""

from __future__ import annotations

import numpy as np
import pytest

from mm import suspects
from mm.build import build
from motion import bvh, sources


@pytest.fixture
def clip(walker_files):
    return sources.load(walker_files / "straight.bvh")


def test_sound_clips_get_no_remark(walker_database):
    assert suspects.contacts(walker_database) == []


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
