"""viewer.controls and viewer.gamepad: left is left behind any camera; pads as Linux tells of them."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import lmm_models
import numpy as np
import pytest

from mm import courses
from mm.control import Command
from mm.controller import Controller
from mm.description import Description
from mm.driving import at_data_speeds
from mm.recording import record
from mm.speeds import Speeds
from motion import console, springs
from viewer import controls
from viewer.controls import Again, Hands, Stick, of_keys, on_course, speeds_of
from viewer.gamepad import AXIS, BUTTON, EVENT, Gamepad
from viewer.session import Session

HERE = np.zeros((1, 2), np.float32)


def held(stick: Stick, *, seconds: float = 2.0, yaw: float = 0.0) -> Command:
    """What is asked after the hands were held so for a while."""
    for frame in range(1, round(60 * seconds) + 1):
        command = stick.command(frame / 60, HERE, np.array([yaw], np.float32))
    return command


def heading(command: Command) -> float:
    return float(np.degrees(np.arctan2(*command.velocity[0])))


@pytest.mark.parametrize("camera", [0.0, 90.0, 180.0, -60.0])
@pytest.mark.parametrize(
    ("keys", "angle"), [("W", 0), ("A", 90), ("S", 180), ("D", -90), ("WA", 45), ("SD", -135)]
)
def test_keys_lead_where_they_point_behind_any_camera(camera: float, keys: str, angle: float) -> None:
    stick = Stick()
    stick.camera_yaw = np.radians(camera)
    stick.hands = of_keys(keys)
    command = held(stick, yaw=np.radians(camera + angle))
    wanted = camera + angle  # left of +Z is +X: yaws grow to the left
    assert np.cos(np.radians(heading(command) - wanted)) == pytest.approx(1, abs=1e-4)
    assert np.cos(command.yaw[0] - np.radians(wanted)) == pytest.approx(1, abs=1e-4)
    assert np.linalg.norm(command.velocity[0]) == pytest.approx(Speeds().walk[0], rel=1e-3)


def test_keys_add_up_and_cancel_out() -> None:
    assert of_keys(()) == of_keys(("W", "S", "A", "D")) == of_keys(["F13"]) == Hands()
    assert of_keys(("W", "UP")).move == (0, 1)
    assert np.hypot(*of_keys(("W", "D")).move) == pytest.approx(1)
    assert of_keys(("SHIFT", "CTRL", "C")) == Hands(run=True, strafe=True, crouch=True)
    assert of_keys(("Q",)).turn == -of_keys(("E",)).turn == 1
    assert all(binding.about for binding in controls.KEYS.values())


def test_who_strafes_faces_where_the_camera_looks_and_is_slower_aside() -> None:
    stick = Stick()
    stick.camera_yaw = 0.5
    stick.hands = of_keys(("A", "CTRL"))
    command = held(stick, yaw=0.5)
    assert command.yaw[0] == pytest.approx(0.5)
    assert heading(command) == pytest.approx(np.degrees(0.5) + 90, abs=0.1)
    assert np.linalg.norm(command.velocity[0]) == pytest.approx(Speeds().walk[1], rel=1e-3)


def test_running_crouching_and_letting_go() -> None:
    stick = Stick()
    stick.hands = of_keys(("W", "SHIFT"))
    assert np.linalg.norm(held(stick).velocity[0]) == pytest.approx(Speeds().run[0], rel=1e-3)
    stick.reset()
    stick.hands = of_keys(("W", "SHIFT", "C"))
    command = held(stick)
    assert command.crouch[0] and np.linalg.norm(command.velocity[0]) == pytest.approx(
        Speeds().walk[0], rel=1e-3
    )
    stick.hands = Hands()
    held(stick, seconds=3.0)
    stick.camera_yaw = 2.0
    command = held(stick, seconds=4.0)
    assert not command.crouch[0]
    assert np.linalg.norm(command.velocity[0]) == 0
    assert command.yaw[0] == pytest.approx(0)  # as it was last asked for


def test_a_stick_takes_time_as_long_at_any_rate() -> None:
    seen = []
    for rate in (30, 60, 240):
        stick = Stick()
        stick.hands = of_keys("W")
        speeds = [
            float(stick.command(k / rate, HERE, np.zeros(1, np.float32)).velocity[0, 1])
            for k in range(1, rate // 5 + 1)
        ]
        assert (np.diff(speeds) >= 0).all() and speeds[0] < 0.9 * speeds[-1]
        seen.append(speeds[rate // 30 - 1 :: rate // 30])
    np.testing.assert_allclose(seen[1], seen[0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(seen[2], seen[0], rtol=1e-5, atol=1e-6)


def test_the_camera_turns_and_says_how_fast() -> None:
    stick = Stick()
    stick.hands = Hands(move=(0, 1), turn=1.0)
    command = held(stick, seconds=0.5)
    assert stick.camera_yaw == pytest.approx(controls.TURN * 0.5)
    assert command.turn_rate[0] == pytest.approx(controls.TURN)


def test_all_are_asked_the_same() -> None:
    stick = Stick(3, starts=[[0, 0], [1, 0], [2, 0]])
    stick.hands = of_keys("W")
    command = stick.command(1.0, np.zeros((3, 2)), np.array([0.1, 1.0, 2.0], np.float32))
    assert len(command) == 3 and (command.velocity == command.velocity[0]).all()
    np.testing.assert_array_equal(stick.starts[:, 0], [0, 1, 2])


def test_both_hands_together() -> None:
    pad, keys = Hands(move=(0.3, 0.1), turn=-0.5), Hands(move=(0, 1), run=True)
    assert pad | keys == Hands(move=(0, 1), turn=-0.5, run=True)
    assert (Hands() | pad).move == (0.3, 0.1)


def test_a_stick_goes_as_fast_as_the_data() -> None:
    description = Description.of(lmm_models.database(), rigs=False)
    speeds = speeds_of(description)
    assert speeds.walk[0] == pytest.approx(description.walk_mps) == pytest.approx(1.2, abs=0.1)
    assert speeds.run[0] == pytest.approx(description.run_mps)
    assert speeds.walk[1] / speeds.walk[0] == pytest.approx(1.5 / 1.75)


def test_a_character_goes_where_the_keys_say() -> None:
    data = lmm_models.database()
    stick = Stick(speeds=speeds_of(Description.of(data, rigs=False)))
    session = Session({"mm": Controller(data)}, stick)
    stick.hands = of_keys("A")
    for _ in range(16):
        session.advance(0.25)
    places, yaws = session.places()
    assert places[0, 0] > 2.5 and abs(places[0, 1]) < 1.5  # left is +X
    assert np.degrees(springs.wrap(yaws[0] - np.pi / 2)) == pytest.approx(0, abs=30)


def test_an_earlier_run_is_asked_again() -> None:
    data = lmm_models.database()
    course = at_data_speeds(courses.load("random"), data)
    controller = Controller(data)
    run = record(controller, course, seconds=2.0, progress=console.silent)
    session = Session({"mm": Controller(data)}, Again(run))
    for _ in range(20):
        session.advance(0.1)
    stack = session.actors["mm"].timeline.stack
    np.testing.assert_array_equal(stack("command_velocity")[1:121], run["command_velocity"][:, 0])
    np.testing.assert_allclose(stack("positions")[1:121, 0], run["positions"][:, 0, 0], atol=0.5)
    session.advance(0.2)
    assert (session.actors["mm"].timeline.stack("command_velocity")[-1] == 0).all()


def test_a_course_goes_on() -> None:
    course = courses.load("square")
    driver = on_course(course, 2)
    assert driver.limit > 20 * driver.nominal / controls.LAPS
    assert driver.starts.shape == (2, 2)
    there = driver.remember()
    once = driver.command(0.0, driver.starts, driver.yaws)
    driver.command(1.0, driver.starts + 1, driver.yaws)
    driver.recall(there)
    again = driver.command(0.0, driver.starts, driver.yaws)
    np.testing.assert_array_equal(once.velocity, again.velocity)


@pytest.fixture
def pad(tmp_path: Path):
    """A pipe that stands for a pad, and what writes events to it: (type, number, value)."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    reader = Gamepad(str(tmp_path / "js*"), clock=lambda: pad_clock[0])
    writer = os.open(path, os.O_WRONLY)

    def send(*events: tuple[int, int, int]) -> None:
        os.write(writer, b"".join(EVENT.pack(0, value, kind, number) for kind, number, value in events))

    yield reader, send, writer
    reader.close()


