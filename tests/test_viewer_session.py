"""viewer.session and viewer.live: time, whatever the screen's rate; who steps when; going back; slow ones."""

from __future__ import annotations

import dataclasses
import threading
import time
from typing import Any

import lmm_models
import numpy as np
import pytest
from locomotion_models import CONTROLLERS, MODELS

from lmm import controller as controllers
from mm import courses
from mm.control import Command, System
from mm.controller import Controller
from mm.driving import at_data_speeds
from mm.settings import Settings
from motion import kinematics, quat
from motion.errors import NotFinite, UserError
from motion.pose import Poses
from motion.skeleton import Skeleton
from viewer.controls import Hands, Stick, on_course
from viewer.live import Live
from viewer.played import Played, shape_of
from viewer.session import Session
from viewer.stage import Stage
from viewer.timeline import between

SKELETON = Skeleton(("root", "arm"), np.array([-1, 0], np.int32), np.array([[0, 0, 0], [0, 1, 0.0]]))


class Walker:
    """Goes a metre a second along Z, turning by a tenth of a radian a second; every step is work."""

    skeleton, count = SKELETON, 1

    def __init__(self, fps: float = 60.0, *, name: str = "walker", work: Any = lambda: None) -> None:
        self.name, self.fps, self._work = name, fps, work
        self.steps, self.asked = 0, []
        self._poses = Poses.empty(1, 2)

    def reset(self, positions: Any, yaws: Any) -> None:
        self.steps, self._place, self._yaw = 0, np.asarray(positions)[0], float(np.asarray(yaws)[0])
        self._show()

    def step(self, command: Command) -> Poses:
        self._work()
        self.asked.append(command)
        if not np.isfinite(command.velocity).all():
            raise NotFinite("the command is not finite")
        self.steps += 1
        self._show()
        return self._poses

    def _show(self) -> None:
        passed = self.steps / self.fps
        self._poses.positions[0, 0] = [self._place[0], 0, self._place[1] + passed]
        self._poses.rotations[0, 0] = quat.from_yaw(self._yaw + passed / 10)

    def record(self) -> dict[str, np.ndarray]:
        return {"positions": self._poses.positions.copy(), "rotations": self._poses.rotations.copy()}

    def memory(self) -> dict[str, int]:
        return {}


def session(*systems: System, **options: Any) -> Session:
    pilot = Stick(len(systems))
    pilot.hands = Hands(move=(0.0, 1.0))
    return Session({system.name: system for system in systems}, pilot, **options)


def where(found: Session, name: str = "walker") -> tuple[float, float]:
    """Metres gone along Z, and radians turned, as they are shown."""
    instant = found.look().actors[name]
    return float(instant.positions[0, 2]), float(quat.yaw(instant.rotations[0]))


@pytest.mark.parametrize("refresh", [24.0, 60.0, 144.0, 1000.0])
@pytest.mark.parametrize("fps", [30.0, 60.0, 59.94])
def test_what_is_shown_is_where_it_is_at_that_time_at_any_rate(refresh: float, fps: float) -> None:
    found = session(Walker(fps))
    for frame in range(1, 200):
        found.advance(1 / refresh)
        assert found.time == pytest.approx(frame / refresh)
        assert where(found) == pytest.approx((frame / refresh, frame / refresh / 10), abs=5e-5)


def test_each_system_steps_at_its_own_rate_and_all_are_shown_at_one_time() -> None:
    systems = [Walker(fps, name=f"{fps:g}") for fps in (24.0, 30.0, 60.0, 120.0)]
    found = session(*systems)
    for _ in range(100):
        found.advance(0.01003)
        places = [where(found, system.name)[0] for system in systems]
        np.testing.assert_allclose(places, found.time, atol=1e-5)
    for system in systems:
        assert system.steps == np.ceil(found.time * system.fps)


def test_slow_motion_pause_and_single_steps() -> None:
    found = session(Walker())
    found.speed = 0.1
    for _ in range(60):
        found.advance(1 / 60)
    assert found.time == pytest.approx(0.1)
    assert where(found)[0] == pytest.approx(0.1, abs=1e-5)
    found.paused = True
    found.advance(1.0)
    assert found.time == pytest.approx(0.1)
    found.advance(-1.0)
    found.paused = False
    found.advance(0.05)  # at 6.3 steps
    steps = [found.time * 60]
    for _ in range(3):
        found.single_step()
        steps.append(found.time * 60)
    np.testing.assert_allclose(steps, [6.3, 7, 8, 9])
    assert found.paused
    assert where(found)[0] == pytest.approx(9 / 60)


