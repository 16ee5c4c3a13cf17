"""viewer.timeline and viewer.moments: what is remembered, for how long; jumps, slides, peaks made by hand."""

from __future__ import annotations

from pathlib import Path

import lmm_models
import numpy as np
import pytest
import synthetic

from mm import courses
from mm.controller import Controller
from mm.driving import at_data_speeds
from mm.recording import Recording, record
from mm.settings import Settings
from motion import bvh, console, contacts, kinematics, quat
from motion.errors import UserError
from viewer import curves, moments
from viewer.controls import on_course
from viewer.session import Session
from viewer.timeline import Timeline

FPS = 50.0


def numbered(steps: int, *, seconds: float = 2.0, **cuts: list[int]) -> Timeline:
    """Step k is at x = k, and records its number."""
    found = Timeline(synthetic.skeleton(), FPS, seconds=seconds)
    for k in range(steps):
        positions = np.zeros((1, 22, 3), np.float32)
        positions[:, 0, 0] = k
        rotations = np.tile(quat.from_yaw(np.full((1, 22), 0.01 * k)), 1).astype(np.float32)
        cut = k in cuts.get("cuts", [])
        found.append(
            {"positions": positions, "rotations": rotations, "number": np.array([k])}, seconds=k, cut=cut
        )
    return found


def test_a_ring_holds_the_last_steps_in_order() -> None:
    for steps in (1, 99, 100, 101, 102, 303):
        found = numbered(steps)
        kept = np.arange(max(0, steps - 100), steps)
        assert (found.first, found.last, len(found)) == (kept[0], kept[-1], len(kept))
        np.testing.assert_array_equal(found.stack("number"), kept)
        np.testing.assert_array_equal(found.step_seconds(), kept)
        assert found.record(10_000)["number"] == kept[-1]
        assert found.record(0)["number"] == kept[0]


def test_what_is_held_stays_while_steps_are_appended() -> None:
    for steps, since in ((1, 0), (99, 90), (303, 0), (303, 280)):
        found = numbered(steps, cuts=[steps - 1])
        kept = np.arange(max(0, steps - 100, since), steps)
        held = found.held(since=since)
        for _ in range(3):
            found.hold()
        assert (held.first, held.last) == (kept[0], kept[-1])
        np.testing.assert_array_equal(held.stack("number"), kept)
        np.testing.assert_array_equal(held.stack("number", since=kept[-1]), kept[-1:])
        np.testing.assert_array_equal(held.step_seconds(), kept)
        np.testing.assert_array_equal(held.cuts(), kept == steps - 1)
        assert held.record(held.first)["number"] == kept[0]


def test_any_time_between_steps_is_shown_between_them() -> None:
    found = numbered(300)
    for time in np.random.default_rng(0).uniform(found.begin, found.end, 50):
        instant = found.at(time)
        assert instant.positions[0, 0] == pytest.approx(time * FPS, abs=1e-3)
        np.testing.assert_allclose(quat.yaw(instant.rotations[0]), 0.01 * time * FPS, atol=1e-3)
        assert instant.step == instant.record["number"] == np.ceil(time * FPS)
    for time, step in ((-5.0, 200), (found.begin, 200), (4.04, 202), (4.04 + 1e-9, 202), (99.0, 299)):
        assert found.at(time).positions[0, 0] == step
        assert found.at(time).step == step
    assert found.at(99.0).time == found.end == 299 / FPS


def test_nothing_lies_between_what_was_and_a_cut() -> None:
    found = numbered(10, cuts=[0, 5])
    assert found.at(4.4 / FPS).positions[0, 0] == pytest.approx(4)
    assert found.at(5 / FPS).positions[0, 0] == 5
    assert found.at(5.5 / FPS).positions[0, 0] == pytest.approx(5.5)


def test_what_came_after_is_forgotten_with_the_settings_that_it_had() -> None:
    found = numbered(20)
    found.take_settings("later", "data")
    assert found.made_by(19) == (None, None)
    found.hold()
    assert found.made_by(20) == ("later", "data")
    assert found.record(20)["number"] == 19
    found.forget_after(12)
    assert (found.last, found.made_by(30)) == (12, (None, None))


