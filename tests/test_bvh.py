"""BVH: what a file says is what is read, what is read is what is written, and nothing broken gets in."""

from __future__ import annotations

import itertools
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import bvh, euler, kinematics, quat
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton, distinct

ARM = """HIERARCHY
ROOT Hips
{
  OFFSET 100 200 300
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Arm
  {
    OFFSET 1 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Hand
    {
      OFFSET 7 7 7
      CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0.5 0 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
0 1 0 0 0 0  0 0 0  2 0 0 0 0 0
0 1 0 90 0 0  0 0 90  3 0 0 0 0 0
"""
ARM_LINES = ARM.split("\n")
ROW = 1 + ARM_LINES.index("0 1 0 0 0 0  0 0 0  2 0 0 0 0 0")


@pytest.fixture
def save(tmp_path):
    def write(content: str | bytes, name: str = "file.bvh") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def same(a: bvh.BvhDocument, b: bvh.BvhDocument) -> bool:
    return (
        a.names == b.names
        and a.channels == b.channels
        and a.frame_time == b.frame_time
        and np.array_equal(a.parents, b.parents)
        and np.array_equal(a.offsets, b.offsets)
        and [[end.tolist() for end in ends] for ends in a.end_sites]
        == [[end.tolist() for end in ends] for ends in b.end_sites]
        and np.array_equal(a.values.view(np.uint64), b.values.view(np.uint64))
    )


def world(clip: Clip) -> np.ndarray:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


# Reading


def test_positions_by_hand(save):
    clip = bvh.read(save(ARM), unit_to_m=0.01)
    assert clip.name == "file" and clip.fps == 30 and clip.unit_to_m == 0.01 and len(clip) == 2
    assert clip.skeleton.names == ("Hips", "Arm", "Hand")
    assert clip.skeleton.parents.tolist() == [-1, 0, 1]
    assert {j: end.tolist() for j, end in clip.skeleton.end_sites.items()} == {2: [0.005, 0, 0]}
    # Frame 2: the hips turn x to y, the arm turns x to -z. Position channels replace both stale offsets.
    expected = [[[0, 1, 0], [1, 1, 0], [3, 1, 0]], [[0, 1, 0], [0, 2, 0], [0, 2, -3]]]
    np.testing.assert_allclose(world(clip) * 100, expected, atol=1e-12)


def test_document_by_hand(save):
    document = bvh.parse(save(ARM))
    assert document.frame_time == "0.0333333"
    assert document.channels[1] == ("Zrotation", "Xrotation", "Yrotation")
    assert document.values.shape == (2, 15)
    assert document.values[1].tolist() == [0, 1, 0, 90, 0, 0, 0, 0, 90, 3, 0, 0, 0, 0, 0]
    assert document.offsets.tolist() == [[100, 200, 300], [1, 0, 0], [7, 7, 7]]


SPELLINGS = {
    "crlf": ARM.replace("\n", "\r\n"),
    "old line ends": ARM.replace("\n", "\r"),
    "mixed line ends": ARM.replace("\n", "\r\n", 12),
    "tabs": ARM.replace("  ", "\t").replace(" ", "\t").replace("End\tSite", "End Site"),
    "no newline at the end": ARM.rstrip("\n"),
    "blank lines": ARM.replace("\n", "\n\n \t\n"),
    "blank lines behind": ARM + "\n\n  \n",
    "byte order mark": "\ufeff" + ARM,
    "comments": "# made by hand\n" + ARM.replace("MOTION", "// now\nMOTION\n# rows"),
    "lower case": ARM.lower().replace("hips", "Hips").replace("arm", "Arm").replace("hand", "Hand"),
    "upper case keywords": ARM.replace("Site", "SITE").replace("Frame Time", "FRAME TIME").upper()
    .replace("HIPS", "Hips").replace("ARM", "Arm").replace("HAND", "Hand"),
    "scientific": ARM.replace("90", "9.0e+01").replace(" 7 ", " 700E-2 ").replace("0.5", "+5e-1"),
    "braces on the line": ARM.replace("Hips\n{", "Hips {").replace(" Arm\n  {", " Arm{")
    .replace("}\n    }", "} }"),
    "on one line": " ".join(ARM_LINES[:20]) + "\n" + "\n".join(ARM_LINES[20:]),
    "no colons": ARM.replace("Frames:", "Frames").replace("Frame Time:", "Frame Time"),
    "time before frames": ARM.replace("Frames: 2\n", "").replace("0.0333333", "0.0333333\nFrames:\t2"),
    "a channel list in mixed case": ARM.replace("Zrotation", "zRotation").replace("Xposition", "XPOSITION"),
}  # fmt: skip


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings(save, spelling):
    assert same(bvh.parse(save(SPELLINGS[spelling])), bvh.parse(save(ARM, "plain.bvh")))


