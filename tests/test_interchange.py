"""The public reference's binary files: byte for byte, and nothing foreign is taken for one."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mm import interchange
from mm.database import Database
from motion import quat
from motion.errors import UserError

FRAMES, JOINTS = 60, 4
PARENTS = np.array([-1, 0, 1, 1], np.int32)


def _raw(*, short: bool = False) -> interchange.Raw:
    """Two ranges of smooth motion of a tree of four joints, feet 2 and 3."""
    time = np.arange(FRAMES)[:, None] / 60
    phase = time + np.arange(JOINTS)
    positions = np.stack([0.1 * np.sin(phase), 0.2 + 0.05 * np.cos(phase), 0.3 * phase], -1)
    positions[:, 0] *= np.array([1, 0, 1])
    rotations = quat.from_yaw(0.3 * np.sin(phase))
    raw = interchange.Raw(
        positions.astype(np.float32),
        rotations.astype(np.float32),
        PARENTS,
        np.array([0, 35], np.int32),
        np.array([35, FRAMES], np.int32),
    )
    if not short:
        raw.velocities = (positions + 1).astype(np.float32)
        raw.angular_velocities = (positions - 2).astype(np.float32)
        raw.contacts = np.arange(2 * FRAMES, dtype=np.uint8).reshape(-1, 2) % 2
    return raw


ROLES = {"hips": "joint_1", "left_foot": "joint_2", "right_foot": "joint_3"}


def _folder(tmp_path: Path, *, short: bool = False) -> Path:
    folder = tmp_path / "reference"
    interchange.write_database(folder / "database.bin", _raw(short=short))
    return folder


def _assert_equal(found: interchange.Raw, expected: interchange.Raw) -> None:
    for name, array in vars(expected).items():
        if array is None:
            assert getattr(found, name) is None, name
        else:
            np.testing.assert_array_equal(getattr(found, name), array)


@pytest.mark.parametrize("short", [False, True])
def test_database_round_trip(tmp_path: Path, short: bool) -> None:
    path = tmp_path / "database.bin"
    interchange.write_database(path, _raw(short=short))
    _assert_equal(interchange.read_database(path), _raw(short=short))


def test_database_bytes_stand_as_documented(tmp_path: Path) -> None:
    path = tmp_path / "database.bin"
    raw = _raw()
    interchange.write_database(path, raw)
    sizes = struct.pack("<ii", FRAMES, JOINTS)
    expected = sizes + raw.positions.tobytes() + sizes + raw.velocities.tobytes()
    expected += sizes + raw.rotations.tobytes() + sizes + raw.angular_velocities.tobytes()
    expected += struct.pack("<i4i", JOINTS, -1, 0, 1, 1) + struct.pack("<iii", 2, 0, 35)
    expected += struct.pack("<iii", 2, 35, FRAMES) + struct.pack("<ii", FRAMES, 2) + raw.contacts.tobytes()
    assert path.read_bytes() == expected


def test_features_and_latents_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    arrays = [rng.standard_normal(shape).astype(np.float32) for shape in ((7, 3), 3, 3)]
    interchange.write_features(tmp_path / "features.bin", *arrays)
    for found, expected in zip(interchange.read_features(tmp_path / "features.bin"), arrays, strict=True):
        np.testing.assert_array_equal(found, expected)
    raw = (tmp_path / "features.bin").read_bytes()
    three = struct.pack("<i", 3)
    assert raw == struct.pack("<ii", 7, 3) + b"".join(
        [arrays[0].tobytes(), three, arrays[1].tobytes(), three, arrays[2].tobytes()]
    )
    interchange.write_latent(tmp_path / "latent.bin", arrays[0])
    np.testing.assert_array_equal(interchange.read_latent(tmp_path / "latent.bin"), arrays[0])
    assert (tmp_path / "latent.bin").read_bytes() == struct.pack("<ii", 7, 3) + arrays[0].tobytes()


@pytest.mark.parametrize("short", [False, True])
def test_every_truncation_of_a_database_is_refused(tmp_path: Path, short: bool) -> None:
    path = _folder(tmp_path, short=short) / "database.bin"
    raw = path.read_bytes()
    for cut in [*range(0, len(raw), 61), len(raw) - 1]:
        path.write_bytes(raw[:cut])
        with pytest.raises(UserError, match="cut short") as caught:
            interchange.read_database(path)
        assert caught.value.path == str(path) and caught.value.remedy


FOREIGN = {
    "empty": b"",
    "text": b"HIERARCHY\nROOT Hips\n{\n" * 50,
    "noise": np.random.default_rng(1).bytes(3000),
    "zeros": bytes(3000),
    "negative": struct.pack("<ii", -1, -1) * 20,
    "huge": struct.pack("<ii", 2**31 - 1, 2**31 - 1) * 20,
}


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "foreign.bin"
    path.write_bytes(content)
    for read in (interchange.read_database, interchange.read_features):
        with pytest.raises(UserError, match="not the public reference's"):
            read(path)
    if content != FOREIGN["zeros"]:
        with pytest.raises(UserError, match="not the public reference's"):
            interchange.read_latent(path)


WRONG = {
    "ranges that overlap": ({"starts": np.array([0, 30], np.int32)}, "ranges"),
    "ranges that end early": ({"stops": np.array([35, 59], np.int32)}, "ranges"),
    "one stop missing": ({"stops": np.array([60], np.int32)}, "stops"),
    "a second root": ({"parents": np.array([-1, -1, 1, 1], np.int32)}, "tree"),
    "a child before its parent": ({"parents": np.array([-1, 2, 1, 1], np.int32)}, "tree"),
    "too few parents": ({"parents": np.array([-1, 0], np.int32)}, "2 parents"),
    "no rotation": ({"rotations": np.zeros((FRAMES, JOINTS, 4), np.float32)}, "unit quaternions"),
    "contacts of 7": ({"contacts": np.full((FRAMES, 2), 7, np.uint8)}, "contacts"),
    "fewer velocities": ({"velocities": np.zeros((FRAMES - 1, JOINTS, 3), np.float32)}, "velocities"),
    "NaN": ({"positions": np.full((FRAMES, JOINTS, 3), np.nan, np.float32)}, "not finite at frame 0"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_an_inconsistent_database_is_refused(tmp_path: Path, changes: dict, message: str) -> None:
    raw = _raw()
    for name, array in changes.items():
        setattr(raw, name, array)
    interchange.write_database(tmp_path / "database.bin", raw)
    with pytest.raises(UserError, match=message):
        interchange.read_database(tmp_path / "database.bin")


def test_import_needs_roles_for_an_unknown_skeleton(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"left_foot.*joint_0, joint_1, joint_2, joint_3.*--roles"):
        interchange.import_directory(_folder(tmp_path))


def test_import_computes_features_and_export_keeps_everything(tmp_path: Path) -> None:
    db = interchange.import_directory(_folder(tmp_path), roles=ROLES, fps=30)
    assert db.fps == 30 and db.features.shape == (FRAMES, 27) and db.skeleton.role("root") == 0
    assert not db.mirrored.any() and db.names == ("range_0", "range_1")
    # Trajectory samples lie beyond these short ranges: the last frame of each sees itself at its own feet.
    ahead = db.features * db.scale + db.offset
    np.testing.assert_allclose(ahead[db.stops - 1, 15:21], 0, atol=1e-5)
    np.testing.assert_allclose(db.features.mean(axis=0), 0, atol=1e-4)

    written = interchange.export_directory(db, tmp_path / "out")
    assert [path.name for path in written] == ["database.bin", "features.bin"]
    assert written[0].read_bytes() == (tmp_path / "reference" / "database.bin").read_bytes()
    again = interchange.import_directory(tmp_path / "out", roles=ROLES)
    np.testing.assert_array_equal(again.features, db.features)
    interchange.export_directory(again, tmp_path / "twice")
    for path in written:
        assert (tmp_path / "twice" / path.name).read_bytes() == path.read_bytes()


def test_features_of_another_size_are_refused(tmp_path: Path) -> None:
    folder = _folder(tmp_path)
    for shape in ((FRAMES, 26), (FRAMES - 1, 27)):
        rows = np.zeros(shape, np.float32)
        interchange.write_features(folder / "features.bin", rows, rows[0], rows[0] + 1)
        with pytest.raises(UserError, match=rf"features of {shape[0]} frames x {shape[1]} columns"):
            interchange.import_directory(folder, roles=ROLES)


def test_names_may_be_given(tmp_path: Path) -> None:
    names = ["ground", "Hips", "LeftFoot", "RightFoot"]
    (tmp_path / "names.txt").write_text("\n".join(names) + "\n\n")
    assert interchange.load_names(tmp_path / "names.txt") == names
    db = interchange.import_directory(
        _folder(tmp_path), names=names, roles={"left_foot": "LeftFoot"} | ROLES_BY_NAME
    )
    assert db.skeleton.names == tuple(names) and db.skeleton.role("left_foot") == 2
    with pytest.raises(UserError, match="4 joints, but 3 different names"):
        interchange.import_directory(tmp_path / "reference", names=names[:3])


ROLES_BY_NAME = {"hips": "Hips", "right_foot": "RightFoot"}


def test_a_folder_without_database_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no database\.bin") as caught:
        interchange.import_directory(tmp_path)
    assert caught.value.path == str(tmp_path)


def test_the_short_layout_gets_velocities_and_contacts_by_range(tmp_path: Path) -> None:
    db = interchange.import_directory(_folder(tmp_path, short=True), roles=ROLES)
    raw = _raw()
    inner = slice(1, 34)
    expected = (raw.positions[2:35] - raw.positions[:33]) * 30
    np.testing.assert_allclose(db.poses.velocities[inner], expected, atol=1e-3)
    spin = 2 * np.arctan2(raw.rotations[..., 2], raw.rotations[..., 0])
    np.testing.assert_allclose(
        db.poses.angular_velocities[inner, :, 1], (spin[2:35] - spin[:33]) * 30, atol=1e-3
    )
    assert db.contact_roles == ("left_foot", "right_foot") and db.contacts.shape == (FRAMES, 2)


def test_a_mirrored_range_is_recognised(tmp_path: Path) -> None:
    raw = _raw()
    raw.starts, raw.stops = np.array([0, 30], np.int32), np.array([30, 60], np.int32)
    raw.positions[30:] = raw.positions[:30] * np.array([-1, 1, 1], np.float32)
    raw.contacts[30:] = raw.contacts[:30, ::-1]
    interchange.write_database(tmp_path / "database.bin", raw)
    db = interchange.import_directory(tmp_path, roles=ROLES)
    assert db.mirrored.tolist() == [False, True] and db.names == ("range_0", "range_0")


def test_the_reference_database_round_trips_byte_for_byte(data: Path, tmp_path: Path) -> None:
    oracle = data / "reference" / "oracle"
    db = interchange.import_directory(oracle)
    assert db.skeleton.names[1] == "Hips" and db.contact_roles == ("left_toe", "right_toe")
    assert len(db) == 2516 and db.mirrored.tolist() == [False, True, False, True]
    db.save(tmp_path / "db")
    interchange.export_directory(Database.load(tmp_path / "db"), tmp_path / "out")
    for name in ("database.bin", "features.bin"):
        assert (tmp_path / "out" / name).read_bytes() == (oracle / name).read_bytes(), name


def test_recomputed_features_equal_the_reference_program_s(data: Path, tmp_path: Path) -> None:
    oracle = data / "reference" / "oracle"
    interchange.write_database(tmp_path / "database.bin", interchange.read_database(oracle / "database.bin"))
    db = interchange.import_directory(tmp_path)
    features, offset, scale = interchange.read_features(oracle / "features.bin")
    np.testing.assert_allclose(db.scale, scale, rtol=1e-5)
    np.testing.assert_allclose(db.offset, offset, atol=1e-5)
    np.testing.assert_allclose(db.features, features, atol=2e-4)


def test_the_blend_space_database_is_imported(data: Path) -> None:
    db = interchange.import_directory(data / "reference" / "orangeduck_blendspace")
    assert len(db) == 1544 and len(db.starts) == 25 and db.skeleton.names[1] == "Hips"
    assert np.isfinite(db.features).all()
    speed = np.linalg.norm(db.poses.velocities[:, 0], axis=-1)
    assert 0.8 < np.median(speed) < 5 and 0.2 < db.contacts.mean() < 0.8


def test_an_export_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    db = interchange.import_directory(_folder(tmp_path), roles=ROLES)

    def full(path: Path, raw: interchange.Raw) -> None:
        raise UserError("cannot write: No space left on device", path=path)

    monkeypatch.setattr(interchange, "write_database", full)
    with pytest.raises(UserError, match="No space left"):
        interchange.export_directory(db, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), 1e9])
def test_an_import_at_a_rate_that_is_none_is_refused(tmp_path: Path, fps: float) -> None:
    with pytest.raises(UserError, match="rate between 1 and 1000"):
        interchange.import_directory(_folder(tmp_path), fps=fps)