def test_settings_that_nobody_remembers_are_forgotten() -> None:
    found = numbered(1)
    for k in range(500):  # a slider that is dragged
        found.take_settings(k)
        found.take_settings(k + 0.5)
        found.hold()
    assert [found.made_by(step)[0] for step in (401, 450, 500)] == [400.5, 449.5, 499.5]
    assert len(found._made) <= 102


def test_what_was_since_a_step() -> None:
    found = numbered(250)
    np.testing.assert_array_equal(found.stack("number", since=240), np.arange(240, 250))
    np.testing.assert_array_equal(found.stack("number", since=3), np.arange(150, 250))
    assert len(found.cuts(since=249)) == len(found.step_seconds(since=249)) == 1


@pytest.fixture(scope="module")
def driven() -> Session:
    """Motion matching, its feet free, on a course for six seconds of which four are remembered."""
    database = lmm_models.database()
    course = at_data_speeds(courses.load("random"), database)
    found = Session(
        {"mm": Controller(database, settings=Settings(foot_lock=False))}, on_course(course), seconds=4
    )
    for _ in range(120):
        found.advance(0.05)
    return found


def test_what_is_remembered_is_a_run(driven: Session, tmp_path: Path) -> None:
    timeline = driven.actors["mm"].timeline
    run = timeline.recording()
    run.save(tmp_path / "last.rec")
    again = Timeline.of_recording(Recording.load(tmp_path / "last.rec"))
    assert len(again) == len(timeline) == 240
    for name in timeline.names:
        np.testing.assert_array_equal(again.stack(name), timeline.stack(name), err_msg=name)
    now, then = timeline.at(timeline.begin + 1.234), again.at(1.234)
    np.testing.assert_allclose(then.positions, now.positions, atol=1e-5)
    bvh.write(tmp_path / "last.bvh", run.clip())
    np.testing.assert_allclose(
        bvh.read(tmp_path / "last.bvh").positions[:, 0], run["positions"][:, 0, 0], atol=1e-4
    )
    with pytest.raises(UserError, match="no character 1"):
        Timeline.of_recording(run, 1)


def test_a_session_does_what_a_recorded_run_does(driven: Session) -> None:
    database = lmm_models.database()
    course = at_data_speeds(courses.load("random"), database)
    controller = Controller(database, settings=Settings(foot_lock=False))
    run = record(controller, course, seconds=6.0, progress=console.silent)
    timeline = driven.actors["mm"].timeline
    at = timeline.first - 1  # step 0 is the start
    np.testing.assert_array_equal(timeline.stack("positions"), run["positions"][at : at + 240, 0])
    np.testing.assert_array_equal(timeline.stack("frame"), run["frame"][at : at + 240, 0])


def test_jumps_go_to_the_transitions(driven: Session) -> None:
    timeline = driven.actors["mm"].timeline
    steps = moments.of(timeline)["transition"]
    assert len(steps) > 5
    assert all(timeline.record(step)["transition"] for step in steps)
    assert timeline.stack("transition").sum() == len(steps)
    assert moments.after(steps, steps[0]) == steps[1]
    assert moments.after(steps, steps[-1]) is None
    assert moments.before(steps, steps[1]) == steps[0]
    assert moments.before(steps, steps[0]) is None


def test_a_foot_that_stands_and_moves_slides() -> None:
    feet, touching = np.zeros((100, 2, 3)), np.zeros((100, 2), bool)
    touching[20:60, 0] = touching[50:90, 1] = True
    feet[:, 0, 2] = 0.01 * np.clip(np.arange(100) - 30, 0, 10)  # 10 cm while it stands, at 0.6 m/s
    feet[:, 1, 0] = 0.02 * np.arange(100) * (np.arange(100) < 50)  # while it does not
    found = moments.slides(feet, touching, 60.0)
    assert len(found) == 1
    start, stop, foot = found[0]
    assert (abs(start - 30) <= 2, abs(stop - 40) <= 2, foot) == (True, True, 0)
    assert not moments.slides(0.4 * feet, touching, 60.0)  # 4 cm
    assert not moments.slides(feet, touching, 20.0)  # 0.2 m/s
    feet[:, 1, 0] = np.where(np.arange(100) < 70, 0, 5.0)  # put elsewhere
    assert len(moments.slides(feet, touching, 60.0)) == 2
    cuts = np.arange(100) == 70
    assert len(moments.slides(feet, touching, 60.0, cuts=cuts)) == 1