pad_clock = [0.0]


def test_a_pads_sticks_and_buttons(pad) -> None:
    reader, send, _ = pad
    assert reader.state.startswith("gamepad ")
    assert reader.hands() == Hands()
    send((AXIS | 0x80, 0, 0), (AXIS | 0x80, 2, -32767), (AXIS | 0x80, 5, -32767), (BUTTON | 0x80, 0, 0))
    assert reader.hands() == Hands()
    send((AXIS, 0, -32767), (AXIS, 1, -16384))
    assert reader.hands().move == pytest.approx((-1, 0.5), abs=1e-3)  # left and ahead
    send((AXIS, 0, 0), (AXIS, 1, 0), (AXIS, 7, -32767))
    assert reader.hands().move == (0, 1)  # the cross
    send((AXIS, 3, 32767), (AXIS, 4, 3000), (AXIS, 5, 32767), (AXIS, 2, 32767), (BUTTON, 1, 1))
    assert reader.hands() == Hands((0.0, 1.0), turn=-1.0, run=True, strafe=True, crouch=True)
    send((AXIS, 5, -32767), (BUTTON, 0, 1), (BUTTON, 1, 0))
    hands = reader.hands()
    assert hands.run and not hands.crouch


def test_an_event_may_come_in_pieces(pad) -> None:
    reader, _, writer = pad
    event = EVENT.pack(0, 32767, AXIS, 0)
    os.write(writer, event[:3])
    assert reader.hands().move[0] == 0
    os.write(writer, event[3:])
    assert reader.hands().move[0] == 1


