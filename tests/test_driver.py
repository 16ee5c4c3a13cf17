"""The driver: what characters are asked on the way, seen through a point that does what it is asked."""

from __future__ import annotations

import numpy as np
import pytest

from mm import courses
from mm.course import Course, StickKey, VelocityKey, Waypoint
from mm.driver import Driver
from mm.polyline import Polyline
from mm.settings import Settings
from motion import springs

FPS = 60.0


def drive(course, count=1, *, follow="obey", frames=100_000, lag=None, **options):
    """Points that obey at once, or by the springs of a simulated character. Returns the driver and
    positions [T, N, 2], velocities asked for [T, N, 2] and facings [T, N]."""
    driver = Driver(course, count, FPS, **options)
    if lag is not None:
        driver.lag[:] = lag
    x, yaw = driver.starts.astype(np.float64), driver.yaws
    v, a = np.zeros_like(x), np.zeros_like(x)
    rows = []
    for frame in range(min(frames, driver.frames)):
        command = driver.command(frame / FPS, x, yaw)
        if follow == "obey":
            x = x + command.velocity / FPS
        else:
            x, v, a = springs.simulate(x, v, a, command.velocity, Settings().velocity_halflife, 1 / FPS)
        yaw = command.yaw
        rows.append((x, command.velocity, yaw))
        if driver.done:
            break
    return driver, *(np.array(part) for part in zip(*rows, strict=True))


def ring(radius, speed, laps=1):
    angles = 2 * np.pi * np.arange(16) / 16
    points = [(radius - radius * np.cos(a), radius * np.sin(a)) for a in angles]
    waypoints = tuple(Waypoint(position=p, speed=speed) for p in points)
    return Course(waypoints=waypoints, closed=True, smooth=True, laps=laps)


def polygon(*points, speed=1.0, **options):
    return Course(waypoints=tuple(Waypoint(position=p, speed=speed) for p in points), **options)


SQUARE = [(0, 0), (0, 6), (6, 6), (6, 0)]


@pytest.mark.parametrize("radius, speed", [(3.0, 1.5), (5.0, 4.0)])
def test_a_lap_of_a_circle_takes_2_pi_r_over_v(radius, speed):
    driver, x, v, yaw = drive(ring(radius, speed), lookahead=0.05)
    assert len(x) / FPS == pytest.approx(2 * np.pi * radius / speed, rel=0.005)
    assert driver.nominal == pytest.approx(2 * np.pi * radius / speed, rel=1e-3)
    np.testing.assert_allclose(np.linalg.norm(v[:-1, 0], axis=-1), speed, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(x[:, 0] - (radius, 0), axis=-1), radius, atol=0.01 * radius)
    # It turns to the left, by v / r a second, and faces its way.
    assert np.unwrap(yaw[:-1, 0])[-1] == pytest.approx(2 * np.pi, abs=0.1)
    np.testing.assert_allclose(yaw[:-1, 0], np.arctan2(v[:-1, 0, 0], v[:-1, 0, 1]), atol=1e-5)


def test_who_obeys_at_once_is_sent_along_a_curve_if_that_is_told():
    course = ring(4.0, 4.0, laps=2)

    def off(**options) -> float:
        _, x, _, _ = drive(course, frames=600, **options)
        return float(Polyline(Driver(course).path).distance(x[120:, 0]).mean())

    # Sent straight to a point 0.75 s ahead it ends on a circle on which that is a tangent.
    assert off() == pytest.approx(4 - 4 * np.cos(0.75), abs=0.08)
    assert off(lag=0.0) < 0.04
    # A lag of half of what it looks ahead is what a character has of whom nothing is told.
    assert off(lag=0.375) == pytest.approx(off(), abs=1e-9)
    assert off(follow="springs", lag=0.27 / np.log(2)) < 0.5 * off(follow="springs", lag=0.0)


