"""Any rate to any rate: against functions of time whose values are known everywhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from motion import quat, resample
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton

SKELETON = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
AXIS = np.array([0.0, 0.6, 0.8])


def place(time):
    return np.stack([np.sin(2 * time), 0.2 * time**2, np.cos(3 * time)], axis=-1)


def clip_at(fps, frames):
    """Smooth travel, a joint of constant offset, and a steady turn, which slerp follows exactly."""
    time = np.arange(frames) / fps
    positions = np.stack([place(time), np.broadcast_to([0.0, 1.0, 0.0], (frames, 3))], axis=1)
    rotations = np.stack([quat.from_axis_angle(AXIS, 2 * time), quat.identity(frames)], axis=1)
    return Clip("c", SKELETON, fps, positions, rotations)


@pytest.mark.parametrize(
    ("rate", "fps"), [(30, 60), (60, 29.97), (120, 100), (100, 60), (59.94, 23.976), (60, 47.3), (25, 240)]
)
def test_any_rate_to_any_rate(rate, fps):
    out = resample.resample(clip_at(rate, 200), fps)
    assert out.fps == fps
    time = np.arange(len(out)) / fps
    end = 199 / rate
    assert time[-1] <= end + 1e-6 and end - time[-1] < 1 / fps
    np.testing.assert_allclose(out.positions[:, 0], place(time), atol=2e-5 * max(1, (60 / rate) ** 4))
    np.testing.assert_array_equal(out.positions[:, 1], np.broadcast_to([0.0, 1.0, 0.0], (len(out), 3)))
    assert quat.angle_between(out.rotations[:, 0], quat.from_axis_angle(AXIS, 2 * time)).max() < 1e-9
    np.testing.assert_allclose(np.linalg.norm(out.rotations, axis=-1), 1, atol=1e-12)


def test_the_same_rate_returns_the_clip():
    clip = clip_at(60.0, 10)
    assert resample.resample(clip, 60.0) is clip


@pytest.mark.parametrize("rate", [119.99, 120.0, 120.005])
def test_half_the_rate_keeps_every_second_frame(rate):
    clip = clip_at(rate, 11)
    out = resample.resample(clip, 60)
    np.testing.assert_array_equal(out.positions, clip.positions[::2])
    np.testing.assert_array_equal(out.rotations, clip.rotations[::2])
    assert out.fps == 60 and len(out) == 6


def test_twice_the_rate_keeps_the_frames_it_had():
    clip = clip_at(30, 7)
    out = resample.resample(clip, 60)
    assert len(out) == 13
    np.testing.assert_allclose(out.positions[::2], clip.positions, atol=1e-12)
    assert quat.angle_between(out.rotations[::2], clip.rotations).max() < 1e-12


def test_a_rate_that_differs_by_the_header_rounding_only_is_renamed():
    clip = clip_at(59.999, 20)
    out = resample.resample(clip, 60)
    assert out.fps == 60 and len(out) == 20
    np.testing.assert_array_equal(out.positions, clip.positions)


def test_there_and_back():
    clip = clip_at(60, 121)
    back = resample.resample(resample.resample(clip, 240), 60)
    np.testing.assert_allclose(back.positions, clip.positions, atol=1e-9)


def test_rotations_are_those_of_scipy():
    random = np.random.default_rng(3)
    turns = quat.normalize(random.normal(size=(20, 4)))
    rotations = np.stack([turns, turns[::-1]], axis=1)
    clip = Clip("c", SKELETON, 30, np.zeros((20, 2, 3)), rotations)
    out = resample.resample(clip, 47.3)
    time = np.arange(len(out)) / 47.3
    truth = Slerp(np.arange(20) / 30, Rotation.from_quat(turns[:, [1, 2, 3, 0]]))(time).as_quat()[
        :, [3, 0, 1, 2]
    ]
    assert quat.angle_between(out.rotations[:, 0], truth).max() < 1e-7


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
@pytest.mark.parametrize("method", ["cubic", "linear"])
def test_very_short_clips(frames, method):
    for fps in (12.5, 30, 100):
        out = resample.resample(clip_at(30.0, frames), fps, method=method)
        assert (len(out) == 0) == (frames == 0)
        assert np.isfinite(out.positions).all()


def test_linear():
    clip = clip_at(30, 5)
    out = resample.resample(clip, 60, method="linear")
    np.testing.assert_allclose(
        out.positions[1::2, 0], (clip.positions[1:, 0] + clip.positions[:-1, 0]) / 2, atol=1e-12
    )


def test_crop():
    clip = clip_at(30, 10)
    np.testing.assert_array_equal(resample.crop(clip, 2, 5).positions, clip.positions[2:5])
    assert len(resample.crop(clip)) == 10 and len(resample.crop(clip, 9)) == 1
    for start, stop in ((5, 5), (7, 3), (0, 11), (-1, 4), (10, None)):
        with pytest.raises(UserError, match="it has 10 frames"):
            resample.crop(clip, start, stop)


def test_bad_arguments():
    for fps in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="frame rate"):
            resample.resample(clip_at(30, 5), fps)
    with pytest.raises(ValueError, match="cubic or linear"):
        resample.resample(clip_at(30, 5), 60, method="nearest")


def test_a_rate_that_would_fill_the_memory_is_refused(walker):
    with pytest.raises(UserError, match="at most 10,000,000 fit"):
        resample.resample(walker.replace(fps=1e-3), 60.0)