def test_names_with_spaces_and_foreign_letters(save):
    text = ARM.replace("JOINT Arm", "JOINT  Left Upper Arm ").replace("JOINT Hand", "JOINT Händ MOTION")
    for encoding in ("utf-8", "latin-1"):
        document = bvh.parse(save(text.encode(encoding)))
        assert document.names == ("Hips", "Left Upper Arm", "Händ MOTION")


@pytest.mark.parametrize("order", ["".join(p) for p in itertools.permutations("XYZ")])
def test_every_channel_order(save, order):
    rng = np.random.default_rng(3)
    angles, place = rng.uniform(-180, 180, 3), rng.normal(size=3)
    channels = [f"{axis}rotation" for axis in order]
    for axis in "ZXY":  # positions in an order of their own, between the rotations
        channels.insert(rng.integers(0, len(channels) + 1), f"{axis}position")
    value = {f"{a}rotation": v for a, v in zip(order, angles, strict=True)}
    value |= {f"{a}position": v for a, v in zip("XYZ", place, strict=True)}
    row = " ".join(repr(float(value[channel])) for channel in channels)
    text = (
        f"HIERARCHY\nROOT A\n{{\nOFFSET 0 0 0\nCHANNELS 6 {' '.join(channels)}\n"
        "End Site\n{\nOFFSET 0 1 0\n}\n}\n"
        f"MOTION\nFrames: 1\nFrame Time: 0.01\n{row}\n"
    )
    clip = bvh.read(save(text))
    np.testing.assert_array_equal(clip.positions[0, 0], place)
    truth = Rotation.from_euler(order, angles, degrees=True).as_matrix()
    np.testing.assert_allclose(quat.to_matrix(clip.rotations)[0, 0], truth, atol=1e-12)


def test_partial_channels(save):
    text = ARM.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 2 Yposition Xrotation")
    text = text.replace("  0 0 0  2", "  5 0  2").replace("  0 0 90  3", "  6 90  3")
    clip = bvh.read(save(text))
    assert clip.positions[:, 1].tolist() == [[1, 5, 0], [1, 6, 0]]  # x and z stay with the offset
    np.testing.assert_allclose(quat.to_euler(clip.rotations[1, 1], "xyz"), [np.pi / 2, 0, 0], atol=1e-12)


def test_a_joint_without_channels(save):
    text = ARM.replace("    CHANNELS 3 Zrotation Xrotation Yrotation\n", "").replace("  0 0 0  ", "  ")
    clip = bvh.read(save(text.replace("  0 0 90  ", "  ")))
    assert clip.rotations[1, 1].tolist() == [1, 0, 0, 0]


def test_several_end_sites(save):
    site = "      End Site\n      {\n        OFFSET 0.5 0 0\n      }\n"
    path = save(ARM.replace(site, site + site.replace("0.5", "0.25")))
    document = bvh.parse(path)
    assert [end.tolist() for end in document.end_sites[2]] == [[0.5, 0, 0], [0.25, 0, 0]]
    assert bvh.read(path).skeleton.end_sites[2].tolist() == [0.5, 0, 0]
    assert same(bvh.parse(save(bvh.serialise(document))), document)