def test_a_single_step_goes_to_the_next_step_of_any_system() -> None:
    found = session(Walker(60.0, name="a"), Walker(40.0, name="b"))
    times = []
    for _ in range(5):
        found.single_step()
        times.append(found.time * 120)
    np.testing.assert_allclose(times, [2, 3, 4, 6, 8])


def test_single_steps_in_the_past_look_and_do_not_move() -> None:
    walker = Walker()
    found = session(walker)
    found.advance(0.1)
    times = []
    for back in (True, True, True, False, False, False):
        found.single_step(back=back)
        times.append(found.look().time * 60)
    np.testing.assert_allclose(times, [5, 4, 3, 4, 5, 6])
    assert found.look().live and walker.steps == 6
    found.single_step()
    assert walker.steps == 7
    for _ in range(20):
        found.single_step(back=True)
    assert found.look().time == 0


def test_a_slow_machine_drops_time_and_does_not_fall_behind_further() -> None:
    clock = [0.0]

    def work() -> None:
        clock[0] += 0.05  # a step takes three frames

    slow = Walker(work=work)
    found = session(slow, clock=lambda: clock[0])
    for _ in range(40):
        before = slow.steps
        found.advance(1 / 60, budget=0.01)
        assert slow.steps - before <= 1
        assert where(found)[0] == pytest.approx(found.time, abs=1e-5)
    # Called once in 1/60 s, it could keep pace; after a second's gap it makes up for half of it.
    assert found.dropped == pytest.approx(0, abs=1e-9)
    found.advance(1.0, budget=0.12)
    assert found.time == pytest.approx(40 / 60 + 3 / 60)
    assert found.dropped == pytest.approx(1 - 3 / 60)


def test_who_is_dragged_is_not_fast_forwarded() -> None:
    found = session(Walker())
    found.advance(3600.0)
    assert found.time == pytest.approx(0.5)


def test_all_who_step_at_once_are_asked_the_same_by_one_pilot() -> None:
    systems = [Walker(name=name) for name in "abc"]
    found = session(*systems)
    found.teleport([[0, 0], [3, 0], [0, 5]], [0.0, 1.0, 2.0])
    for _ in range(30):
        found.advance(1 / 60)
    for one, other in zip(systems[0].asked, systems[2].asked, strict=True):
        np.testing.assert_array_equal(one.velocity, other.velocity)
        np.testing.assert_array_equal(one.yaw, other.yaw)
    assert np.linalg.norm(systems[0].asked[-1].velocity) > 1


def test_nobody_slides_to_where_they_are_put() -> None:
    found = session(Walker())
    found.advance(0.1)
    found.teleport([10.0, 20.0], 0.5)
    seen = []
    for _ in range(40):
        found.advance(0.001)
        seen.append(found.look().actors["walker"].positions[0, 0])
    assert set(np.round(seen, 3)) == {10.0}
    found.scrub(0.09)
    assert found.look().actors["walker"].positions[0, 0] == 0
    found.scrub(7 / 60 - 0.001)  # just before
    assert found.look().actors["walker"].positions[0, 0] == 0
    found.paused = False
    assert found.places()[0][0, 0] == 10
    found.reset()
    found.advance(0.05)
    assert found.look().actors["walker"].positions[0, 0] == 0


def test_who_is_put_elsewhere_in_a_pause_is_seen_there() -> None:
    found = session(Walker(name="a"), Walker(name="b"))
    found.advance(0.105)
    found.scrub(0.05)
    found.teleport([7.0, 0.0], 0.0, name="b")
    look = found.look()
    assert (found.paused, look.live) == (True, True)
    assert [look.actors[name].positions[0, 0] for name in "ab"] == [0, 7]
    found.reset()
    assert [found.look().actors[name].positions[0, 0] for name in "ab"] == [0, 0]
    found.paused = False
    found.advance(0.1)
    assert where(found, "a")[0] == where(found, "b")[0] == pytest.approx(0.1, abs=0.02)