def test_the_turn_rate_of_a_circle_is_v_over_r():
    driver = Driver(ring(4.0, 2.0), 1, FPS)
    command = driver.command(0.0, driver.starts, driver.yaws)
    assert command.turn_rate[0] == pytest.approx(2.0 / 4.0, rel=0.05)


def test_a_simulated_character_stays_on_a_circle():
    course = ring(4.0, 1.5, laps=2)
    _, x, _, _ = drive(course, follow="springs")
    settled = Polyline(Driver(course).path).distance(x[120:, 0])
    assert settled.mean() < 0.05


def test_straight_legs_are_followed_into_their_corners():
    course = polygon(*SQUARE, closed=True, laps=2)
    driver, x, _, _ = drive(course)
    assert driver.done and driver.laps[0] == pytest.approx(2)
    assert Polyline(driver.path).distance(x[:, 0]).max() < 0.3
    for corner in SQUARE:
        # The radius of a waypoint at 1 m/s is 0.35 m.
        assert np.linalg.norm(x[:, 0] - corner, axis=-1).min() <= 0.36


def test_the_radius_of_a_waypoint_decides_how_near_it_is_passed():
    corner = Waypoint(position=(0, 6), speed=1, radius=2.0)
    end = Waypoint(position=(6, 6), speed=1)
    course = Course(waypoints=(Waypoint(position=(0, 0), speed=1), corner, end))
    _, x, _, _ = drive(course)
    assert np.linalg.norm(x[:, 0] - (0, 6), axis=-1).min() > 0.9


def test_sharp_corners_are_slowed_and_gentle_ones_not():
    _, _, sharp, _ = drive(polygon((0, 0), (0, 6), (0.5, 0), corner_speed=0.4))
    _, _, gentle, _ = drive(polygon((0, 0), (0, 6), (2, 12), corner_speed=0.4))
    before_the_end = slice(0, 400)
    assert np.linalg.norm(sharp[before_the_end, 0], axis=-1).min() < 0.8
    np.testing.assert_allclose(np.linalg.norm(gentle[before_the_end, 0], axis=-1), 1, rtol=1e-5)


def test_an_open_way_ends_with_a_stand_at_its_end():
    driver, x, v, _ = drive(polygon((0, 0), (0, 5)))
    assert driver.done and not v[-1].any()
    assert np.linalg.norm(x[-1, 0] - (0, 5)) < 0.36
    again = driver.command(len(x) / FPS, x[-1], np.zeros(1))
    assert not again.velocity.any() and again.yaw[0] == 0


def test_whoever_stands_in_the_way_does_not_stop_the_clock():
    driver = Driver(polygon((0, 0), (0, 5)), 1, FPS)
    assert driver.limit == pytest.approx(2 * 5 + 10)
    driver.command(driver.limit, driver.starts, driver.yaws)
    assert driver.done


def test_a_course_that_crosses_itself_is_walked_whole():
    driver, x, _, _ = drive(courses.load("figure-of-eight"), follow="springs")
    assert driver.done and driver.laps[0] == pytest.approx(2, abs=0.02)
    assert len(x) / FPS == pytest.approx(driver.nominal, rel=0.1)


def test_a_tight_smooth_bend_does_not_trap_the_aim():
    hairpin = polygon((0, 0), (0, 5), (0.3, 5.3), (0.6, 5), (0.6, 0), speed=3.0, smooth=True)
    driver, x, _, _ = drive(hairpin, follow="springs")
    assert driver.done and len(x) / FPS < 1.5 * driver.nominal + 1


def test_legs_have_their_own_speed_and_facing():
    waypoints = (
        Waypoint(position=(0, 0), speed=9),
        Waypoint(position=(0, 4), speed=1, facing=(1, 0)),
        Waypoint(position=(4, 4), speed=2),
    )
    driver, x, v, yaw = drive(Course(waypoints=waypoints))
    first, second = x[:, 0, 1] < 3, (x[:, 0, 0] > 1) & (x[:, 0, 0] < 2)
    assert driver.yaws[0] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(np.linalg.norm(v[first, 0], axis=-1), 1, rtol=1e-5)
    np.testing.assert_allclose(yaw[first, 0], np.pi / 2, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(v[second, 0], axis=-1), 2, rtol=1e-5)


