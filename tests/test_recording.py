"""Recordings: of a point that does what it is asked, so that everything in them is known."""

from __future__ import annotations

import numpy as np
import pytest

from mm import courses
from mm.control import Command
from mm.course import Course, VelocityKey, Waypoint
from mm.driver import Driver
from mm.recording import KIND, VERSION, Recorder, Recording, record
from motion import files, quat
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton


class Point:
    """A system of one joint that goes where it is told at once."""

    name = "point"
    skeleton = Skeleton(("root",), np.array([-1]), np.zeros((1, 3)), {"root": 0})

    def __init__(self, count: int = 1, fps: float = 60.0) -> None:
        self.count, self.fps = count, fps
        self.poses = Poses.empty(count, 1)

    def reset(self, positions, yaws) -> None:
        self.poses = Poses.empty(self.count, 1)
        self.poses.positions[:, 0, [0, 2]] = positions
        self.poses.rotations[:, 0] = quat.from_yaw(yaws)
        self.steps = 0

    def step(self, command: Command) -> Poses:
        self.poses.positions[:, 0, [0, 2]] += command.velocity / np.float32(self.fps)
        self.poses.rotations[:, 0] = quat.from_yaw(command.yaw)
        self.steps += 1
        return self.poses

    def record(self) -> dict:
        # A transition at every seventh step, and a counter.
        flag, steps = np.full(self.count, self.steps % 7 == 0), np.full(self.count, self.steps, np.int32)
        return {"transition": flag, "frame": steps}

    def memory(self) -> dict[str, int]:
        return {}


class TimedPoint(Point):
    timed = True

    @property
    def settings(self) -> dict[str, float]:
        return {"speed": 1.0}

    @property
    def stage_seconds(self) -> dict[str, float]:
        return {"thinking": 1e-6 * self.steps, "going": 2e-6}


LINE = Course(
    name="line",
    waypoints=(Waypoint(position=(1, 0), speed=2.0, radius=0.01), Waypoint(position=(1, 6), speed=2.0)),
)


def test_a_run_records_what_was_asked_and_done():
    recording = record(Point(2), courses.load("circle"))
    frames = len(recording)
    assert recording["positions"].shape == (frames, 2, 1, 3) and recording["rotations"].shape == (
        frames,
        2,
        1,
        4,
    )
    assert recording["command_velocity"].shape == (frames, 2, 2)
    positions, yaws = recording.roots()
    np.testing.assert_allclose(np.diff(positions, axis=0) * 60, recording["command_velocity"][1:], atol=1e-3)
    np.testing.assert_allclose(yaws, recording["command_yaw"], atol=1e-5)
    np.testing.assert_array_equal(recording["frame"][:, 0], np.arange(1, frames + 1))
    assert recording.system == "point" and recording.count == 2 and recording.fps == 60
    assert recording.seconds == frames / 60 and recording.step_seconds.shape == (frames,)
    assert (recording.step_seconds > 0).all()


def test_it_starts_at_the_courses_start_and_ends_when_all_have_arrived():
    recording = record(Point(), LINE)
    positions, _ = recording.roots()
    np.testing.assert_allclose(positions[0, 0], (1, 2 / 60), atol=1e-5)
    assert np.linalg.norm(positions[-1, 0] - (1, 6)) < 0.75
    assert 2.6 < recording.seconds < Driver(LINE).nominal + 1
    np.testing.assert_allclose(recording.path, [(1, 0), (1, 6)])


def test_a_script_is_as_long_as_it_says():
    course = Course(velocity=(VelocityKey(time=0, velocity=(0, 1)),), seconds=1.5, laps=2)
    recording = record(Point(fps=30.0), course)
    assert len(recording) == 90 and recording.path is None
    assert len(record(Point(), course, seconds=0.5)) == 30
    assert len(record(Point(), course, seconds=99)) == 180