def test_another_system_that_cannot_go_on_begins_where_the_old_one_is() -> None:
    found = session(Walker())
    found.advance(0.25)
    found.exchange("walker", Walker())
    assert where(found)[0] == pytest.approx(0.25, abs=0.02)
    found.advance(0.1)
    assert where(found)[0] == pytest.approx(0.35, abs=0.02)


def test_who_breaks_stands_still_and_says_why_until_it_is_reset() -> None:
    broken, fine = Walker(name="broken"), Walker(name="fine")
    found = session(broken, fine)
    found.advance(0.1)
    step, broken.step = broken.step, _raise
    for _ in range(10):
        found.advance(0.1)
    look = found.look()
    assert look.errors == {"broken": "out of its mind; reset it"}
    assert look.actors["fine"].positions[0, 2] == pytest.approx(1.1)
    assert look.actors["broken"].positions[0, 2] == pytest.approx(0.1, abs=0.02)
    broken.step = step
    found.reset()
    found.advance(0.2)
    assert not found.look().errors
    assert broken.steps == fine.steps == 12


def _raise(command: Command) -> Poses:
    raise UserError("out of its mind", remedy="reset it")


def test_what_was_a_minute_ago_is_forgotten_and_what_is_looked_at_is_as_it_was() -> None:
    found = session(Walker(), seconds=2.0)
    for _ in range(100):
        found.advance(0.05)
    found.scrub(0.0)
    assert found.look().time == found.begin == pytest.approx(3.0, abs=0.02)
    found.scrub(4.321)
    look = found.look()
    assert (look.time, look.live) == (4.321, False)
    assert where(found)[0] == pytest.approx(4.321, abs=1e-5)
    found.scrub(99.0)
    assert found.look().time == found.time
    found.scrub(None)
    assert found.look().live
    with_nobody = found.fixed
    assert with_nobody == ("walker",)
    found.resume()
    assert not found.paused
    found.scrub(4.0)
    with pytest.raises(UserError, match="walker cannot go back"):
        found.resume()


def real(name: str) -> System:
    if name in CONTROLLERS:
        return CONTROLLERS[name](MODELS[name]())
    database = lmm_models.database()
    if name == "mm":
        return Controller(database, name="mm")
    return controllers.controller(lmm_models.model(database), database=database, name=name)


def played(found: Session, frames: int) -> dict[str, np.ndarray]:
    """Poses of all by name, at 60 frames a second."""
    seen: dict[str, list] = {name: [] for name in found.actors}
    for _ in range(frames):
        found.advance(1 / 60)
        for name, instant in found.look().actors.items():
            seen[name].append(np.concatenate([instant.positions, instant.rotations], axis=-1))
    return {name: np.array(poses) for name, poses in seen.items()}


@pytest.fixture(scope="module")
def shown() -> Session:
    """MM, LMM, PFNN and MANN side by side."""
    return session(*(real(name) for name in ("mm", "lmm", "pfnn", "mann")))


def test_real_systems_go_back_in_time_and_do_the_same_again(shown: Session) -> None:
    pilot = shown.pilot
    pilot.hands = Hands(move=(0.0, 1.0), turn=0.5)
    played(shown, 40)
    there = shown.time
    once = played(shown, 30)
    shown.scrub(there)
    shown.resume()
    assert shown.time == there
    again = played(shown, 30)
    for name, poses in once.items():
        np.testing.assert_array_equal(poses, again[name], err_msg=name)
    shown.scrub(there)
    shown.resume()
    pilot.hands = Hands(move=(-1.0, 0.0), run=True)
    other = played(shown, 30)
    assert not np.array_equal(other["mm"], once["mm"])


def test_a_course_goes_back_with_its_character() -> None:
    data = lmm_models.database()
    course = at_data_speeds(courses.load("square"), data)
    found = Session({"mm": Controller(data)}, on_course(course))
    played(found, 90)
    found.reset()
    played(found, 60)
    there = found.time
    once = played(found, 60)["mm"]
    found.reset()  # another lap, whose time begins anew
    played(found, 30)
    found.scrub(there)
    found.resume()
    np.testing.assert_array_equal(played(found, 60)["mm"], once)


