"""Phase from stances: exact at footfalls, always on the way, slow in stands, robust to what was missed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from motion import strides
from motion.strides import LEFT, RIGHT, STANDING_RATE, TURN

Array = NDArray[np.float64]
FPS = 60.0


def times(seconds: float) -> Array:
    return np.arange(round(seconds * FPS)) / FPS


def walk(
    seconds: float, *, cycle: float = 1.0, duty: float = 0.6, first: float = 0.25
) -> tuple[Array, Array]:
    """Stances of a left foot that comes down at first, first + cycle, ..., of a right one half a cycle on."""
    out = []
    for start in (first, first + cycle / 2):
        on = start + cycle * np.arange(-2, seconds / cycle + 2)
        out.append(np.stack([on, on + duty * cycle], axis=-1)[on < seconds])
    return out[0], out[1]


def rates(phase: Array) -> Array:
    return np.mod(np.diff(phase), TURN) * FPS


def off(phase: Array, truth: Array | float) -> Array:
    """Difference of angles, radians."""
    return np.abs(np.angle(np.exp(1j * (phase - truth))))


def test_an_even_gait_is_a_clock():
    """The right foot comes down at 0 and the left one at pi, and between them it goes on linearly."""
    time = times(6)
    phase = strides.phase(time, *walk(6))
    np.testing.assert_allclose(off(phase, np.pi + TURN * (time - 0.25)), 0, atol=1e-9)
    assert phase.min() >= 0 and phase.max() < TURN
    assert strides.phase(time, *walk(6, first=0.25 - 1e-16)).max() < TURN


def test_steps_of_unequal_length_are_exact_where_feet_come_down():
    left = np.array([[-1.0, 0.5], [0.9, 1.5], [1.9, 2.5], [2.9, 9.0]])
    right = np.array([[-1.0, 0.9], [1.2, 1.9], [2.2, 2.9], [3.2, 9.0]])  # 0.3 s after the left, 0.7 s before
    time = np.arange(0, 350) / 100
    phase = strides.phase(time, left, right)
    for at, value in ((0.9, np.pi), (1.2, 0), (1.9, np.pi), (2.2, 0), (2.9, np.pi), (3.2, 0)):
        assert off(phase[round(at * 100)], value) < 1e-6
    steps = np.mod(np.diff(phase), TURN) * 100
    assert steps.min() > 0 and np.abs(np.diff(steps)).max() < 0.08 * steps.max()  # lines would jump by half


def test_a_stand_goes_on_slowly_and_ends_in_time():
    for seconds in (2.0, 4.0, 8.0, 20.0, 61.0):
        begin = seconds + 1.0  # the right foot stands on, the left one leaves here and comes down 0.4 s later
        left = np.array([[-1, 0.1], [0.5, begin], [begin + 0.4, 1e3]])
        right = np.array([[-1, 0.6], [1.0, begin + 0.5], [begin + 0.9, 1e3]])
        time = times(begin + 1)
        phase = strides.phase(time, left, right)
        found = rates(phase)
        assert found.min() > 0
        stand = found[round(2 * FPS) : round((begin - 0.6) * FPS)] if seconds > 2 else found[70:140]
        assert stand.max() < 0.5 * np.pi  # a quarter of a walk's
        if seconds > 10:
            assert 0.6 * STANDING_RATE < stand.mean() < 1.6 * STANDING_RATE
        assert off(phase[round((begin + 0.4) * FPS)], np.pi) < 0.05
        assert off(phase[round(1.0 * FPS)], 0.0) < 0.05


def test_standing_all_the_time_is_slow_throughout():
    both = np.array([[-np.inf, np.inf]])
    phase = strides.phase(times(30), both, both)
    np.testing.assert_allclose(rates(phase), STANDING_RATE)


def test_feet_that_never_come_down_have_no_phase():
    never = np.zeros((0, 2))
    both = np.array([[-np.inf, np.inf]])
    for left, right in ((never, never), (never, both), (np.array([[-1.0, 2.0]]), both)):
        with pytest.raises(ValueError, match="no foot comes down"):
            strides.phase(times(5), left, right)


@pytest.mark.parametrize("missed", [3, 4, 5])
def test_a_missed_contact_does_no_harm(missed):
    left, right = walk(8)
    time = times(8)
    whole = strides.phase(time, left, right)
    np.testing.assert_allclose(
        off(strides.phase(time, np.delete(left, missed, 0), right), whole), 0, atol=1e-6
    )


def test_contacts_that_are_none_are_left_out():
    left, right = walk(8)
    time = times(8)
    whole = strides.phase(time, left, right)
    scuffs = np.sort(np.concatenate([left, [[4.05, 4.1]]]), axis=0)  # within the swing of the left foot
    assert off(strides.phase(time, scuffs, right), whole).max() < 0.15
    landing = strides.footfalls(time, np.array([[-1, 1.0], [2.0, 9]]), np.array([[-1, 1.0], [2.02, 9]]))
    assert len(landing) == 1  # on both feet


def test_no_rate_is_faster_than_sprinters_step():
    rng = np.random.default_rng(0)
    for _ in range(50):
        stances = []
        for _ in (LEFT, RIGHT):
            edges = np.cumsum(rng.exponential(0.35, 40))
            stances.append(np.concatenate([[[-1, edges[0]]], edges[1:-1].reshape(-1, 2)]))
        found = rates(strides.phase(times(12), *stances))
        assert found.min() > 0 and found.max() < 2 * np.pi / strides.SHORTEST_STEP


def test_left_and_right_exchanged_are_half_a_turn_apart():
    rng = np.random.default_rng(1)
    left, right = (s + 0.1 * rng.random(s.shape) for s in walk(8))
    time = times(8)
    exchanged = strides.phase(time, right, left)
    np.testing.assert_allclose(off(exchanged, strides.phase(time, left, right) + np.pi), 0, atol=1e-9)


def test_the_curve_is_scipys():
    rng = np.random.default_rng(2)
    for count in (2, 3, 12):
        knots, values = np.cumsum(rng.random(count) + 0.05), np.cumsum(rng.random(count) + 0.01)
        at = np.linspace(knots[0], knots[-1], 500)
        inner = slice(None)
        if count > 2:  # other rates at the two ends
            inner = (at >= knots[1]) & (at <= knots[-2])
        truth = PchipInterpolator(knots, values)(at)
        np.testing.assert_allclose(strides.monotone(knots, values, at)[inner], truth[inner], atol=1e-12)
        beyond = strides.monotone(knots, values, np.array([knots[-1], knots[-1] + 1, knots[-1] + 2]))
        assert np.diff(beyond)[0] == pytest.approx(np.diff(beyond)[1]) and np.diff(beyond)[0] > 0


@pytest.mark.parametrize("first", [0.05, 0.2, 0.31, 0.45, 0.7])
def test_a_clip_may_begin_and_end_anywhere_in_a_walk(first):
    """What is seen of a walk is that of the whole walk."""
    left, right = walk(9, first=first)
    time = times(9)
    whole = strides.phase(time, left, right)
    cut = time[(time >= 2) & (time < 6)]
    seen = [s[(s[:, 1] > 2) & (s[:, 0] < 6)] for s in (left, right)]
    seen = [
        np.stack([np.where(s[:, 0] < 2, -np.inf, s[:, 0]), np.where(s[:, 1] > 6, np.inf, s[:, 1])], -1)
        for s in seen
    ]
    found = strides.phase(cut, *seen)
    assert off(found, whole[(time >= 2) & (time < 6)]).max() < 0.2