def test_joints_of_one_name_are_told_apart(save):
    document = bvh.parse(save(ARM.replace("JOINT Hand", "JOINT Arm")))
    assert document.names == ("Hips", "Arm", "Arm")
    assert bvh.to_clip(document, name="x").skeleton.names == ("Hips", "Arm", "Arm 2")


@pytest.mark.parametrize(
    ("printed", "fps"),
    [
        ("0.008333", 120),
        ("0.00833333", 120),
        ("0.0083333333333333332", 120),
        ("0.016667", 60),
        ("0.0166667", 60),
        ("0.0333333", 30),
        ("0.033333", 30),
        ("0.0333", 30),
        ("0.033", 30),
        (".0333333", 30),
        ("3.33333e-02", 30),
        ("0.041667", 24),
        ("0.06666666", 15),
        ("0.04", 25),
        ("0.02", 50),
        ("0.01", 100),
        ("0.005", 200),
        ("0.0333667", 30000 / 1001),
        ("0.033367", 30000 / 1001),
        ("0.0334", 30000 / 1001),
        ("0.0166833", 60000 / 1001),
        ("0.0076923", 130),
        ("0.035", 1 / 0.035),
        ("1", 1),
        ("2.5", 0.4),
    ],
)
def test_frame_rates(printed, fps):
    assert bvh.frame_rate(printed) == pytest.approx(fps, rel=1e-12)


def test_rate_given_by_hand(save):
    assert bvh.read(save(ARM), fps=60).fps == 60


def test_euler_kernel_equals_its_twin():
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.normal(size=(200, 9)) * 40, axis=0)
    columns = np.array([[0, 1, 2], [5, 3, 4], [8, -1, -1], [6, 7, -1], [-1, -1, -1]])
    axes = np.array([[2, 0, 1], [1, 0, 2], [2, -1, -1], [0, 2, -1], [-1, -1, -1]])
    fast, plain = euler.unrolled(values, columns, axes), euler.unrolled_plain(values, columns, axes)
    np.testing.assert_allclose(fast, plain, atol=1e-12)
    assert (np.sum(fast[1:] * fast[:-1], axis=-1) >= 0).all()


# Writing


def test_documents_come_back_exactly(save):
    numbers = (
        "-0 1e-7 123456.789012345 0.1 -3.0000000000000004 5.1072e-06 -5.51764e-07 1e-300 .5 7 8 9 10 11 12"
    )
    path = save(ARM.replace("0 1 0 0 0 0  0 0 0  2 0 0 0 0 0", numbers))
    first = bvh.parse(path)
    once = bvh.serialise(first)
    again = bvh.parse(save(once))
    assert same(first, again)
    assert bvh.serialise(again) == once
    assert b"-0 0.0000001 123456.789012345 0.1 -3.0000000000000004 0.0000051072" in once


def test_real_documents_come_back_exactly(data, save):
    for name in (
        "bandai/dataset-1/dataset-1_dash_active_001.bvh",
        "cmu/daz_bvh/02/02_01.bvh",
        "cmu/labelled_60fps/16_13_60fps.bvh",
        "dog_mann/D1_010_KAN01_002.bvh",
        "pfnn/animations/rest.bvh",
    ):
        first = bvh.parse(data / name)
        once = bvh.serialise(first)
        assert same(bvh.parse(save(once)), first), name


@pytest.mark.parametrize("order", ["".join(p) for p in itertools.permutations("xyz")])
def test_clips_come_back(walker, tmp_path, order):
    path = tmp_path / "sub" / "walker.bvh"
    bvh.write(path, walker, unit_to_m=0.01, order=order)
    clip = bvh.read(path, unit_to_m=0.01)
    assert clip.fps == walker.fps and clip.name == "walker"
    assert sorted(clip.skeleton.names) == sorted(walker.skeleton.names)
    place = [clip.skeleton.index(name) for name in walker.skeleton.names]
    np.testing.assert_allclose(world(clip)[:, place], world(walker), atol=1e-6)