@pytest.mark.parametrize("name", courses.names())
def test_every_course_is_done_in_about_its_time(name):
    driver, x, v, _ = drive(courses.load(name).scaled(walk=1.4, run=3.0), follow="springs")
    assert driver.done and np.isfinite(x).all() and np.isfinite(v).all()
    assert len(x) / FPS == pytest.approx(driver.nominal, rel=0.25)


@pytest.mark.parametrize("name", ["thesis", "circle", "strafe", "speed-steps", "random"])
def test_one_equals_many(name):
    course = courses.load(name).scaled(walk=1.4, run=3.0)
    _, one, _, facing = drive(course, 1, frames=200)
    _, many, _, facings = drive(course, 1024, frames=200)
    np.testing.assert_array_equal(many, np.broadcast_to(one, many.shape))
    np.testing.assert_array_equal(facings, np.broadcast_to(facing, facings.shape))


def test_resetting_gives_the_same_commands_again():
    driver = Driver(courses.load("random"), 3, FPS, spread=True)
    runs = []
    for _ in range(2):
        driver.reset()
        x, yaw = driver.starts, driver.yaws
        rows = []
        for frame in range(300):
            command = driver.command(frame / FPS, x, yaw)
            x, yaw = x + command.velocity / FPS, command.yaw
            rows.append(command.velocity)
        runs.append(np.array(rows))
    np.testing.assert_array_equal(*runs)


def test_spread_characters_start_evenly_and_all_arrive():
    course = polygon(*SQUARE, closed=True)
    driver, x, _, _ = drive(course, 8, spread=True)
    np.testing.assert_allclose(driver.starts[[0, 1, 2, 4]], [(0, 0), (0, 3), (0, 6), (6, 6)], atol=1e-6)
    assert driver.done and (driver.laps > 0.85).all()
    assert Polyline(driver.path).distance(x.reshape(-1, 2)).max() < 0.3


def test_a_spread_script_is_shifted_in_time():
    keys = tuple(VelocityKey(time=t, velocity=(0, t + 1)) for t in range(4))
    driver = Driver(Course(velocity=keys, seconds=4), 4, FPS, spread=True)
    for time, speeds in ((0.5, [1, 2, 3, 4]), (1.5, [2, 3, 4, 1])):
        command = driver.command(time, driver.starts, driver.yaws)
        np.testing.assert_allclose(command.velocity[:, 1], speeds)


def test_a_crouch_is_asked_for_on_the_way_to_a_crouched_waypoint_and_by_crouched_keys():
    legs = [Waypoint(position=(0, 4 * i), speed=1.0, gait="crouch" if i == 1 else "walk") for i in range(3)]
    driver = Driver(Course(waypoints=tuple(legs)), 1, FPS)
    x = driver.starts.astype(np.float64)
    for frame in range(6 * 60):
        command = driver.command(frame / FPS, x, driver.yaws)
        assert command.crouch[0] == (x[0, 1] < 4) or abs(x[0, 1] - 4) <= legs[1].reach
        x = x + command.velocity / FPS
    assert x[0, 1] > 5
    keys = (VelocityKey(time=0, velocity=(0, 1), gait="crouch"), VelocityKey(time=2, velocity=(0, 1)))
    driver = Driver(Course(velocity=keys, seconds=4), 1, FPS)
    assert [driver.command(t, driver.starts, driver.yaws).crouch[0] for t in (0.0, 1.0, 3.0)] == [1, 1, 0]


def test_a_crouched_stick_goes_at_walking_speed():
    sticks = tuple(StickKey(time=t, move=(0, 1), gait="crouch" if t else "walk") for t in (0, 1))
    driver = Driver(Course(stick=sticks, seconds=4), 1, FPS)
    found = [driver.command(t, driver.starts, driver.yaws) for t in (0.5, 1.5)]
    assert [c.crouch[0] for c in found] == [False, True]
    np.testing.assert_array_equal(found[0].velocity, found[1].velocity)


