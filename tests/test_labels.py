"""Labels of clips: shapes, mirror images, other rates, rest poses before a capture, and what has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic

from features.labels import GAITS, Labels, label, label_clip, wrapped
from motion import kinematics, mirror, quat, resample, root
from motion.dancecard import CONTACTS, Move, Style, perform
from motion.errors import UserError


@pytest.fixture(scope="module")
def dance():
    moves = [Move(2), Move(4, 1.3), Move(3, 3.0, gait="run"), Move(3), Move(3, 0, 0.7), Move(2)]
    return perform(moves, name="dance", style=Style(), rng=np.random.default_rng(1)).clip


def off(phase, truth):
    return np.degrees(np.abs(np.angle(np.exp(1j * (np.float64(phase) - truth)))))


def some(frames: int = 5, names=CONTACTS) -> Labels:
    gait = np.eye(6, dtype=np.float32)[np.arange(frames) % 6]
    contacts = np.arange(frames * len(names)).reshape(frames, -1) % 3 == 0
    return Labels(names, contacts.astype(np.uint8), np.linspace(0, 6, frames, dtype=np.float32), gait)


def test_of_a_clip(dance):
    found = label_clip(dance)
    assert found.names == CONTACTS and len(found) == len(dance)
    assert found.contacts.dtype == np.uint8 and found.phase.dtype == found.gait.dtype == np.float32
    assert found.phase.min() >= 0 and found.phase.max() < 2 * np.pi
    np.testing.assert_allclose(found.gait.sum(axis=1), 1, atol=1e-6)
    assert (np.mod(np.diff(found.phase.astype(np.float64)), 2 * np.pi) > 0).all()
    assert label_clip(dance, phase=False).phase is None


def test_single_precision_and_a_ground_root_make_no_difference(dance):
    """As a database holds it: local float32 transforms under a root on the ground."""
    grounded = root.ground(dance)
    world = kinematics.forward(
        grounded.skeleton, grounded.positions.astype(np.float32), grounded.rotations.astype(np.float32)
    )
    assert world[0].dtype == np.float32
    found, known = label(grounded.skeleton, 60, *world), label_clip(dance)
    assert np.mean(found.contacts == known.contacts) > 0.998
    assert np.percentile(off(found.phase, known.phase), 95) < 2
    np.testing.assert_allclose(found.gait, known.gait, atol=0.3)


def test_of_a_mirrored_clip(dance):
    found, known = label_clip(mirror.mirror(dance)), label_clip(dance).mirrored()
    assert np.mean(found.contacts == known.contacts) > 0.998
    assert np.percentile(off(found.phase, known.phase), 99) < 2
    np.testing.assert_allclose(found.gait, known.gait, atol=0.05)


def test_mirroring_twice_changes_nothing():
    labels = some(names=("left_heel", "right_toe", "left_toe", "right_heel"))
    once = labels.mirrored()
    np.testing.assert_array_equal(once.contacts[:, [3, 2, 1, 0]], labels.contacts)
    np.testing.assert_allclose(off(once.phase, labels.phase + np.pi), 0, atol=1e-4)
    twice = once.mirrored()
    np.testing.assert_array_equal(twice.contacts, labels.contacts)
    np.testing.assert_allclose(off(twice.phase, labels.phase), 0, atol=1e-4)


def test_at_other_instants(dance):
    found = label_clip(dance)
    same = found.at(np.arange(len(found)))
    np.testing.assert_array_equal(same.contacts, found.contacts)
    np.testing.assert_allclose(off(same.phase, found.phase), 0, atol=1e-3)
    slow = label_clip(resample.resample(dance, 30)).at(np.arange(len(found)) / 2)
    assert np.percentile(off(slow.phase, found.phase), 95) < 20
    assert found.at([2.25]).gait.shape == (1, 6) and found.at([2.25]).phase is not None


def test_a_rest_pose_before_the_capture_is_no_motion(dance):
    clip = resample.crop(dance, 180, 600)
    posed = clip.replace(
        positions=np.concatenate([clip.positions[:1], clip.positions]),
        rotations=np.concatenate([quat.identity(1, len(clip.skeleton)), clip.rotations]),
    )
    found, known = label_clip(posed), label_clip(clip)
    assert len(found) == len(posed)
    np.testing.assert_array_equal(found.contacts[1:], known.contacts)
    np.testing.assert_array_equal(found.phase[1:], known.phase)
    assert found.gait[0, GAITS.index("other")] == 1
    assert 0 < np.mod(float(found.phase[1]) - float(found.phase[0]), 2 * np.pi) < 0.02


def test_no_phase_names_the_file(tmp_path):
    clip = synthetic.walk(gait="stand", speed=0.0)
    positions = clip.positions.copy()
    positions[:, 0, 2] += 3 * np.arange(len(clip)) / 60  # a body that glides
    with pytest.raises(UserError, match="neither foot touches the ground") as caught:
        label_clip(clip.replace(positions=positions, source=tmp_path / "glides.bvh"))
    assert caught.value.path == str(tmp_path / "glides.bvh")
    assert label_clip(clip.replace(positions=positions), phase=False).phase is None


def test_four_contacts_whatever_the_skeleton_has():
    labels = some()
    np.testing.assert_array_equal(labels.foot_contacts(), labels.contacts)
    feet = some(names=("left_foot", "right_foot", "left_hand", "right_hand"))
    np.testing.assert_array_equal(feet.foot_contacts(), feet.contacts[:, [0, 0, 1, 1]])
    with pytest.raises(UserError, match="no contact of the left foot among left_hand"):
        some(names=("left_hand", "right_hand")).foot_contacts()


def test_shapes_and_names_are_checked():
    labels = some()
    assert len(labels[1:3]) == 2 and labels[1:3].phase.shape == (2,)
    for change in (
        {"phase": labels.phase[1:]},
        {"gait": labels.gait[:, 1:]},
        {"contacts": labels.contacts[:, 1:]},
        {"names": ("left_heel", "left_toe", "right_heel", "right_hand")},
        {"names": ("left_heel", "left_heel", "right_heel", "right_heel")},
    ):
        with pytest.raises(ValueError, match="expected"):
            replace(labels, **change)


def test_rounding_never_reaches_a_full_turn():
    found = wrapped(np.array([2 * np.pi - 1e-12, -1e-12, 2 * np.pi, 7.0, 0.0]))
    assert found.max() < np.float64(2 * np.pi) and found.tolist()[:3] == [0, 0, 0]
    assert found[3] == pytest.approx(7 - 2 * np.pi, abs=1e-6)