def test_a_pad_that_is_pulled_out_is_let_go_of_and_found_again(pad, tmp_path: Path) -> None:
    reader, send, writer = pad
    send((AXIS, 0, 32767))
    assert reader.hands().move[0] == 1
    os.close(writer)
    assert reader.hands() == Hands()
    assert reader.state == "no gamepad"
    reader.hands()
    assert reader.state == "no gamepad"  # it looks once a second
    pad_clock[0] += 2
    reader.hands()
    # A pipe without a writer ends at once: the pad was found, and is gone again.
    assert reader.state == "no gamepad"
    again = os.open(tmp_path / "js0", os.O_RDWR)
    os.write(again, EVENT.pack(0, 32767, BUTTON | 0x80, 1))
    pad_clock[0] += 2
    assert reader.hands() == Hands(crouch=True)  # nothing of what was held before
    assert reader.state.startswith("gamepad ")
    os.close(again)


def test_a_pad_whose_driver_says_that_it_is_gone_is_let_go_of(pad, monkeypatch: pytest.MonkeyPatch) -> None:
    reader, send, _ = pad
    send((BUTTON, 1, 1))
    assert reader.hands().crouch

    def gone(*_: int) -> bytes:
        raise OSError(errno.ENODEV, "No such device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "read", gone)
        assert reader.hands() == Hands()
    assert reader.state == "no gamepad"


def test_sticks_that_do_not_come_back_to_their_middle_ask_for_nothing(pad) -> None:
    reader, send, _ = pad
    send(*((AXIS, number, 4000) for number in (0, 1, 3, 4)))
    hands = reader.hands()
    assert (hands.turn, hands.tilt) == (0, 0)
    stick = Stick(halflife=0.0)
    stick.hands = hands
    assert not stick.command(1.0, HERE, np.zeros(1)).velocity.any()
    send((AXIS, 1, -32767), (AXIS, 3, 6554 + 13107))
    stick.hands = reader.hands()
    assert np.linalg.norm(stick.command(2.0, HERE, np.zeros(1)).velocity) > 1
    assert reader.hands().turn == pytest.approx(-0.5, abs=1e-3)  # of what is left beyond the first fifth


def test_no_pad_is_no_error(tmp_path: Path) -> None:
    reader = Gamepad(str(tmp_path / "js*"))
    assert (reader.state, reader.hands()) == ("no gamepad", Hands())
    (tmp_path / "js0").mkdir()
    assert Gamepad(str(tmp_path / "js*")).hands() == Hands()
