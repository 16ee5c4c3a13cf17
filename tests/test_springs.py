"""Springs against numerical integration of their differential equations, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from motion import springs

HALFLIFE = 0.27


def integrate(rates, start, dt):
    return solve_ivp(rates, (0, dt), start, rtol=1e-10, atol=1e-12).y[:, -1]


@pytest.mark.parametrize("dt", [1 / 60, 0.1, 0.7])
def test_damp_is_the_critically_damped_spring(dt):
    y = springs.half_damping(HALFLIFE)
    goal = 2.0
    expected = integrate(lambda t, s: (s[1], y * y * (goal - s[0]) - 2 * y * s[1]), (0.3, -1.5), dt)
    np.testing.assert_allclose(springs.damp(0.3, -1.5, goal, HALFLIFE, dt), expected, atol=1e-8)


@pytest.mark.parametrize("dt", [1 / 60, 0.3, 1.0])
def test_simulate_springs_the_velocity_and_integrates_it(dt):
    y = springs.half_damping(HALFLIFE)
    desired = -1.2
    expected = integrate(
        lambda t, s: (s[1], s[2], y * y * (desired - s[1]) - 2 * y * s[2]), (0.5, 1.0, 3.0), dt
    )
    np.testing.assert_allclose(springs.simulate(0.5, 1.0, 3.0, desired, HALFLIFE, dt), expected, atol=1e-8)


def test_two_half_steps_equal_one():
    one = springs.simulate(0.0, 0.0, 0.0, 1.5, HALFLIFE, 0.2)
    half = springs.simulate(0.0, 0.0, 0.0, 1.5, HALFLIFE, 0.1)
    np.testing.assert_allclose(springs.simulate(*half, 1.5, HALFLIFE, 0.1), one, rtol=1e-12)


def test_damper_halves_the_distance_every_halflife():
    assert springs.damper(1.0, 0.0, 0.1, 0.1) == pytest.approx(0.5, rel=1e-3)
    assert springs.damper(1.0, 0.0, 0.1, 0.3) == pytest.approx(0.125, rel=1e-3)


def test_a_zero_halflife_is_immediate_and_finite():
    x, v = springs.decay(1.0, 10.0, 0.0, 1 / 60)
    assert abs(x) < 1e-6 and abs(v) < 1e-3
    assert np.isfinite(springs.simulate(0.0, 0.0, 0.0, 1.0, 0.0, 1 / 60)).all()


def test_wrap():
    angles = np.array([0, np.pi - 1e-3, np.pi + 1e-3, -np.pi - 1e-3, 7 * np.pi / 2])
    np.testing.assert_allclose(
        springs.wrap(angles), [0, np.pi - 1e-3, -np.pi + 1e-3, np.pi - 1e-3, -np.pi / 2], atol=1e-12
    )


@pytest.mark.parametrize(("x", "v"), [(1.0, 0.0), (0.2, 3.0), (0.2, -30.0), (-0.5, 40.0), (0.0, 1.0)])
def test_transition_cost_is_the_area_under_the_offset(x, v):
    area, _ = quad(lambda t: abs(springs.decay(x, v, HALFLIFE, t)[0]), 0, 5, limit=500)
    assert springs.transition_cost(x, v, HALFLIFE) == pytest.approx(area, rel=1e-4)
