from __future__ import annotations

import numpy as np
import pytest

from viewer import camera
from viewer.camera import Camera


def looking() -> Camera:
    return camera.orbit([0, 1, 0], azimuth=0.0, elevation=0.0, distance=4.0, field=np.radians(40))


def test_points_appear_where_similar_triangles_say() -> None:
    # A metre at 4 m away, by a focal length of (100 / 2) / tan(20 degrees).
    metre = 50 / np.tan(np.radians(20)) / 4
    places, far = camera.project(looking(), [[0, 1, 0], [1, 1, 0], [0, 2, 0], [0, 1, 2]], 160, 100)
    np.testing.assert_allclose(places, [[80, 50], [80 + metre, 50], [80, 50 - metre], [80, 50]], atol=1e-9)
    np.testing.assert_allclose(far, [4, 4, 4, 2])


def test_who_faces_the_camera_has_the_left_hand_on_the_right_of_the_picture() -> None:
    left = [0.5, 1, 0]  # of one who faces +Z
    front, _ = camera.project(looking(), left, 160, 100)
    behind = camera.orbit([0, 1, 0], azimuth=np.pi, elevation=0.0, distance=4.0)
    back, _ = camera.project(behind, left, 160, 100)
    assert front[0] > 80 > back[0]


@pytest.mark.parametrize(
    ("azimuth", "elevation", "expected"),
    [(0.0, 0.0, [0, 0, 3]), (np.pi / 2, 0.0, [3, 0, 0]), (0.0, np.pi / 6, [0, 1.5, 3 * np.cos(np.pi / 6)])],
)
def test_an_orbit_stands_where_its_angles_say(
    azimuth: float, elevation: float, expected: list[float]
) -> None:
    found = camera.orbit([1, 2, 3], azimuth=azimuth, elevation=elevation, distance=3.0)
    np.testing.assert_allclose(found.position - [1, 2, 3], expected, atol=1e-12)
    assert found.distance == pytest.approx(3.0)


def test_from_straight_above_there_still_is_a_picture() -> None:
    above = camera.orbit([0, 0, 0], azimuth=0.3, elevation=np.pi / 2, distance=5.0)
    turn = camera.axes(above)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    with pytest.raises(ValueError, match="straight"):
        camera.axes(Camera(np.array([0.0, 5, 0]), np.zeros(3)))


def test_following_makes_half_of_the_way_every_half_life_at_any_rate() -> None:
    start, goal = looking(), np.array([2.0, 1.0, -4.0])
    once = camera.follow(start, goal, 0.2, halflife=0.2)
    np.testing.assert_allclose(once.target, (start.target + goal) / 2, rtol=1e-4)
    np.testing.assert_allclose(once.position - once.target, start.position - start.target)
    often = start
    for _ in range(10):
        often = camera.follow(often, goal, 0.02, halflife=0.2)
    np.testing.assert_allclose(often.target, once.target, atol=1e-9)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (0.8, 0.3), (2.5, -0.1)])
def test_what_is_fitted_just_is_in_the_picture(azimuth: float, elevation: float) -> None:
    points = np.random.default_rng(1).normal(size=(40, 3)) * [1.0, 0.5, 2.0]
    distance = camera.fitting(points, azimuth=azimuth, elevation=elevation, aspect=1.5)
    eye = camera.orbit([3, 1, 2], azimuth=azimuth, elevation=elevation, distance=distance)
    places, _ = camera.project(eye, points + np.array([3, 1, 2]), 600, 400)
    reach = np.abs(places / [300, 200] - 1)
    assert reach.max() == pytest.approx(1.0, abs=1e-9)