def test_more_decimals_keep_more(walker, tmp_path):
    bvh.write(tmp_path / "a.bvh", walker, decimals=12)
    clip = bvh.read(tmp_path / "a.bvh")
    place = [clip.skeleton.index(name) for name in walker.skeleton.names]
    np.testing.assert_allclose(world(clip)[:, place], world(walker), atol=1e-10)


def test_only_joints_that_move_get_positions(tmp_path):
    # Children are listed out of depth-first order; B stands still away from its offset, C moves.
    skeleton = Skeleton(
        ("root", "A", "C", "B"),
        np.array([-1, 0, 0, 1]),
        np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [9, 9, 9]]),
        end_sites={2: np.array([0, 0.25, 0])},
    )
    positions = np.repeat(skeleton.offsets[None], 5, axis=0)
    positions[:, 3] = [0, 0, 2]
    positions[:, 2, 1] = np.arange(5) / 8
    clip = Clip("c", skeleton, 29.97, positions, quat.identity(5, 4))
    bvh.write(tmp_path / "c.bvh", clip)
    document = bvh.parse(tmp_path / "c.bvh")
    assert document.names == ("root", "A", "B", "C")
    assert document.parents.tolist() == [-1, 0, 1, 0]
    assert [len(channels) for channels in document.channels] == [6, 3, 3, 6]
    assert document.offsets.tolist() == [[0, 0, 0], [0, 1, 0], [0, 0, 2], [1, 0, 0]]
    assert document.end_sites[3][0].tolist() == [0, 0.25, 0] and document.end_sites[2][0].tolist() == [
        0,
        0,
        0,
    ]
    back = bvh.read(tmp_path / "c.bvh")
    assert back.fps == pytest.approx(29.97, rel=1e-8)
    np.testing.assert_array_equal(back.positions[:, 3], positions[:, 2])


def test_what_cannot_be_written(walker, tmp_path):
    path = tmp_path / "a.bvh"
    with pytest.raises(UserError, match="rotation order 'xyx'"):
        bvh.write(path, walker, order="xyx")
    holed = walker.positions.copy()
    holed[3, 0, 1] = np.nan
    with pytest.raises(UserError, match="not finite"):
        bvh.write(path, walker.replace(positions=holed))
    with pytest.raises(UserError, match="no frames"):
        bvh.write(path, walker.replace(positions=holed[:0], rotations=walker.rotations[:0]))
    assert list(tmp_path.iterdir()) == []


# Bad input


def test_one_frame_fewer_than_announced_is_accepted(save):
    document = bvh.parse(save(ARM.replace("Frames: 2", "Frames: 3")))
    assert len(document.values) == 2
    with pytest.raises(UserError, match="'Frames:' says 4 but 2 rows follow") as error:
        bvh.parse(save(ARM.replace("Frames: 2", "Frames: 4")))
    assert error.value.line == ROW + 1 and "write 2 on line 22" in error.value.remedy
    assert ARM_LINES[21] == "Frames: 2"
    with pytest.raises(UserError, match="cut short"):  # the last number may be cut as well
        bvh.parse(save(ARM.replace("Frames: 2", "Frames: 3").rstrip("\n")))


