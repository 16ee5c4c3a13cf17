"""The database: what is stored comes back, memory-mapped, and damage is noticed."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
import synthetic

from features import presets
from mm.database import KIND, VERSION, Database
from motion import files
from motion.errors import UserError
from motion.pose import Poses


def _database(frames: int = 30) -> Database:
    """Random numbers in the right shapes: storage does not care what they mean."""
    rng = np.random.default_rng(2)
    skeleton, schema = synthetic.skeleton(), presets.load("lmm27")

    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    joints, size = len(skeleton), schema.size
    return Database(
        skeleton=skeleton,
        fps=30.0,
        schema=schema,
        poses=Poses(
            numbers(frames, joints, 3),
            numbers(frames, joints, 4),
            numbers(frames, joints, 3),
            numbers(frames, joints, 3),
        ),
        contacts=rng.integers(0, 2, (frames, 2)).astype(np.uint8),
        contact_roles=("left_toe", "right_toe"),
        features=numbers(frames, size),
        offset=numbers(size),
        scale=numbers(size),
        starts=np.array([0, 10], np.int32),
        stops=np.array([10, frames], np.int32),
        names=("läuft", "läuft"),
        mirrored=np.array([False, True]),
        tags=rng.integers(0, 4, frames).astype(np.uint32),
        tag_names=("run", "turn"),
    )


def test_round_trip(tmp_path: Path) -> None:
    db = _database()
    db.save(tmp_path / "db")
    again = Database.load(tmp_path / "db")
    for name, array in db.poses.arrays().items():
        np.testing.assert_array_equal(again.poses.arrays()[name], array)
    for name in ("contacts", "features", "offset", "scale", "starts", "stops", "mirrored", "tags"):
        found, expected = getattr(again, name), getattr(db, name)
        np.testing.assert_array_equal(found, expected)
        assert found.dtype == expected.dtype and isinstance(found, np.memmap) and not found.flags.writeable, (
            name
        )
    for name in ("fps", "contact_roles", "names", "tag_names", "fingerprint", "schema"):
        assert getattr(again, name) == getattr(db, name), name
    assert again.skeleton.same_joints(db.skeleton) and again.skeleton.roles == db.skeleton.roles
    np.testing.assert_array_equal(again.skeleton.offsets, db.skeleton.offsets)
    assert again.skeleton.end_sites.keys() == db.skeleton.end_sites.keys()
    assert again.memory() == db.memory()


def test_fingerprint_follows_the_content(tmp_path: Path) -> None:
    one, same, other = _database(), _database(), _database()
    other.tags = other.tags ^ np.uint32(1)
    marks = []
    for i, db in enumerate((one, same, other)):
        db.save(tmp_path / str(i))
        marks.append(db.fingerprint)
    assert marks[0] == marks[1] != marks[2]


def test_sizes() -> None:
    db = _database()
    assert len(db) == 30 and db.seconds == 1.0
    assert db.ranges().tolist() == [0] * 10 + [1] * 20 and db.ranges().dtype == np.int32
    memory = db.memory()
    assert memory["positions"] == 30 * 22 * 3 * 4 and memory["rotations"] == 30 * 22 * 4 * 4
    assert memory["features"] == (30 + 2) * 27 * 4 and memory["contacts"] == 60 and memory["tags"] == 120


def test_tag_masks() -> None:
    db = _database()
    assert db.tag_mask([]) == 0 and db.tag_mask(["turn"]) == 2 and db.tag_mask(("run", "turn")) == 3
    with pytest.raises(UserError, match=r"no tag 'jump'.*run, turn"):
        db.tag_mask(["jump"])


def test_damage_and_another_version_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "db"
    _database().save(path)
    raw = path.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(raw), 50):
        wrong = bytearray(raw)
        wrong[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(wrong)
        with pytest.raises(UserError):
            Database.load(path)
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(UserError, match="cut short"):
        Database.load(path)
    files.save(path, KIND, VERSION - 1, {}, {})
    with pytest.raises(UserError, match=f"format version {VERSION - 1}, this program reads {VERSION}"):
        Database.load(path)
    files.save(path, "recording", 1, {}, {})
    with pytest.raises(UserError, match="a recording, expected a motion database"):
        Database.load(path)


@pytest.mark.parametrize("name", ["my clips", "walk.bvh", "hero.GLB"])
def test_who_gives_clips_is_told_how_to_build_a_database(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if "." in name:
        path.write_text("HIERARCHY")
    else:
        path.mkdir()
    with pytest.raises(UserError, match="expected a motion database") as error:
        Database.load(path)
    assert f"mm build {shlex.quote(str(path))} -o" in str(error.value)


CHANGES = {
    "no rate": (lambda m, a: m.pop("fps"), "no 'fps'"),
    "a rate of text": (lambda m, a: m.update(fps="60"), "damaged"),
    "a rate of 0": (lambda m, a: m.update(fps=0), "0 frames per second"),
    "no skeleton": (lambda m, a: m.update(skeleton=[1]), "damaged"),
    "a role of no joint": (lambda m, a: m["skeleton"]["roles"].update(head=99), "does not have"),
    "a cycle": (lambda m, a: m["skeleton"]["parents"].__setitem__(1, 5), "parents before children"),
    "another schema": (lambda m, a: m["schema"].update(features=m["schema"]["features"][:1]), "features are"),
    "an unknown feature": (lambda m, a: m["schema"]["features"][0].update(kind="smell"), "no choice"),
    "fewer names": (lambda m, a: m.update(names=["x"]), "1 names of 2 ranges"),
    "no features": (lambda m, a: a.pop("features"), "features"),
    "an array too many": (lambda m, a: a.update(more=np.zeros(3)), "more"),
    "other poses": (lambda m, a: a.update(positions=a["positions"][1:]), "positions are"),
    "another type": (lambda m, a: a.update(tags=a["tags"].astype(np.float32)), "tags are float32"),
    "a range beyond the end": (lambda m, a: a.update(stops=a["stops"] + np.int32(1)), "do not cover"),
    "ranges backwards": (lambda m, a: a.update(starts=a["starts"][::-1].copy()), "do not cover"),
    "no frames": (lambda m, a: a.update({k: v[:0] for k, v in a.items()}), "damaged"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_foreign_content_under_a_right_checksum_is_refused(tmp_path: Path, change: str) -> None:
    _database().save(tmp_path / "db")
    metadata, arrays, _ = files.load(tmp_path / "db", KIND, VERSION)
    edit, message = CHANGES[change]
    edit(metadata, arrays)
    del metadata["format"], metadata["version"]
    files.save(tmp_path / "other", KIND, VERSION, metadata, arrays)
    with pytest.raises(UserError, match=message) as caught:
        Database.load(tmp_path / "other")
    assert caught.value.path == str(tmp_path / "other") and "damaged motion database" in str(caught.value)
