"""lmm.mann.frames: what is its own beside other frames of locomotion: the speed wanted; its statistics."""

from __future__ import annotations

import lmm_models
import numpy as np

from lmm.locomotion.labelling import labels_of
from lmm.locomotion.statistics import joint_weights, statistics
from lmm.mann.frames import frames, wanted_speeds
from lmm.mann.layout import Layout


def test_the_speed_wanted_is_that_of_the_second_to_come() -> None:
    """Two seconds of standing, then two at 1.5 m/s round a corner, at 10 frames a second."""
    steps_ = np.zeros((40, 2))
    steps_[20:30, 0] = steps_[30:, 1] = 0.15
    speeds = wanted_speeds(np.cumsum(steps_, axis=0), 10.0)
    np.testing.assert_allclose(speeds[:10], 0)
    np.testing.assert_allclose(speeds[9:20], 0.15 * np.arange(11), atol=1e-6)
    np.testing.assert_allclose(speeds[19:], 1.5, rtol=1e-6)


def test_joints_count_as_much_as_the_trajectory() -> None:
    database = lmm_models.database()
    labels = labels_of(database, phase=False)
    found, layout = frames(database, labels), Layout(len(database.skeleton) - 1, len(labels.names))
    weights = joint_weights(database.skeleton)
    stats = statistics(found.x, found.y, layout, weights, joint_scale=1.0)
    for block in ("positions", "rotations", "velocities", "speeds"):
        spread = found.x[:, layout.inputs[block]].std(axis=0).mean()
        np.testing.assert_allclose(stats["input_std"][layout.inputs[block]], spread, rtol=1e-3)
    going = layout.inputs["going"]
    for half in (slice(going.start, going.start + 12), slice(going.start + 12, going.stop)):
        np.testing.assert_allclose(stats["input_std"][half], found.x[:, half].std(axis=0).mean(), rtol=1e-3)
    less = statistics(found.x, found.y, layout, weights, joint_scale=0.1)
    ratio = less["input_std"] / stats["input_std"]
    np.testing.assert_allclose(ratio, np.where(np.arange(len(ratio)) < 156, 1, 10), rtol=1e-5)
    weights[2] = 0
    unseen = statistics(found.x, found.y, layout, weights, joint_scale=1.0)["input_std"][
        layout.inputs["rotations"]
    ]
    assert (unseen.reshape(-1, 6)[2] > 1e6).all() and (unseen.reshape(-1, 6)[3] < 1e3).all()