def test_captured_feet_do_not_slide_and_dragged_ones_do(walker_clips) -> None:
    for clip in walker_clips:
        touching = contacts.contacts(clip)
        world = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
        roles = contacts.contact_roles(clip.skeleton)
        feet = contacts.place_points(*world, *contacts.touching_points(clip.skeleton, roles))
        assert not moments.slides(feet, touching, clip.fps)
        if clip.name == "straight":
            dragged = feet + 0.6 / clip.fps * np.arange(len(clip))[:, None, None] * np.array([0, 0, 1])
            assert len(moments.slides(dragged, touching, clip.fps)) >= 8  # every step of five seconds


def test_peaks_are_the_worst_of_the_dear_searches() -> None:
    costs, searched = np.full(400, 1.0), np.arange(400) % 4 == 0
    costs[100:104], costs[120:132] = 9.0, [3, 3, 3, 3, 7, 7, 7, 7, 5, 5, 5, 5]
    costs[301] = 50.0  # no search
    np.testing.assert_array_equal(moments.peaks(costs, searched), [100, 124])
    assert not len(moments.peaks(np.linspace(1, 1.5, 400), searched))
    assert not len(moments.peaks(np.full(400, np.nan), searched))


def test_what_a_system_does_not_tell_has_no_moments() -> None:
    found = moments.of(numbered(20))
    assert {kind: len(steps) for kind, steps in found.items()} == dict.fromkeys(moments.KINDS, 0)


def test_slides_are_those_of_the_feet_that_contacts_are_of(driven: Session) -> None:
    timeline = driven.actors["mm"].timeline
    usual = moments.of(timeline)["slide"]
    assert len(usual) > 2  # nothing holds them
    toes = ("left_toe", "right_toe")
    np.testing.assert_array_equal(moments.of(timeline, toes)["slide"], usual)
    assert not len(moments.of(timeline, ("left_toe",))["slide"])


def test_curves_are_what_they_say(driven: Session) -> None:
    timeline = driven.actors["mm"].timeline
    found = curves.of(timeline)
    assert {len(values) for values in found.values()} == {240}
    assert found.keys() == {"time", *curves.UNITS}
    np.testing.assert_allclose(found["time"][[0, -1]], [timeline.begin, timeline.end])
    at = np.flatnonzero(timeline.stack("searched"))
    names = ("transition", "cost_candidate", "cost_current")
    played = np.where(*(timeline.stack(name)[at] for name in names))
    np.testing.assert_allclose(found["cost"][at], played, rtol=1e-4)
    np.testing.assert_array_equal(found["cost"][at[3] : at[4]], found["cost"][at[3]])
    way = np.linalg.norm(np.diff(timeline.stack("positions")[:, 0, [0, 2]], axis=0), axis=-1).sum()
    assert found["speed"][1:].mean() == pytest.approx(60 * way / 239, rel=0.05)
    assert np.nanmax(found["skate"]) > 20 and np.nanmin(found["skate"]) >= 0
    last = curves.of(timeline, since=timeline.last - 9)
    np.testing.assert_array_equal(last["asked"], found["asked"][-10:])
    np.testing.assert_array_equal(last["cost"], found["cost"][-10:])
    np.testing.assert_array_equal(last["step"], found["step"][-10:])
    assert np.isnan(curves.of(numbered(9))["skate"]).all()
    assert curves.of(numbered(9))["speed"][1:] == pytest.approx(FPS)
    assert len(curves.of(numbered(1))["speed"]) == 1


def test_a_cut_is_no_speed() -> None:
    assert curves.of(numbered(40, cuts=[20]))["speed"][1:].max() == pytest.approx(FPS)
    far = numbered(30)
    far.append({name: array[None] + 1000 for name, array in far.record(29).items()}, cut=True)
    assert np.nanmax(curves.of(far)["speed"]) <= FPS + 1e-3
