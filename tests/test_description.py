"""What is known of a database without its frames: the same controller, the same file, the same refusals."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from test_controller import drive, stack, user
from test_retarget import stocky

from mm import speeds, stages
from mm.controller import Controller
from mm.description import Description
from mm.feet import find_legs
from mm.rigged import Rigged
from mm.settings import Settings
from motion import files, rig
from motion.anatomy import anatomy
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def description(database):
    return Description.of(database)


def classical(database):
    """The stages of motion matching, which a controller does not have to know are such."""
    return Controller(database, index="brute").stages


def other(database, **changes):
    return type(database)(**(vars(database) | changes))


def test_a_controller_of_a_description_drives_as_one_of_the_database(database, description):
    of_data = Controller(database, count=3, index="brute")
    of_words = Controller(description, count=3, three_stages=classical(database))
    assert of_words.database is None and of_words.skeleton is database.skeleton
    records = [drive(controller, 150) for controller in (of_data, of_words)]
    for name in records[0][0]:
        np.testing.assert_array_equal(stack(records[0], name), stack(records[1], name), err_msg=name)
    assert stack(records[0], "transition").any()


def test_what_it_says_is_what_the_data_says(database, description):
    legs = find_legs(database)
    for field in fields(legs):
        np.testing.assert_array_equal(getattr(description.legs, field.name), getattr(legs, field.name))
    assert (description.walk_mps, description.run_mps) == speeds.of_database(database)
    assert description.crouch_tag == 0 and description.tag_names == ()
    np.testing.assert_array_equal(description.feet(0.02).heights, np.full((len(legs.joints), 2), 0.02, "f4"))
    np.testing.assert_array_equal(description.feet().heights, legs.heights)
    assert not np.shares_memory(description.offset, database.offset)
    half = np.arange(len(database)) % 2
    tagged = other(database, tags=(2 * half).astype(np.uint32), tag_names=("run", "crouch"))
    assert Description.of(tagged).crouch_tag == 2
    everywhere = other(tagged, tags=np.full(len(database), 2, np.uint32))
    assert Description.of(everywhere).crouch_tag == 0


def test_a_file_gives_it_back(description, tmp_path):
    metadata, arrays = description.to_parts()
    files.save(tmp_path / "words", "description", 1, metadata, arrays)
    read, mapped, _ = files.load(tmp_path / "words", "description", 1)
    again = Description.from_parts(read, mapped)
    assert again.to_parts()[0] == metadata
    assert again.skeleton.names == description.skeleton.names
    assert again.schema == description.schema and again.crouch_tag == description.crouch_tag
    for name, array in again.to_parts()[1].items():
        np.testing.assert_array_equal(array, arrays[name], err_msg=name)
    assert {"legs_heights", "anatomy_frames"} <= set(arrays)
    assert repr(again).startswith("Description(23 joints at 60 fps")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fps": 0.0}, "0.0 frames per second"),
        ({"tag_names": ["tag"] * 33}, "33 tags"),
        ({"legs_joints": np.full((2, 4), 99)}, "joints that the skeleton does not have"),
        ({"scale": np.ones(3, np.float32)}, r"scale are float32 \(3,\), expected float32 \(27,\)"),
        ({"anatomy_rest": np.zeros((1, 4))}, "anatomy_rest"),
        ({"offset": None}, "no 'offset'"),
    ],
)
def test_parts_that_do_not_fit_are_refused(description, change, message):
    metadata, arrays = description.to_parts()
    for name, value in change.items():
        part = metadata if name in metadata else arrays
        part[name] = value
        if value is None:
            del part[name]
    with pytest.raises(UserError, match=message), files.content_of("words", "description"):
        Description.from_parts(metadata, arrays)


def test_feet_that_cannot_be_locked_are_refused_as_with_the_data(database):
    whole = {role: j for role, j in database.skeleton.roles.items() if role != "left_leg"}
    legless = other(database, skeleton=database.skeleton.with_roles(whole))
    words = Description.of(legless)
    assert words.legs is None and words.anatomy is None
    words = Description.from_parts(*words.to_parts())
    with pytest.raises(UserError, match=r"whole leg.*left_leg.*turn foot locking off"):
        Controller(words, three_stages=classical(database))
    Controller(words, three_stages=classical(database), settings=Settings(foot_lock=False))


def test_rigs_need_no_database(database, description):
    target = anatomy(rig.enlarge(stocky()))
    poses = []
    for data in (database, description):
        three = classical(database)
        rigged = Rigged(Controller(data, three_stages=three), target)
        for frame in range(30):
            rigged.step(user(frame, 1))
        poses.append(rigged.rigs.rotations.copy())
    np.testing.assert_array_equal(*poses)
    # Without an anatomy the skeleton's own rest pose tells, where it stands.
    bare = replace(description, anatomy=None)
    Rigged(Controller(bare, three_stages=classical(database)), target).step(user(0, 1))


def test_a_description_needs_stages(description):
    with pytest.raises(TypeError, match="give three stages"):
        Controller(description)


def test_a_projection_says_what_is_possible(database):
    tags = np.zeros(len(database), np.uint32)
    tags[10:20] = 1
    tags[15:30] |= 2
    index = classical(database).projection.index
    projection = stages.SearchProjection(index, tags, ignore_radius=20)
    asked = [(0, 0), (1, 0), (3, 0), (1, 2), (4, 0), (0, 3), (3, 1)]
    assert [projection.possible(*tags) for tags in asked] == [True, True, True, True, False, True, False]
