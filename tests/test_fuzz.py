"""A fixed share of the fuzzing of readers; ``python -m tests.fuzz`` goes on for as long as it is let."""

from __future__ import annotations

import io
import random
import re
import struct
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from fuzz import documents, engine, grammar, targets
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motion import asfamc, bvh
from motion.errors import UserError

BUDGET = settings(
    max_examples=60,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.mark.parametrize("name", targets.TARGETS)
def test_seeds_are_read_and_spoiled_ones_are_read_or_refused(tmp_path: Path, name: str) -> None:
    target, rng = targets.get(name), random.Random(name)
    seeds = target.seeds()
    outcomes = [targets.run(target, seed, tmp_path) for seed in seeds]
    assert set(outcomes) == {"read"}
    for _ in range(120):
        data = targets.spoil(target, rng, rng.choice(seeds), rng.choice(seeds))
        outcomes.append(targets.run(target, data, tmp_path))
    assert set(outcomes) == {"read", "refused"}


@BUDGET
@given(grammar.bvh())
def test_bvh_by_grammar(tmp_path: Path, text: str) -> None:
    """What the grammar makes is read but for a few names and sizes, and comes back when written."""
    outcome = targets.run(targets.get("bvh"), text.encode(), tmp_path)
    plain = text.isascii() and "{b" not in text and "CHANNELS 0" not in text
    assert outcome == "read" or not plain or _excused(tmp_path / "file.bvh")


def _excused(path: Path) -> bool:
    """Names that begin like other statements of the file, on which the grammar does not watch out."""
    with pytest.raises(UserError) as error:
        bvh.parse(path)
    return any(
        word in error.value.what for word in ("name", "expected '{'", "no joint has channels", "MOTION")
    )


@BUDGET
@given(grammar.nearly(grammar.bvh()))
def test_bvh_nearly_by_grammar(tmp_path: Path, text: str) -> None:
    targets.run(targets.get("bvh"), text.encode(), tmp_path)


@BUDGET
@given(grammar.acclaim())
def test_acclaim_by_grammar(tmp_path: Path, files: tuple[str, str]) -> None:
    for suffix, content in zip(("asf", "amc"), files, strict=True):
        (tmp_path / f"a.{suffix}").write_text(content)
    assert len(asfamc.read(tmp_path / "a.amc")) == files[1].count("root ")


@BUDGET
@given(grammar.acclaim(), st.data())
def test_acclaim_nearly_by_grammar(tmp_path: Path, files: tuple[str, str], data: st.DataObject) -> None:
    for suffix, content in zip(("asf", "amc"), files, strict=True):
        (tmp_path / f"a.{suffix}").write_text(data.draw(grammar.nearly(st.just(content))))
    try:
        asfamc.read(tmp_path / "a.amc")
    except UserError as error:
        assert error.path and error.line != 0


TOML = {
    "roles": (("roles",), ("left_foot", "hips", "x", "roles")),
    "schema": (("features",), ("name", "features", "kind", "role", "times", "weight", "scaler", "function")),
    "settings": (("settings",), ("period", "blend", "seed", "search", "settings")),
    "course": (
        ("waypoints", "sticks", "velocities", "user", "boxes", "circles"),
        ("name", "position", "speed", "time", "velocity", "facing", "radius", "loop", "seconds", "stick"),
    ),
    "tags-toml": (("tags",), ("tag", "clips", "start", "stop", "tags")),
}


@pytest.mark.parametrize("name", TOML)
@BUDGET
@given(st.data())
def test_toml_by_grammar(tmp_path: Path, name: str, data: st.DataObject) -> None:
    text = data.draw(grammar.toml(*TOML[name]))
    targets.run(targets.get(name), text.encode(), tmp_path)


def test_failing_inputs_are_made_smaller_and_lines_counted(tmp_path: Path) -> None:
    data = bytes(range(200)) * 3
    assert engine.minimised(data, lambda d: d.count(7) >= 2 and 150 in d) in (
        b"\x07\x96\x07",
        b"\x07\x07\x96",
    )
    for part in ("corpus", "scratch"):
        (tmp_path / part).mkdir()
    before = engine.lines_reached("tags", tmp_path)
    (tmp_path / "corpus" / "one").write_bytes(documents.TAGS)
    after = engine.lines_reached("tags", tmp_path)
    assert list(after) == ["mm/tags.py"] and before["mm/tags.py"][0] == 0
    assert 10 < after["mm/tags.py"][0] < after["mm/tags.py"][1]


# What fuzzing found, and what must cost no memory


def _archive(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return out.getvalue()


def _array(header: str, data: bytes = b"") -> bytes:
    text = header.encode() + b" " * (-(11 + len(header)) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def _header(kind: str, shape: tuple[int, ...]) -> str:
    return repr({"descr": kind, "fortran_order": False, "shape": shape})


def _npz(**changed: bytes) -> bytes:
    plain = {
        "fps": _array(_header("<f8", ()), struct.pack("<d", 30)),
        "parents": _array(_header("<i4", (2,)), struct.pack("<2i", -1, 0)),
        "positions": _array(_header("<f8", (2, 2, 3)), struct.pack("<12d", *range(12))),
    }
    return _archive(plain | changed)


def _times(last: float) -> bytes:
    """A GLB file whose keys stand at 0, 1/30, ... and `last` seconds."""
    data = documents.gltf(binary=True)
    old = struct.pack("<5f", *(k / 30 for k in range(5)))
    assert old in data
    return data.replace(old, old[:16] + struct.pack("<f", last))


def _many_joints(count: int) -> bytes:
    """``database.bin`` of one frame and many joints, all hanging on the first."""
    size, turns = struct.pack("<2i", 1, count), struct.pack("<4f", 1, 0, 0, 0) * count
    parents = struct.pack(f"<{count + 1}i", count, -1, *[0] * (count - 1))
    return size + bytes(12 * count) + size + turns + parents + struct.pack("<4i", 1, 0, 1, 1)


FOUND: dict[str, tuple[str, bytes, str]] = {
    "a key of two lines": ("roles", b'"a\\nb" = 1', "'a\\\\nb': unknown key|unknown key"),
    "a long key": ("settings", b"a" * 5000 + b" = 1", r"aaa\.\.\."),
    "a long header": ("tags", b"tag," * 3000, "header 'tag,tag"),
    "lines that only Python counts": ("tags", b'tag,clips\n"' + b"\x0b" * 9, ":2: not CSV"),
    "a name of two hundred words": ("bvh", documents.BVH.replace(b"Left Leg", 200 * b"Left "), ""),
    "a count of thousands of digits": (
        "bvh", documents.BVH.replace(b"CHANNELS 6", b"CHANNELS " + b"9" * 5000), "needs a count"),
    "thousands of joints": ("reference", _many_joints(3000), "3000 joints, at most 1000"),
    "rotations beyond floats": (
        "reference", documents.reference_database(short=True).replace(
            struct.pack("<f", documents.chain()[1][0, 0, 0]), b"\xff\xff\x7f\x7f"), "not unit quaternions"),
    "a header that is no Python": ("npz", _npz(fps=_array("{\n  1\n 2")), "not an NPZ file"),
    "a header with an open bracket": ("npz", _npz(fps=_array("({")), "not an NPZ file"),
    "no letters": (
        "npz", _npz(names=_array(_header("<U1", (2,)), b"\xff" * 8)), "names holds what are no letters"),
    "letters of no size": ("npz", _npz(names=_array(_header("<U0", (2,)))), "of type <U0"),
    "a signalling NaN": (
        "npz", _npz(positions=_array(_header("<f4", (2, 2, 3)), 12 * b"\x01\x00\xa0\x7f")), "finite number"),
    "an array of terabytes": (
        "npz", _npz(positions=_array(_header("<f8", (10**12, 2, 3)))), "which is .* GiB"),
    "an archive of zeros": (
        "npz", _npz(positions=_array(_header("|i1", (2_000_000, 2, 3)), bytes(12_000_000))), "no motion"),
    "keys a day apart": ("glb", _times(86_400), "keys may not be minutes apart"),
}  # fmt: skip


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_stays_mended(tmp_path: Path, name: str) -> None:
    reader, data, message = FOUND[name]
    target = targets.get(reader)
    tracemalloc.start()
    try:
        outcome = targets.run(target, data, tmp_path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert outcome == ("refused" if message else "read")
    assert peak < 30e6 + 30 * len(data)
    if message:
        with pytest.raises(UserError) as error:
            target.read(tmp_path / f"file{target.suffix}")
        assert re.search(message, str(error.value))


# Size


def _twins(count: int) -> str:
    """A skeleton of `count` joints: chains that all look like legs."""
    names = [f"Left{part}{k}" for k in range(count // 3) for part in ("UpLeg", "Leg", "Foot")]
    joints = "".join(f"JOINT {n} {{ OFFSET 0 -1 0 CHANNELS 0\n" for n in names)
    head = "HIERARCHY\nROOT r { OFFSET 0 0 0 CHANNELS 3 Xposition Yposition Zposition\n"
    return f"{head}{joints}{'}' * (len(names) + 1)}\nMOTION\nFrames: 1\nFrame Time: 1\n0 0 0\n"


BVH, AMC, ASF = (text.decode() for text in (documents.BVH, documents.AMC, documents.ASF))
FRAME = AMC.split("\n2\n")[1]
ROW = "2 90.1 0 0 0 1E-3  1 2 3  -42\n"
GROWING: dict[str, tuple[str, Callable[[int], str]]] = {
    "rows": ("bvh", lambda n: BVH.replace("Frames: 3", f"Frames: {n + 3}") + n * ROW),
    "rows of doubtful numbers": ("bvh", lambda n: BVH + n * ROW.replace("90.1", "1." + 19 * "3")),
    "rows too many": ("bvh", lambda n: BVH + n * ROW),
    "blank lines": ("bvh", lambda n: BVH.replace("MOTION", n * "\n" + "MOTION" + n * " \n")),
    "comments": ("bvh", lambda n: n * "# x\n" + BVH),
    "one line": ("bvh", lambda n: BVH.replace("{\n", "{" + n * " OFFSET 1 2 3 }", 1)),
    "end sites on one line": (
        "bvh", lambda n: BVH.replace("JOINT", n * "End Site { CHANNELS 0 } " + "JOINT", 1),
    ),
    "a long name": ("bvh", lambda n: BVH.replace("Left Leg", n * "Left ")),
    "carriage returns": ("bvh", lambda n: BVH.replace("\n", n * "\r" + "\n", 1)),
    "brackets": ("roles", lambda n: "a = " + n * "[" + n * "]"),
    "keys": ("roles", lambda n: "[roles]\n" + "".join(f"a{k} = 1\n" for k in range(n // 10))),
    "frames": ("amc", lambda n: AMC + "".join(f"{k}\n{FRAME}" for k in range(3, n // 3))),
    "numbers": ("amc", lambda n: AMC.replace("ltibia 31", "ltibia" + n * " 31")),
    "bones": ("asf", lambda n: ASF.replace(":bonedata", ":bonedata\n" + n * "# x\n" + n * "begin\n")),
    "tags": ("tags", lambda n: "tag,clips\n" + "".join(f"t{k},c{k}\n" for k in range(n // 10))),
    "quotes": ("tags", lambda n: "tag,clips\n" + n * '"a\n'),
    "names": ("names", lambda n: n * "name\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", GROWING)
def test_four_times_the_size_costs_about_four_times_the_time(tmp_path: Path, name: str) -> None:
    reader, document = GROWING[name]
    target = targets.get(reader)

    def seconds(count: int) -> float:
        data, best = document(count).encode(), 1e9
        for _ in range(3):
            start = time.process_time()
            targets.run(target, data, tmp_path)
            best = min(best, time.process_time() - start)
        return best

    seconds(10)
    small, large = seconds(4_000), seconds(16_000)
    assert large < 10 * small + 0.2  # sixteen times, were it quadratic


def test_a_thousand_joints_that_look_like_legs(tmp_path: Path) -> None:
    start = time.process_time()
    targets.run(targets.get("bvh"), _twins(999).encode(), tmp_path)
    assert time.process_time() - start < 60  # not a speed: the difference between thousands and billions