def test_every_so_manieth_frame_keeps_what_happened_in_between():
    whole, thin = record(Point(), LINE, seconds=2), record(Point(), LINE, seconds=2, every=4)
    assert len(thin) == 30 and thin.fps == 15
    np.testing.assert_array_equal(thin["positions"], whole["positions"][::4])
    # Steps 7, 14, 21, ... are 0-based frames 6, 13, 20, ...; each shows at the next kept frame.
    expected = np.zeros(30, bool)
    expected[[-(-frame // 4) for frame in range(6, 117, 7)]] = True
    np.testing.assert_array_equal(thin["transition"][:, 0], expected)


def test_the_first_characters_only():
    recording = record(Point(9), courses.load("random"), seconds=0.5, characters=2, spread=True)
    assert recording.count == 2 and recording["frame"].shape == (30, 2)
    whole = record(Point(9), courses.load("random"), seconds=0.5, spread=True)
    np.testing.assert_array_equal(recording["positions"], whole["positions"][:, :2])


def test_stages_of_a_timed_system():
    recording = record(TimedPoint(), LINE, seconds=1)
    assert recording.stages == ("thinking", "going") and recording.settings == {"speed": 1.0}
    np.testing.assert_allclose(recording.stage_seconds[:, 0], 1e-6 * np.arange(1, 61))
    np.testing.assert_allclose(recording.stage_seconds[:, 1], 2e-6)
    assert record(Point(), LINE, seconds=1).stage_seconds.shape == (60, 0)


def test_recording_twice_gives_the_same():
    system = Point(3)
    one = record(system, courses.load("random"), seconds=5, spread=True)
    two = record(system, courses.load("random"), seconds=5, spread=True)
    for name, array in one.arrays.items():
        np.testing.assert_array_equal(array, two[name])


def test_a_file_gives_back_what_was_saved(tmp_path):
    recording = record(TimedPoint(2), courses.load("thesis").scaled(walk=1.4, run=3), seconds=2)
    path = tmp_path / "run.rec"
    fingerprint = recording.save(path)
    again = Recording.load(path)
    assert again.save(tmp_path / "copy.rec") == fingerprint
    assert again.arrays.keys() == recording.arrays.keys()
    for name, array in recording.arrays.items():
        np.testing.assert_array_equal(again[name], array)
        assert again[name].dtype == array.dtype
    np.testing.assert_array_equal(again.path, recording.path)
    np.testing.assert_array_equal(again.stage_seconds, recording.stage_seconds)
    for name in ("system", "fps", "course", "settings", "schema", "database", "stages"):
        assert getattr(again, name) == getattr(recording, name)
    assert again.skeleton.names == ("root",)


def test_a_damaged_file(tmp_path):
    path = tmp_path / "run.rec"
    record(Point(), LINE, seconds=1).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match=r"run\.rec"):
        Recording.load(path)
    flipped = bytearray(whole)
    flipped[-5] ^= 1
    path.write_bytes(flipped)
    with pytest.raises(UserError, match="checksum"):
        Recording.load(path)


def test_a_clip_is_one_characters_motion():
    recording = record(Point(2), courses.load("circle"), spread=True, seconds=5)
    clip = recording.clip(1)
    assert len(clip) == len(recording) and clip.fps == 60 and clip.name == "circle_1"
    np.testing.assert_array_equal(clip.positions[:, 0], recording["positions"][:, 1, 0])
    np.testing.assert_allclose(np.linalg.norm(clip.rotations, axis=-1), 1, rtol=1e-12)
    assert (np.sum(clip.rotations[1:] * clip.rotations[:-1], axis=-1) > 0).all()
    with pytest.raises(UserError, match="no character 2; the recording has 2"):
        recording.clip(2)


@pytest.mark.parametrize("options", [{"seconds": 0}, {"seconds": np.nan}, {"every": 0}, {"characters": 0}])
def test_a_run_of_nothing(options):
    with pytest.raises(UserError, match="give"):
        record(Point(), LINE, **options)


def test_a_loop_of_ones_own_is_recorded(tmp_path):
    system = Point(2)
    system.reset(np.zeros((2, 2), np.float32), np.zeros(2, np.float32))
    recorder, command = Recorder(system, frames=9, every=2, characters=1), Command.still(2)
    for frame in range(5):
        command.velocity[:] = (0, frame)
        recorder.take(command, system.step(command), seconds=frame + 1)
    recorder.finish().save(tmp_path / "own.rec")
    recording = Recording.load(tmp_path / "own.rec")
    assert recording.course is None and recording.path is None and recording.system == "point"
    assert recording.fps == 30 and recording.count == 1 and recording.clip().name == "run_0"
    np.testing.assert_array_equal(recording["command_velocity"][:, 0, 1], [0, 2, 4])
    np.testing.assert_allclose(recording["positions"][:, 0, 0, 2] * 60, [0, 3, 10], atol=1e-4)
    np.testing.assert_array_equal(recording.step_seconds, [1, 3, 5])


def test_a_recorder_takes_as_many_steps_as_it_was_made_for():
    system, still = Point(), Command.still(1)
    system.reset(np.zeros((1, 2), np.float32), np.zeros(1, np.float32))
    recorder = Recorder(system, frames=1)
    with pytest.raises(ValueError, match="nothing was recorded"):
        recorder.finish()
    recorder.take(still, system.step(still))
    with pytest.raises(ValueError, match="more steps than the 1"):
        recorder.take(still, system.step(still))
    assert len(recorder.finish()) == 1


@pytest.mark.parametrize(
    "edit",
    [
        lambda m, a: m.pop("system"),
        lambda m, a: m.update(course={"name": "none"}),
        lambda m, a: m.update(stages=["one"]),
        lambda m, a: a.pop("positions"),
        lambda m, a: a.update(rotations=a["rotations"][..., :3]),
        lambda m, a: a.update(frame=a["frame"][1:]),
        lambda m, a: a.update(path=np.zeros(4)),
    ],
)
def test_foreign_content_under_a_right_checksum_is_refused(tmp_path, edit):
    record(Point(2), courses.load("circle"), seconds=0.5).save(tmp_path / "tape")
    metadata, arrays, _ = files.load(tmp_path / "tape", KIND, VERSION)
    assert Recording.load(tmp_path / "tape").count == 2
    edit(metadata, arrays)
    del metadata["format"], metadata["version"]
    files.save(tmp_path / "other", KIND, VERSION, metadata, arrays)
    with pytest.raises(UserError, match="other: damaged recording"):
        Recording.load(tmp_path / "other")
