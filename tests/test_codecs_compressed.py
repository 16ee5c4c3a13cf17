"""Compressed databases: what is stored comes back, damage is noticed, errors and bytes are what they are."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mm.build import build
from mm.codecs import errors
from mm.codecs.codec import parse
from mm.codecs.compressed import KIND, VERSION, Compressed, compress
from mm.database import Database
from motion import files
from motion.errors import UserError

CODECS = (
    ("float32", "float32"), ("float16", "float16"), ("recomputed", "8bit"), ("quantised-11", "pq"),
    ("keyframes-1+quantised-11", "8bit"),
)  # fmt: skip


@pytest.fixture(scope="module")
def database(walker_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Database:
    tags = tmp_path_factory.mktemp("tags") / "tags.csv"
    tags.write_text("tag,clips\nturn,*_turn\nrun,run\n")
    built = build([walker_files], jobs=1, tags=tags)
    built.save(tags.parent / "db")
    return built


@pytest.mark.parametrize(("name", "features"), CODECS)
def test_round_trip(database: Database, tmp_path: Path, name: str, features: str) -> None:
    small = compress(database, parse(name, features=features))
    small.errors = errors.measure(database, small)
    small.save(tmp_path / "small")
    again = Compressed.load(tmp_path / "small")
    for part, array in small.tables.arrays().items():
        np.testing.assert_array_equal(again.tables.arrays()[part], array, err_msg=part)
    for part in ("features", "origins", "mirrored", "tags", "starts", "stops"):
        np.testing.assert_array_equal(getattr(again, part), getattr(small, part), err_msg=part)
    for part in ("codec", "names", "errors", "fingerprint", "fps"):
        assert getattr(again, part) == getattr(small, part), part
    assert again.description.fingerprint == database.fingerprint != again.fingerprint
    assert again.memory() == small.memory() and len(again) == len(database) == 3000
    assert abs(sum(again.memory().values()) - (tmp_path / "small").stat().st_size) < 15_000  # its header
    frames = np.array([0, 299, 300, 1234, 2999], np.int32)
    for one, other in zip(again.decode(frames), small.decode(frames), strict=True):
        for a, b in zip(
            *(x.arrays().values() if hasattr(x, "arrays") else [x] for x in (one, other)), strict=True
        ):
            np.testing.assert_array_equal(a, b)


def test_the_same_content_has_the_same_fingerprint(database: Database, tmp_path: Path) -> None:
    marks = []
    for i, name in enumerate(("quantised-11", "quantised-11", "quantised-12")):
        small = compress(database, name, rigs=False)
        small.save(tmp_path / str(i))
        marks.append(small.fingerprint)
    assert marks[0] == marks[1] != marks[2]


def test_what_is_not_rounded_is_the_database_again(database: Database) -> None:
    again = compress(database, "float32", rigs=False).decoded()
    same = (again.poses.rotations[:, :1] * database.poses.rotations[:, :1]).sum(-1, keepdims=True) > 0
    again.poses.rotations[:, :1] *= np.where(same, 1, -1)  # either sign is the same rotation
    for part, array in database.poses.arrays().items():
        np.testing.assert_allclose(again.poses.arrays()[part], array, atol=2e-5, err_msg=part)
    for part in ("contacts", "features", "tags", "starts", "stops", "mirrored"):
        np.testing.assert_array_equal(getattr(again, part), getattr(database, part))
    again.validate()


def test_errors_are_those_of_what_is_decoded(database: Database) -> None:
    exact = errors.measure(database, compress(database, "float32", rigs=False))
    assert exact["position_cm"]["max"] == 0 == exact["contacts_wrong"]
    assert exact["rotation_deg"]["max"] < 1e-9
    assert exact["features_deviations"]["max"] == 0 and exact["root_cm"] < 0.01
    small = compress(database, parse("quantised-11", features="8bit"), rigs=False)
    found = errors.measure(database, small)
    assert 0.05 < found["rotation_deg"]["max"] < 0.138
    for spread in (found["position_cm"], found["velocity_cm_s"], found["features_deviations"]):
        assert 0 < spread["mean"] < spread["p99"] < spread["max"]
    # A joint that is moved by a centimetre in every frame is a centimetre off, and so is what hangs on it.
    moved = small.tables.bones.copy()
    moved[database.skeleton.index("LeftLeg"), 1] += 0.01
    worse = errors.measure(database, _with(small, bones=moved))
    below = 3 / (len(database.skeleton) - 1)  # knee, foot and toe
    assert worse["position_cm"]["mean"] == pytest.approx(below + found["position_cm"]["mean"], abs=0.03)


def test_bytes_shrink_with_the_codec(database: Database) -> None:
    sizes = [
        sum(compress(database, parse(name, features=features), rigs=False).memory().values())
        for name, features in CODECS
    ]
    before = sum(database.memory().values())
    assert before > sizes[0] > sizes[2] > sizes[1] > sizes[3] > sizes[4]
    assert sizes[1] < 0.52 * before and sizes[3] < 0.11 * before


def test_damage_and_another_kind_are_refused(database: Database, tmp_path: Path) -> None:
    path = tmp_path / "small"
    compress(database, "quantised-11", rigs=False).save(path)
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 4
    path.write_bytes(raw)
    with pytest.raises(UserError, match="checksum"):
        Compressed.load(path)
    database.save(path)
    with pytest.raises(UserError, match=f"a motion database, expected a {KIND}"):
        Compressed.load(path)


def _with(small: Compressed, **changes: np.ndarray) -> Compressed:
    return replace(small, tables=small.tables.having(changes))


CHANGES = {
    "no codec": (lambda m, a: m.pop("codec"), "no 'codec'"),
    "another codec": (lambda m, a: m["codec"].update(numbers="float16", bits=0), "halves are"),
    "too many bits": (lambda m, a: m["codec"].update(bits=40), "40 bits"),
    "other bits": (lambda m, a: m["codec"].update(bits=12), "packed are"),
    "fewer rows": (lambda m, a: a.update({"poses.packed": a["poses.packed"][1:]}), "packed are"),
    "a key beyond": (lambda m, a: a["poses.keys"].__setitem__(-1, 3000), "key frames"),
    "keys backwards": (lambda m, a: a.update({"poses.keys": a["poses.keys"][::-1].copy()}), "key frames"),
    "a joint beyond": (lambda m, a: a["poses.turning"].__setitem__(0, 99), "turning"),
    "the root turned": (lambda m, a: a["poses.moving"].__setitem__(0, 0), "moving"),
    "no features": (lambda m, a: a.pop("features.codes"), "no 'codes'"),
    "a code beyond": (lambda m, a: a["features.codes"].__setitem__((0, 0), 255), "codes"),
    "fewer tags": (lambda m, a: a.update(tags=a["tags"][1:]), "tags are"),
    "ranges beyond": (lambda m, a: a["poses.stops"].__setitem__(0, 301), "do not cover"),
    "fewer names": (lambda m, a: m.update(names=["x"]), "1 names of 10 ranges"),
    "fewer contacts": (lambda m, a: a.update({"poses.contacts": a["poses.contacts"][1:]}), "contacts are"),
    "an array too many": (lambda m, a: a.update({"poses.more": np.zeros(3)}), "more"),
    "text for a rate": (lambda m, a: m["description"].update(fps="60"), "damaged"),
}


@pytest.fixture(scope="module")
def stored(database: Database, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stored") / "small"
    compress(database, parse("keyframes-1+quantised-11", features="pq"), rigs=False).save(path)
    return path


@pytest.mark.parametrize("change", CHANGES)
def test_foreign_content_under_a_right_checksum_is_refused(stored: Path, tmp_path: Path, change: str) -> None:
    metadata, arrays, _ = files.load(stored, KIND, VERSION)
    metadata = deepcopy(metadata)
    arrays = {name: np.array(array) for name, array in arrays.items()}
    edit, message = CHANGES[change]
    edit(metadata, arrays)
    del metadata["format"], metadata["version"]
    files.save(tmp_path / "other", KIND, VERSION, metadata, arrays)
    with pytest.raises(UserError, match=message) as caught:
        Compressed.load(tmp_path / "other")
    assert caught.value.path == str(tmp_path / "other")
