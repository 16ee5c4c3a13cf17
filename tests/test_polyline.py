"""Ways on the ground by arc length."""

from __future__ import annotations

import numpy as np
import pytest

from mm.polyline import Polyline, spline

CORNER = [(0, 0), (0, 3), (4, 3)]


def test_points_and_directions_by_arc_length():
    points, directions, segments = Polyline(CORNER).at(np.array([1.0, 3.0, 5.0, 9.0, -1.0]))
    np.testing.assert_allclose(points, [(0, 1), (0, 3), (2, 3), (4, 3), (0, 0)])
    np.testing.assert_allclose(directions, [(0, 1), (1, 0), (1, 0), (1, 0), (0, 1)])
    np.testing.assert_array_equal(segments, [0, 1, 1, 1, 0])


def test_a_closed_one_goes_round():
    line = Polyline([*CORNER, (0, 0)], closed=True)
    assert line.length == pytest.approx(12)
    points, _, _ = line.at(np.array([1.0, 13.0, 25.0, 12.0]))
    np.testing.assert_allclose(points, [(0, 1), (0, 1), (0, 1), (0, 0)], atol=1e-12)


def test_distance_is_that_to_the_nearest_point():
    line = Polyline(CORNER)
    found = line.distance(np.array([(1.0, 1.0), (2.0, 5.0), (-3.0, -4.0), (7.0, 7.0), (0.0, 2.0)]))
    np.testing.assert_allclose(found, [1, 2, 5, 5, 0])


def test_a_spline_through_a_circles_points_is_the_circle():
    angles = np.linspace(0, 2 * np.pi, 13)
    given = 5 * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    given[-1] = given[0]
    points, at = spline(given, closed=True, spacing=0.1)
    assert np.abs(np.linalg.norm(points, axis=1) - 5).max() < 0.005
    np.testing.assert_allclose(points[at], given, atol=1e-12)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps.max() <= 0.1 and steps.sum() == pytest.approx(10 * np.pi, rel=1e-3)


def test_an_open_spline_through_points_of_a_line_is_the_line():
    points, at = spline([(0, 0), (0, 1), (0, 3)], closed=False, spacing=0.25)
    np.testing.assert_allclose(points[:, 0], 0)
    assert (np.diff(points[:, 1]) > 0).all()
    np.testing.assert_allclose(points[at, 1], [0, 1, 3])


def test_at_a_corner_the_segment_is_the_next_one_in_every_lap():
    line = Polyline(
        [(-15, 20), (-25, 0), (-12.5, -12.5), (12.5, -20), (5, -5), (12.5, 25), (-15, 20)], closed=True
    )
    laps = line.length * np.arange(1000)
    for k, arc in enumerate(line.arcs):
        points, directions, segments = line.at(laps + arc)
        np.testing.assert_array_equal(segments, k % 6)
        np.testing.assert_allclose(points, np.tile(line.points[k % 6], (1000, 1)), atol=1e-5)
        np.testing.assert_array_equal(directions, np.tile(line.directions[k % 6], (1000, 1)))