FAULTS = {
    "empty": ("", None, "the file is empty"),
    "white space": (" \n\n", None, "the file is empty"),
    "binary": (bytes(range(256)) * 50, 1, "not a BVH file"),
    "16-bit": (ARM.encode("utf-16"), 1, "16-bit text"),
    "something else": ("Frames: 2\n", 1, "not a BVH file"),
    "no motion": (ARM.partition("MOTION")[0], 21, "no MOTION section: the file is cut short"),
    "cut in the hierarchy": (ARM[: ARM.index("CHANNELS 3")], 9, "no MOTION section: the file is cut short"),
    "cut before the frame time": (ARM[: ARM.index("Frame Time")], 23, "no 'Frame Time:'"),
    "cut before the rows": ("\n".join(ARM_LINES[:23]), 23, "'Frames:' says 2 but 0 rows follow"),
    "cut in a row": (ARM[:-12], ROW + 1, "frame 2 has 9 values, expected 15"),
    "short row": (ARM.replace("0 1 0 0 0 0", "0 1 0"), ROW, "frame 1 has 12 values, expected 15"),
    "long row": (ARM.replace("0 1 0 0 0 0", "0 1 0 0 0 0 0"), ROW, "frame 1 has more than the 15 values"),
    "too many rows": (ARM + ARM_LINES[-2], ROW + 2, "'Frames:' says 2 but more rows follow"),
    "nan": (ARM.replace("90 0 0 ", "nan 0 0 "), ROW + 1, "value 4 of frame 2 is no finite number: 'nan'"),
    "infinite": (ARM.replace("90 0 0 ", "-1e999 0 0 "), ROW + 1, "no finite number: '-1e999'"),
    "indeterminate": (ARM.replace("90 0 0 ", "-1.#IND 0 0 "), ROW + 1, "no finite number: '-1.#IND'"),
    "decimal commas": (ARM.replace("90 0 0 ", "90,5 0 0 "), ROW + 1, "no finite number: '90,5'"),
    "zeros of a lost disk block": (ARM[:-20].encode() + bytes(300), ROW + 1, "no finite number"),
    "unknown channel": (ARM.replace("Zposition", "Wposition", 1), 5, "unknown channel 'Wposition'"),
    "scaled": (ARM.replace("Zposition", "Zscale", 1), 2, "joint 'Hips' is scaled by its channel Zscale"),
    "channel twice": (ARM.replace("Yposition", "Xposition", 1), 5, "a channel is listed twice"),
    "too few channels": (ARM.replace("CHANNELS 3", "CHANNELS 4"), 9, "CHANNELS 4 lists only 3"),
    "channels uncounted": (ARM.replace("CHANNELS 3", "CHANNELS"), 9, "CHANNELS needs a count"),
    "absurd channels": (ARM.replace("CHANNELS 3", "CHANNELS 9999999999999999"), 9, "CHANNELS needs a count"),
    "channels left over": (ARM.replace("CHANNELS 3", "CHANNELS 2"), 9, "unexpected 'Yrotation'"),
    "no channels": (ARM.replace("CHANNELS 6", "#").replace("CHANNELS 3", "#"), None, "no joint has channels"),
    "bad offset": (ARM.replace("OFFSET 1 0 0", "OFFSET 1 x 0"), 8, "OFFSET needs three finite numbers"),
    "offset cut": (ARM.replace("OFFSET 1 0 0", "OFFSET 1 0"), 8, "OFFSET needs three finite numbers"),
    "infinite offset": (ARM.replace("OFFSET 1 0 0", "OFFSET 1 inf 0"), 8, "three finite numbers"),
    "no offset": (ARM.replace("    OFFSET 1 0 0\n", ""), 6, "joint 'Arm' has no OFFSET"),
    "nameless joint": (ARM.replace("JOINT Arm", "JOINT"), 6, "a joint without a name"),
    "missing brace": (ARM.replace("}\nMOTION", "MOTION"), None, "ends inside joint 'Hips': '}' is missing"),
    "brace too many": (ARM.replace("}\nMOTION", "}\n}\nMOTION"), 21, "'}' without its '{'"),
    "unopened joint": (ARM.replace("ROOT Hips\n{", "ROOT Hips\n"), 4, "expected '{', found 'OFFSET"),
    "second root": (ARM.replace("MOTION", ARM[10 : ARM.index("MOTION")] + "MOTION"), 21, "a second ROOT"),
    "root in a joint": (ARM.replace("JOINT Arm", "ROOT Arm"), 6, "ROOT inside a joint"),
    "no root": (ARM.replace("ROOT Hips", "JOINT Hips"), 2, "JOINT outside of a joint"),
    "stray word": (ARM.replace("OFFSET 1 0", "OFSET 1 0"), 8, "unexpected 'OFSET'"),
    "stray motion line": (ARM.replace("Frames: 2", "Rahmen: 2"), 22, "expected 'Frames:' and 'Frame Time:'"),
    "no frames": (ARM.replace("Frames: 2", "Frames: 0"), 22, "no positive count"),
    "negative frames": (ARM.replace("Frames: 2", "Frames: -2"), 22, "no positive count"),
    "half frames": (ARM.replace("Frames: 2", "Frames: 2.5"), 22, "no positive count"),
    "absurd frames": (ARM.replace("Frames: 2", "Frames: " + "9" * 30), None, "but 2 rows follow"),
    "no time": (ARM.replace("0.0333333", "0"), 23, "no positive number of seconds"),
    "negative time": (ARM.replace("0.0333333", "-0.03"), 23, "no positive number of seconds"),
    "nan time": (ARM.replace("0.0333333", "nan"), 23, "no positive number of seconds"),
    "worded time": (ARM.replace("0.0333333", "30fps"), 23, "no positive number of seconds"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults(save, fault):
    content, line, message = FAULTS[fault]
    path = save(content)
    with pytest.raises(UserError) as error:
        bvh.parse(path)
    assert message in error.value.what
    assert error.value.path == str(path) and error.value.remedy
    if line is not None:
        assert error.value.line == line
    assert "\n" not in str(error.value) and len(str(error.value)) < 400 + len(str(path))


def test_paths_that_are_no_files(tmp_path):
    with pytest.raises(UserError, match="cannot read: No such file"):
        bvh.parse(tmp_path / "missing.bvh")
    with pytest.raises(UserError, match="it is a folder"):
        bvh.parse(tmp_path)


BOMBS = {
    "absurd frames": ARM.replace("Frames: 2", "Frames: 1000000000000000000"),
    "deep": "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n" + "JOINT b\n{\nOFFSET 0 0 0\n" * 100_000 + "\nMOTION\n",
    "wide": "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n" + "JOINT b\n{\nOFFSET 0 0 0\n}\n" * 50_000 + "\nMOTION\n",
    "braces": "HIERARCHY\nROOT a\n" + "{" * 2_000_000 + "\nMOTION\n",
    "a long word": ARM.replace("Arm", "A" * 2_000_000).replace("OFFSET 1", "OFFSET " + "9" * 1_000_000),
    "a long number": ARM.replace("90", "9" * 2_000_000),
    "blanks in the head": ARM.replace("Frames:", "Frames" + " " * 2_000_000),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_bombs_cost_little(save, bomb):
    path = save(BOMBS[bomb])
    start = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(UserError):
            bvh.parse(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20 * path.stat().st_size + 10_000_000
    assert time.process_time() - start < 60  # not a speed: the difference between linear and never


def test_every_cut_is_noticed(save):
    whole = bvh.parse(save(ARM))
    for length in range(len(ARM) - 1):
        try:
            document = bvh.parse(save(ARM[:length]))
        except UserError:
            continue
        # Only what ends in the last number, or right behind the row before the last, can look whole.
        assert length >= len(ARM) - 2 or document.values.tolist() == whole.values[:1].tolist()


def test_any_damage_is_a_user_error_or_reads(save):
    rng = np.random.default_rng(5)
    plain = np.frombuffer(ARM.encode(), np.uint8)
    outcomes = set()
    for _ in range(1500):
        damaged = plain.copy()
        damaged[rng.integers(0, len(plain), rng.integers(1, 4))] = rng.integers(0, 256)
        try:
            clip = bvh.read(save(damaged.tobytes()))
            assert np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()
            outcomes.add("read")
        except UserError as error:
            assert error.path is not None
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_many_joints_of_one_name_get_numbers_and_too_many_joints_are_refused(tmp_path):
    assert distinct(("a", "a 2", "a", "b", "a", "b")) == ("a", "a 2", "a 3", "b", "a 4", "b 2")
    joint = "JOINT j { OFFSET 0 0 0 CHANNELS 0 }\n"
    text = "HIERARCHY\nROOT r { OFFSET 0 0 0 CHANNELS 3 Xposition Yposition Zposition\n" + 1500 * joint
    (tmp_path / "many.bvh").write_text(text + "}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n")
    with pytest.raises(UserError, match="more than 1000 joints"):
        bvh.parse(tmp_path / "many.bvh")