def test_real_systems_take_settings_on_the_way(shown: Session) -> None:
    before = shown.time
    shown.retune("mm", Settings(inertialization_halflife=0.0, synchronization="none"))
    played(shown, 5)
    timeline = shown.actors["mm"].timeline
    settings, data = timeline.made_by(timeline.last)
    assert settings.synchronization == "none" and data is lmm_models.database()
    assert timeline.made_by(timeline.step_at(before))[0].synchronization == "adjust+clamp"
    assert timeline.recording().settings["synchronization"] == "none"
    moved = played(shown, 2)["mm"][-1]
    shown.exchange("mm", Controller(lmm_models.database(), settings=Settings(ignore_end=0.1)))
    np.testing.assert_allclose(played(shown, 1)["mm"][-1][1:], moved[1:], atol=0.1)
    assert shown.actors["mm"].system.settings.ignore_end == 0.1
    with pytest.raises(UserError, match="keeps the settings"):
        session(Walker()).retune("walker", Settings())


def test_a_system_that_comes_later_stands_where_the_first_one_is() -> None:
    found = session(Walker())
    found.advance(0.21)
    pilot = Stick(2)
    found.add("late", Walker(30.0), pilot)
    found.advance(0.1)
    late = found.look().actors["late"]
    assert [late.time, found.time] == pytest.approx([7 / 30 + 0.1] * 2)
    assert 0.2 < late.positions[0, 2] < 0.36
    assert found.begin == pytest.approx(7 / 30)
    with pytest.raises(UserError, match="a late already"):
        found.add("late", Walker(), pilot)


def test_actors_are_shown_side_by_side(shown: Session) -> None:
    shows = []
    for name, actor in shown.actors.items():
        description = actor.system.description
        shape = shape_of(description, lmm_models.database())
        assert len(shape.parts) > 10
        shows.append(Played(name, actor.timeline, shape))
    stage = Stage(shows)
    stage.move_to(shown.time)
    assert (np.diff(stage.roots[:, 0]) > 0).all()  # each at its own place
    look = shown.look().actors["mm"]
    world, turned = shows[0].pose(shown.time)
    expected, _ = kinematics.forward(shows[0].skeleton, look.positions, look.rotations)
    np.testing.assert_allclose(world[0], expected, atol=1e-6)
    assert turned.shape == (1, len(shows[0].skeleton), 4)
    bare = dataclasses.replace(description, anatomy=None)
    assert len(shape_of(bare).parts) > 10


def test_a_window_does_not_wait_for_a_slow_step() -> None:
    free, busy = threading.Event(), threading.Event()

    def work() -> None:
        busy.set()
        free.wait(20)

    live = Live(session(Walker(work=work)), patience=0.01)
    start = time.perf_counter()
    first = live.frame(1 / 60)
    busy.wait(20)
    looks = [live.frame(1 / 60) for _ in range(3)]
    assert time.perf_counter() - start < 5  # and not 20
    assert all(look.time == first.time == 0 for look in looks)
    assert live.late == 4
    done = []
    live.do(lambda found: done.append(found.time))
    free.set()
    while not done:
        time.sleep(0.001)
        look = live.frame(0.0)
    assert look.time == pytest.approx(4 / 60) or live.frame(0.0).time == pytest.approx(4 / 60)
    live.close()


def test_a_thread_shows_what_the_session_alone_shows_and_hands_on_what_went_wrong() -> None:
    live, alone = Live(session(Walker()), patience=20.0, budget=20.0), session(Walker())
    for _ in range(20):
        look = live.frame(0.0123)
        alone.advance(0.0123)
        expected = alone.look().actors["walker"]
        np.testing.assert_array_equal(look.actors["walker"].positions, expected.positions)
    live.do(lambda found: found.add("walker", Walker(), Stick(2)))
    with pytest.raises(UserError, match="already"):
        live.frame(0.01)
    assert live.frame(0.01).time > look.time
    live.close()


def test_between_two_poses_joints_turn_the_short_way() -> None:
    before, after = quat.from_yaw(np.array([3.0])), -quat.from_yaw(np.array([3.3]))
    places = np.zeros((1, 3), np.float32)
    for share in (0.0, 0.25, 1.0):
        _, turned = between((places, before), (places, after), share)
        assert np.degrees(quat.angle_between(turned, quat.from_yaw(np.array([3 + 0.3 * share]))))[0] < 0.05