def test_scripts_hold_or_ramp():
    keys = (VelocityKey(time=0, velocity=(0, 0)), VelocityKey(time=2, velocity=(0, 4), facing=(1, 0)))
    for interpolate, expected in (("hold", [0, 0, 4, 4]), ("linear", [0, 2, 4, 4])):
        driver = Driver(Course(velocity=keys, seconds=4, interpolate=interpolate), 1, FPS)
        found = [driver.command(t, driver.starts, driver.yaws) for t in (0, 1, 2, 3)]
        np.testing.assert_allclose([c.velocity[0, 1] for c in found], expected)
        assert found[0].yaw[0] == 0 and found[3].yaw[0] == pytest.approx(np.pi / 2)


def test_the_camera_turns_on_from_where_it_was():
    keys = (
        StickKey(time=0, move=(0, 1), camera_deg=90, camera_rate_deg=10, strafe=True),
        StickKey(time=2, move=(0, 1), strafe=True),
    )
    driver = Driver(Course(stick=keys, seconds=4), 1, FPS)
    found = [driver.command(t, driver.starts, driver.yaws) for t in (0, 1, 3)]
    np.testing.assert_allclose(np.degrees([c.yaw[0] for c in found]), [90, 100, 110], rtol=1e-5)
    np.testing.assert_allclose(np.degrees([c.turn_rate[0] for c in found]), [10, 10, 0], atol=1e-5)


def test_a_sticks_gait_goes_half_way_in_its_half_life():
    keys = (StickKey(time=0, move=(0, 1)), StickKey(time=1, move=(0, 1), gait="run"))
    driver = Driver(Course(stick=keys, seconds=3), 1, FPS)
    speeds = [driver.command(t, driver.starts, driver.yaws).velocity[0, 1] for t in (0.9, 1.0, 1.1, 1.2, 3.0)]
    np.testing.assert_allclose(speeds, [1.75, 1.75, 2.875, 3.4375, 4.0], rtol=1e-4)


def test_laps_of_a_script_repeat_it():
    keys = (VelocityKey(time=0, velocity=(0, 1)), VelocityKey(time=1, velocity=(0, 2)))
    driver = Driver(Course(velocity=keys, seconds=2, laps=2), 1, FPS)
    speeds = [driver.command(t, driver.starts, driver.yaws).velocity[0, 1] for t in (0.5, 1.5, 2.5, 3.5)]
    assert speeds == [1, 2, 1, 2] and driver.limit == 4 and driver.laps[0] == pytest.approx(1.75)


def test_start_and_facing_are_the_courses():
    course = Course(velocity=(VelocityKey(time=0, velocity=(0, 0)),), seconds=1, start=(3, 4), facing=(0, -2))
    driver = Driver(course, 2, FPS)
    np.testing.assert_allclose(driver.starts, [(3, 4), (3, 4)])
    np.testing.assert_allclose(np.abs(driver.yaws), np.pi, rtol=1e-6)
    # Standing with nothing asked, that facing is what is asked.
    command = driver.command(0, driver.starts, driver.yaws)
    np.testing.assert_allclose(np.abs(command.yaw), np.pi, rtol=1e-6)


@pytest.mark.parametrize("options", [{"count": 0}, {"fps": 0}, {"lookahead": 0}])
def test_a_driver_of_nothing(options):
    with pytest.raises(ValueError, match="positive"):
        Driver(courses.load("circle"), **options)


def test_every_command_bears_the_drivers_tags():
    for course in ("circle", "random"):
        driver = Driver(courses.load(course), 2, required_tags=5, forbidden_tags=2)
        command = driver.command(0.0, driver.starts, driver.yaws)
        assert command.required_tags.tolist() == [5, 5] and command.forbidden_tags.tolist() == [2, 2]
