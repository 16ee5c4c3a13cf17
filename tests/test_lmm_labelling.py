"""lmm.locomotion.labelling: ranges as the clips that they are, what has no labels, those that are given."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

from features.labels import Labels, label
from lmm.locomotion.labelling import NAMED, DatabaseLabels, kept, labels_of
from mm.database import Database
from motion import kinematics
from motion.errors import Note, UserError


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def labels(database: Database) -> DatabaseLabels:
    return labels_of(database)


def part(database: Database, r: int) -> slice:
    return slice(int(database.starts[r]), int(database.stops[r]))


def without(database: Database, *roles: str) -> Database:
    """The same of a skeleton on which some joints play no role."""
    left = {role: joint for role, joint in database.skeleton.roles.items() if not role.endswith(roles)}
    return replace(database, skeleton=database.skeleton.with_roles(left))


def test_ranges_are_labelled_one_by_one(database: Database, labels: DatabaseLabels) -> None:
    assert len(labels) == len(database) and labels.names[0] == "left_heel" and not labels.left_out
    poses = database.poses[part(database, 1)]
    world = kinematics.forward(database.skeleton, poses.positions, poses.rotations)
    alone = label(database.skeleton, 60.0, *world)
    for name in ("contacts", "phase", "gait"):
        np.testing.assert_array_equal(getattr(labels, name)[part(database, 1)], getattr(alone, name))


def test_clips_without_a_gait_are_left_out(database: Database, labels: DatabaseLabels) -> None:
    thrown = lmm_models.thrown(database, "run")
    with pytest.warns(Note, match="^1 of 2 clips is left out, without labels: run .neither foot touches"):
        found = labels_of(thrown)
    assert kept(thrown, found).tolist() == [name == "straight" for name in database.names]
    assert kept(thrown, labels).all()
    straight = part(database, database.names.index("straight"))
    np.testing.assert_array_equal(found.phase[straight], labels.phase[straight])
    assert list(found.left_out) == ["run"]
    assert not labels_of(thrown, phase=False).left_out  # which says nothing of feet that come down
    with pytest.raises(UserError, match=r"^none of 2 clips can be labelled: run, straight \(neither foot"):
        labels_of(lmm_models.thrown(thrown, "straight"))


def test_many_clips_are_told_in_one_line(database: Database) -> None:
    """More than a line holds: some names, and how many more."""
    thrown, count = lmm_models.thrown(database, "run"), NAMED + 3
    assert database.names == ("run", "run", "straight", "straight")
    edges = np.linspace(0, int(database.stops[1]), count + 1).astype(np.int32)
    many = replace(
        thrown,
        names=(*(f"run{i}" for i in range(count)), "straight", "straight"),
        starts=np.concatenate([edges[:-1], database.starts[2:]]),
        stops=np.concatenate([edges[1:], database.stops[2:]]),
        mirrored=np.zeros(count + 2, bool),
    )
    with pytest.warns(Note, match=r"^8 of 9 clips are left out.*run0, run1, .* and \d more \(") as told:
        labels_of(many)
    assert len(told) == 1 and "\n" not in str(told[0].message)


def test_one_foot_that_never_touches_is_one_line(database: Database, labels: DatabaseLabels) -> None:
    """Of labels that say so: without a phase they make none."""
    own = part(database, 0)
    contacts = labels.contacts[own].copy()
    contacts[:, :2] = 0
    given = {"run": Labels(labels.names, contacts, None, labels.gait[own])}
    with pytest.warns(Note, match="^1 of 2 .*run .the left foot never touches the ground"):
        found = labels_of(database, given=given)
    assert list(found.left_out) == ["run"]


def test_skeletons_without_toes_or_shoulders_do(database: Database, labels: DatabaseLabels) -> None:
    """Thighs tell where a body faces, feet what touches; without either that is one line."""
    for roles in (("_toe",), ("_shoulder", "_arm")):
        poorer = without(replace(database, contact_roles=("left_foot", "right_foot")), *roles)
        if roles != ("_toe",):
            poorer = replace(poorer, contact_roles=("left_toe", "right_toe"))
        found = labels_of(poorer)
        off = np.angle(np.exp(1j * (found.phase.astype(np.float64) - labels.phase)))
        assert len(found) == len(database) and np.degrees(np.abs(off)).mean() < 15
        assert np.mean(found.gait.argmax(axis=1) == labels.gait.argmax(axis=1)) > 0.95


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        (
            ("_shoulder", "_arm", "_up_leg"),
            "cannot tell where the character faces: no pair of up_leg, arm or",
        ),
        (("_toe", "_foot"), "no pair of toes or feet to tell contacts of"),
        (("hips",), "no joint plays the role 'hips'"),
    ],
)
@pytest.mark.parametrize("phase", [True, False])
def test_skeletons_that_do_not_do_are_one_line(
    database: Database, roles: tuple[str, ...], message: str, phase: bool
) -> None:
    if not phase and "_toe" in roles:
        message = "no joint plays the role 'left_foot'"
    with pytest.raises(
        UserError, match=f"^none of 2 clips can be labelled: run, straight .{message}"
    ) as told:
        labels_of(without(database, *roles), phase=phase)
    assert "\n" not in str(told.value)


def test_another_contact_is_named(database: Database) -> None:
    other = replace(database, contact_roles=("left_foot", "right_foot"))
    with pytest.raises(UserError, match="its contact 'left_foot' is none of left_heel, left_toe"):
        labels_of(other)


def test_bodies_on_all_fours_have_no_phase(database: Database) -> None:
    fours = replace(
        database,
        contact_roles=(*database.contact_roles, "left_hand", "right_hand"),
        contacts=np.tile(database.contacts, 2),
    )
    with pytest.raises(UserError, match=r"on all fours: phases are of two feet; .* train --model mann$"):
        labels_of(fours)
    found = labels_of(fours, phase=False)
    assert found.names[2:] == ("left_hand", "right_hand") and found.contacts.shape == (len(database), 4)


def test_labels_that_are_given_take_the_place_of_those_found(
    database: Database, labels: DatabaseLabels
) -> None:
    """By clip, its mirrored copy with them; with a phase of their own or with that of their contacts."""
    rng, own = np.random.default_rng(0), part(database, 0)
    gait = rng.dirichlet(np.ones(6), own.stop - own.start).astype(np.float32)
    given = Labels(labels.names, labels.contacts[own], np.float32(0.5) * labels.phase[own], gait)
    found = labels_of(database, given={"run": given})
    mirrored = part(database, 1)
    assert database.mirrored[1] and database.names[1] == "run"
    for rows, expected in ((own, given), (mirrored, given.mirrored())):
        for name in ("contacts", "phase", "gait"):
            np.testing.assert_array_equal(getattr(found, name)[rows], getattr(expected, name))
    rest = slice(int(database.starts[2]), len(database))
    np.testing.assert_array_equal(found.phase[rest], labels.phase[rest])

    bare = labels_of(database, given={"run": replace(given, phase=None)})
    np.testing.assert_allclose(bare.phase[own], labels.phase[own], atol=1e-6)

    feet = Labels(("left_foot", "right_foot"), given.contacts[:, [0, 2]], None, gait)
    four = labels_of(database, given={"run": feet})
    assert four.names == labels.names
    np.testing.assert_array_equal(four.contacts[own], given.contacts[:, [0, 0, 2, 2]])

    plain = labels_of(database, phase=False, given={"run": given})
    assert plain.names == database.contact_roles and plain.phase is None
    np.testing.assert_array_equal(plain.contacts[own], given.contacts[:, [1, 3]])
    np.testing.assert_array_equal(plain.contacts[rest], database.contacts[rest])
