"""What a prompt shows of large things: a line."""

from __future__ import annotations

import numpy as np

from mm.course import Course, VelocityKey
from mm.recording import Recording
from motion import sources


def test_a_line_says_what_and_how_large(walker_files, walker_database):
    clip = sources.load(walker_files / "run.bvh")
    assert repr(clip) == "Clip('run', 300 frames at 60 fps, 22 joints)"
    assert repr(clip.skeleton) == f"Skeleton(22 joints under 'Hips', {len(clip.skeleton.roles)} roles)"
    database = walker_database
    assert repr(database) == "Database(3000 frames in 10 ranges at 60 fps, 23 joints, schema 'mm27')"
    arrays = {"positions": np.zeros((7, 2, 22, 3)), "rotations": np.zeros((7, 2, 22, 4))}
    recording = Recording("point", clip.skeleton, 30.0, arrays)
    assert repr(recording) == "Recording('point', 7 frames at 30 fps, 2 x 22 joints, course None)"
    recording.course = Course(name="ahead", velocity=(VelocityKey(time=0, velocity=(0, 1)),), seconds=1)
    assert repr(recording).endswith("course 'ahead')")
