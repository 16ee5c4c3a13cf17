"""Courses that a user took before: logs of the public reference, recordings of runs, tables of keys."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from mm import courses, recorded
from mm.control import Command
from mm.course import StickKey, VelocityKey
from mm.driver import Driver
from mm.recording import Recorder
from motion import quat
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

ORIGIN = np.zeros((1, 2)), np.zeros(1)


def log(path, velocities, yaws, *, cut=None):
    """A log as the public reference writes it (five arrays, each after its length)."""
    zeros = [[0.0] * 3] * len(velocities)
    turns = [[np.cos(yaw / 2), 0, np.sin(yaw / 2), 0] for yaw in yaws]
    ways = [[x, 0.0, z] for x, z in velocities]
    data = b""
    for array in (zeros, ways, zeros, turns, zeros):
        data += struct.pack("<i", len(array)) + np.array(array, "<f4").tobytes()
    path.write_bytes(data[:cut])
    return path


def test_a_log_asks_at_every_frame_what_it_holds(tmp_path):
    time = np.arange(120) / 60
    velocities = np.column_stack([np.sin(time), 1 + time])
    yaws = 3 * np.cos(time)
    course = courses.load(log(tmp_path / "mine.bin", velocities, yaws))
    assert course.name == "mine" and course.seconds == 2 and len(course.velocity) == 120
    driver = Driver(course, fps=60.0)
    for frame in (0, 1, 57, 118):
        command = driver.command(frame / 60, *ORIGIN)
        np.testing.assert_allclose(command.velocity[0], velocities[frame], rtol=1e-5)
        assert command.yaw[0] == pytest.approx(yaws[frame], abs=1e-4)


@pytest.mark.parametrize(("fastest", "gait"), [(1.9, "walk"), (3.0, "run")])
def test_all_of_a_log_is_a_walk_or_a_run_so_that_it_scales_as_one(tmp_path, fastest, gait):
    velocities = np.column_stack([np.zeros(90), np.linspace(0, fastest, 90)])
    course = courses.load(log(tmp_path / "mine.bin", velocities, np.zeros(90)))
    assert {key.gait for key in course.velocity} == {gait}
    half = course.scaled(**{gait: fastest / 2})
    assert [key.speed for key in half.velocity] == pytest.approx(velocities[:, 1] / 2, abs=1e-6)


def test_who_asks_for_the_same_needs_one_key():
    course = recorded.of_velocities([[0, 1]] * 5 + [[0, 2]] * 5, [0.5] * 10, 10.0)
    assert [key.time for key in course.velocity] == [0, 0.5] and course.seconds == 1


@pytest.mark.parametrize("name, seconds, fast", [("run", 104.4, 3.94), ("walk", 152.45, 2.0)])
def test_the_reference_s_own_logs(data, name, seconds, fast):
    course = courses.load(data / "reference" / "orangeduck" / f"simulation_{name}.bin")
    assert course.seconds == pytest.approx(seconds) and course.velocity[0].gait == name
    assert max(key.speed for key in course.velocity) == pytest.approx(fast, abs=0.01)


def test_the_velocities_of_the_reference_s_logs_are_the_rates_of_their_positions(data):
    """So the arrays are taken for what they are."""
    path = data / "reference" / "orangeduck" / "simulation_run.bin"
    count = int(np.fromfile(path, "<i4", 1)[0])
    positions = np.frombuffer(path.read_bytes()[4 : 4 + 12 * count], "<f4").reshape(-1, 3)
    driver = Driver(courses.load(path), fps=60.0)
    asked = np.array([driver.command(t / 60, *ORIGIN).velocity[0] for t in range(count)])
    walked = np.cumsum(asked, axis=0) / 60
    way = positions[:, [0, 2]]
    assert np.abs(walked - way).max() < 0.01 * np.abs(np.diff(way, axis=0)).sum()


@pytest.mark.parametrize("cut", [2, 100, -1])
def test_a_damaged_log(tmp_path, cut):
    path = log(tmp_path / "cut.bin", np.ones((9, 2)), np.zeros(9), cut=cut)
    with pytest.raises(UserError, match="log of a simulated character, or cut short"):
        courses.load(path)


def test_a_log_that_turns_by_no_rotation_or_goes_nowhere_finite(tmp_path):
    path = log(tmp_path / "bad.bin", np.full((9, 2), np.nan), np.zeros(9))
    with pytest.raises(UserError, match="not all finite"):
        courses.load(path)
    data = bytearray(log(path, np.ones((9, 2)), np.zeros(9)).read_bytes())
    data[4 * 4 + 9 * 36 : 4 * 4 + 9 * 36 + 4] = np.float32(7).tobytes()
    path.write_bytes(data)
    with pytest.raises(UserError, match="unit quaternions"):
        courses.load(path)


class Point:
    """A system of one joint that goes where it is told at once."""

    name, fps, count = "point", 30.0, 2
    skeleton = Skeleton(("root",), np.array([-1]), np.zeros((1, 3)), {"root": 0})

    def record(self):
        return {}


def test_what_a_recorded_run_was_asked_is_asked_again(tmp_path):
    recorder, rng = Recorder(Point(), frames=40), np.random.default_rng(0)
    asked = rng.uniform(-1, 1, (40, 2, 2)).astype(np.float32)
    for t in range(40):
        command = Command.still(2)
        command.velocity[:], command.yaw[:], command.crouch[:] = asked[t], 0.1 * t, t >= 20
        poses = Poses.empty(2, 1)
        poses.rotations[:, 0] = quat.from_yaw(command.yaw)
        recorder.take(command, poses)
    recorder.finish().save(tmp_path / "lap.rec")
    course = courses.load(tmp_path / "lap.rec")
    assert course.name == "lap" and course.seconds == pytest.approx(40 / 30)
    driver = Driver(course, fps=30.0)
    for t in (0, 11, 20, 37):
        command = driver.command(t / 30, *ORIGIN)
        np.testing.assert_allclose(command.velocity[0], asked[t, 0], rtol=1e-5)
        assert command.yaw[0] == pytest.approx(np.remainder(0.1 * t + np.pi, 2 * np.pi) - np.pi, abs=1e-4)
        assert command.crouch[0] == (t >= 20)


def test_a_table_is_a_stick_s_script_or_a_velocity_s(tmp_path):
    path = tmp_path / "keys.csv"
    path.write_text("time, move_x, move_z, strafe, gait\n0,0,1,,\n\n2,0.5,-0.5,true,run\n4,0,0,,\n")
    course = courses.load(path)
    assert course.name == "keys" and course.seconds == 6
    assert course.stick == (
        StickKey(time=0, move=(0, 1)),
        StickKey(time=2, move=(0.5, -0.5), strafe=True, gait="run"),
        StickKey(time=4),
    )
    path.write_text("time,velocity_x,velocity_z,facing_x,facing_z\n0,1,2,,\n1,1,2,0,-1\n")
    assert courses.load(path).velocity == (
        VelocityKey(time=0, velocity=(1, 2)),
        VelocityKey(time=1, velocity=(1, 2), facing=(0, -1)),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no keys"),
        ("time,move_x,move_z\n", "no keys"),
        ("time,move_x,move_z\n0,0,1\n2,0,x\n", r":3: move\[1\]: expected a number, found 'x'"),
        ("time,move_x,move_z\n0,0,1\n\n2,0\n", ":4: 2 cells under 3 headers"),
        ("time,move_x,move_z\n0,0,1\n2,0,2\n", ":3: move: tilt"),
        ("time,move_x,move_z,tilt\n0,0,1,3\n", ":2: tilt: unknown key; choose from time, move"),
        ("time,velocity_x,velocity_z\n1,0,1\n", ":2: time: 1.0; the first key's time is 0"),
        ("time,velocity_x,velocity_z\n0,0,1\n0,0,1\n", ":3: time: 0.0 after 0.0"),
        ("time,velocity_x\n0,1\n", r":2: velocity: expected 2 values"),
        ("time,velocity_x,velocity_z\n0,0,1\n2,,\n", ":3: velocity: missing key"),
        ("time,velocity_x,velocity_z\nsoon,0,1\n", ":2: time: expected a number"),
        ("time,velocity_x,velocity_z,gait\n0,0,1,trot\n", ":2: gait: 'trot' is no choice"),
    ],
)
def test_faults_of_a_table_name_the_line(tmp_path, text, message):
    path = tmp_path / "keys.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        courses.load(path)
    assert str(path) in str(caught.value)
