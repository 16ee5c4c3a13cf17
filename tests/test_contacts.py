"""Contacts against a walker whose planted feet are known, the oracle, and a hand-labelled clip."""

import numpy as np
import pytest
import synthetic
from scipy.ndimage import median_filter

from motion import contacts, kinematics, sources
from motion.errors import UserError


@pytest.mark.parametrize("fps", [30, 60, 100, 120])
@pytest.mark.parametrize("gait", ["walk", "run"])
def test_planted_feet_are_found(gait, fps):
    clip = synthetic.walk(gait=gait, speed=1.2 if gait == "walk" else 3.0, seconds=5, fps=fps)
    found = contacts.contacts(clip, roles=("left_foot", "right_foot"))
    truth = synthetic.planted(clip, gait)
    assert found.dtype == np.uint8 and found.shape == truth.shape
    assert np.mean(found == truth) > 0.9


def test_standing_is_contact_throughout():
    assert contacts.contacts(synthetic.walk(gait="stand", speed=0.0)).all()


def test_roles_default_to_toes_else_feet(walker):
    skeleton = walker.skeleton
    assert contacts.contact_roles(skeleton) == ("left_toe", "right_toe")
    bare = {role: joint for role, joint in skeleton.roles.items() if "toe" not in role}
    assert contacts.contact_roles(skeleton.with_roles(bare)) == ("left_foot", "right_foot")
    with pytest.raises(UserError, match=r"no pair of toes or feet.*LeftToe"):
        contacts.contact_roles(skeleton.with_roles({"hips": 0}))


def test_hands_count_for_a_body_on_all_fours(data):
    paws = ("left_foot", "right_foot", "left_hand", "right_hand")
    for name, roles in (
        ("dog_mann/D1_010_KAN01_002.bvh", paws),
        ("lafan1/original_30fps/obstacles1_subject2.bvh", ("left_toe", "right_toe")),
        ("bandai/dataset-1/dataset-1_run_normal_001.bvh", ("left_toe", "right_toe")),
    ):
        clip = sources.load(data / name)
        assert contacts.contact_roles(clip.skeleton, contacts.some_positions([clip])) == roles
        found = contacts.contacts(clip)
        assert found.shape == (len(clip), len(roles))
    assert contacts.contact_roles(clip.skeleton) == ("left_toe", "right_toe")


@pytest.mark.parametrize("size", [1, 2, 3, 5, 6, 7])
def test_median_is_scipys(size):
    flags = np.random.default_rng(4).random((300, 2)) < 0.5
    truth = np.stack([median_filter(flags[:, i], size=size, mode="nearest") for i in (0, 1)], axis=1)
    np.testing.assert_array_equal(contacts.median(flags, size), truth)


def test_median_of_short_and_empty_series():
    assert contacts.median(np.array([[True]]), 6).tolist() == [[True]]
    assert contacts.median(np.zeros((0, 2), bool), 6).shape == (0, 2)


def test_threshold_and_velocity(walker):
    everything = contacts.contacts(walker, speed=1e9)
    nothing = contacts.contacts(walker, speed=0.0)
    assert everything.all() and not nothing.any()
    positions, _ = kinematics.forward(walker.skeleton, walker.positions, walker.rotations)
    toe = walker.skeleton.roles["left_toe"]
    plain = contacts.still(kinematics.velocities(positions[:, [toe]], walker.fps), walker.fps)
    assert np.mean(plain[:, 0] == contacts.contacts(walker)[:, 0]) > 0.98


def test_strikes_of_hand_made_labels_begin_contacts(data):
    """At each labelled strike, the named foot stands within the next fifth of a second."""
    folder = data / "cmu/labelled_60fps"
    clip = sources.load(folder / "69_06_60fps.bvh", fps=60)
    found = contacts.contacts(clip)
    hits = []
    for line in (folder / "69_06_60fps_contacts.txt").read_text().replace("]", "\n").splitlines():
        words = line.strip(" ,[").replace("'", "").replace('"', "").split(",")
        if len(words) == 2 and words[1].strip() in ("left", "right") and words[0].strip().isdigit():
            frame, foot = int(words[0]), ("left", "right").index(words[1].strip())
            hits.append(bool(found[frame : frame + 13, foot].any()))
    assert len(hits) > 20
    assert np.mean(hits) > 0.9
