"""Phase from contacts: of a planned dance, of mirrored contacts, and of what has none."""

from __future__ import annotations

import numpy as np
import pytest

from features import phase as phases
from motion.dancecard import CONTACTS, Move, Style, perform
from motion.errors import UserError


def off(phase, truth):
    return np.degrees(np.abs(np.angle(np.exp(1j * (phase - truth)))))


@pytest.fixture(scope="module")
def labels():
    moves = [Move(4), Move(4, 1.2), Move(3), Move(3, 0, 0.9), Move(3, 3.0, gait="run"), Move(7)]
    return perform(moves, name="dance", style=Style(), rng=np.random.default_rng(3)).labels


def test_planned_contacts_tell_the_planned_phase(labels):
    found = phases.from_contacts(CONTACTS, labels.contacts, 60)
    error = off(found, labels.phase)
    assert np.median(error) < 6 and np.percentile(error, 95) < 20
    rate = phases.rate(found, 60)
    assert rate.min() > 0 and rate.max() < 8 * np.pi


def test_it_is_the_same_at_any_rate(labels):
    whole = phases.from_contacts(CONTACTS, labels.contacts, 60)
    half = phases.from_contacts(CONTACTS, labels.contacts[::2], 30)
    assert np.percentile(off(half, whole[::2]), 95) < 15
    double = phases.from_contacts(CONTACTS, np.repeat(labels.contacts, 2, axis=0), 120)
    assert np.percentile(off(double[::2], whole), 95) < 15


def test_the_rate_changes_smoothly(labels):
    found = phases.from_contacts(CONTACTS, labels.contacts, 60)
    change = np.abs(np.diff(phases.rate(found, 60)))
    assert np.percentile(change, 99) < 1.5 and change.max() < 6  # rad/s a frame


def test_mirrored_contacts_are_half_a_turn_on(labels):
    found = phases.from_contacts(CONTACTS, labels.contacts, 60)
    mirrored = phases.from_contacts(CONTACTS, labels.contacts[:, [2, 3, 0, 1]], 60)
    np.testing.assert_allclose(off(mirrored, found + np.pi), 0, atol=1e-6)


@pytest.mark.parametrize("parts", [("left_foot", "right_foot"), ("left_toe", "right_toe")])
def test_what_a_skeleton_has_is_enough(labels, parts):
    found = phases.from_contacts(parts, labels.contacts.reshape(-1, 2, 2).any(axis=2), 60)
    np.testing.assert_array_equal(found, phases.from_contacts(CONTACTS, labels.contacts, 60))


def test_what_has_no_phase_is_one_line(labels):
    on = labels.contacts
    for contacts, names, message in (
        (on * [1, 1, 0, 0], CONTACTS, "the right foot never touches the ground"),
        (on * [0, 0, 1, 1], CONTACTS, "the left foot never touches the ground"),
        (on * 0, CONTACTS, "neither foot touches the ground"),
        (on, ("left_foot", "right_foot", "left_hand", "right_hand"), "on all fours"),
        (np.array([[1, 1, 1, 1]] * 30 + [[1, 1, 0, 0]] * 90), CONTACTS, "no walkable gait"),
    ):
        with pytest.raises(UserError, match=message) as caught:
            phases.from_contacts(names, contacts, 60)
        assert caught.value.remedy


def test_rates_of_few_frames():
    assert phases.rate(np.zeros(0), 60).shape == (0,)
    assert phases.rate(np.array([1.0]), 60).tolist() == [0.0]
    np.testing.assert_allclose(phases.rate(np.array([6.2, 0.1]), 60), (0.1 + 2 * np.pi - 6.2) * 60)
