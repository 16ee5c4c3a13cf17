"""BVH as programs and converters write it: their spellings, units, names and channels, all of one motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import synthetic
from scipy.spatial.transform import Rotation

from motion import bvh, kinematics, sources
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton


@dataclass(frozen=True)
class Dialect:
    """How a program prints a clip."""

    order: str = "ZXY"
    rename: Callable[[str], str] = str
    unit_to_m: float = 0.01
    all_positions: bool = False
    rotations_first: bool = False
    end: str = "End Site"
    number: str = "{:.6f}"
    time: str = "Frame Time: {:.6f}"
    count: str = "Frames: {}"
    indent: str = "\t"
    separator: str = " "
    line: str = "\n"
    row: str = "{}"  # a row of the table
    scales: bool = False


DIALECTS = {
    "blender": Dialect(order="XYZ", row="{} ", number="{:.6f}"),
    "motionbuilder": Dialect(rename="BVH:{}".format, line="\r\n", number="{:f}", indent="  "),
    "maya": Dialect(rename="walker|ns:{}".format, number="{:.10e}", order="YXZ", unit_to_m=0.01),
    "mixamo": Dialect(rename="mixamorig:{}".format, order="ZYX"),
    "rokoko": Dialect(all_positions=True, order="YXZ", time="Frame Time: {:.7f}"),
    "xsens": Dialect(all_positions=True, order="YXZ", count="Frames:  {}", time="Frame Time:  {:.6f}"),
    "bvhacker": Dialect(
        count="Frames:\t{}", time="Frame Time:\t{:.6f}", separator="\t", row="{}\t", line="\r\n"
    ),
    "biovision": Dialect(unit_to_m=0.0254, count="Frames:    {}", row="  {}", number="{:7.4f}", line="\r"),
    "cgspeed": Dialect(end="End Site", indent="", number="{:.8g}", order="ZYX"),
    "spaced colons": Dialect(count="Frames : {}", time="Frame Time : {:.8f}", end="End Site "),
    "one-word end sites": Dialect(end="EndSite", number="{:+.6E}"),
    "named end sites": Dialect(end="End Site Nub_1"),
    "rotations first": Dialect(rotations_first=True, all_positions=True),
    "scales": Dialect(all_positions=True, scales=True),
    "metres": Dialect(unit_to_m=1.0, number="{:.9f}"),
    "inches": Dialect(unit_to_m=0.0254),
    "millimetres": Dialect(unit_to_m=0.001, number="{:.4f}"),
    "cmu": Dialect(unit_to_m=0.0254 / 0.45),
}


def printed(clip: Clip, dialect: Dialect) -> bytes:
    """The text of a clip in a dialect, by other means than the library's writer."""
    rig, scale = clip.skeleton, 1 / dialect.unit_to_m
    children: dict[int, list[int]] = {j: [] for j in range(len(rig))}
    for j, parent in enumerate(rig.parents.tolist()[1:], 1):
        children[parent].append(j)
    lines, columns = ["HIERARCHY"], []
    turns = Rotation.from_quat(clip.rotations.reshape(-1, 4), scalar_first=True)
    angles = turns.as_euler(dialect.order, degrees=True).reshape(len(clip), len(rig), 3)

    def vector(value: np.ndarray) -> str:
        return dialect.separator.join(dialect.number.format(x) for x in value * scale)

    def joint(j: int, depth: int) -> None:
        tabs = dialect.indent * depth
        inner = tabs + dialect.indent
        lines.append(f"{tabs}{'JOINT' if j else 'ROOT'} {dialect.rename(rig.names[j])}")
        lines.extend([tabs + "{", f"{inner}OFFSET{dialect.separator}{vector(rig.offsets[j])}"])
        places = [f"{axis}position" for axis in "XYZ"] if j == 0 or dialect.all_positions else []
        rotations = [f"{axis}rotation" for axis in dialect.order]
        blocks = [(places, clip.positions[:, j] * scale), (rotations, angles[:, j])]
        blocks = [block for block in blocks if block[0]]
        if dialect.rotations_first:
            blocks = blocks[::-1]
        if dialect.scales:
            blocks.append(([f"{axis}scale" for axis in "XYZ"], np.ones((len(clip), 3))))
        columns.extend(values for _, values in blocks)
        channels = [channel for block, _ in blocks for channel in block]
        lines.append(f"{inner}CHANNELS {len(channels)} {' '.join(channels)}")
        for child in children[j]:
            joint(child, depth + 1)
        if not children[j]:
            end = vector(rig.end_sites.get(j, np.zeros(3)))
            lines.extend([f"{inner}{dialect.end}", inner + "{", f"{inner}\tOFFSET {end}", inner + "}"])
        lines.append(tabs + "}")

    joint(0, 0)
    lines += ["MOTION", dialect.count.format(len(clip)), dialect.time.format(1 / clip.fps)]
    for row in np.concatenate(columns, axis=1):
        lines.append(dialect.row.format(dialect.separator.join(dialect.number.format(x) for x in row)))
    return (dialect.line.join(lines) + dialect.line).encode()


@pytest.mark.parametrize("name", DIALECTS)
def test_every_dialect_is_the_same_motion(tmp_path: Path, name: str) -> None:
    dialect, clip = DIALECTS[name], synthetic.walk(seconds=1)
    (tmp_path / "walk.bvh").write_bytes(printed(clip, dialect))
    read = sources.load(tmp_path / "walk.bvh")
    assert read.fps == clip.fps and read.unit_to_m == dialect.unit_to_m
    assert read.skeleton.names == tuple(dialect.rename(joint) for joint in clip.skeleton.names)
    assert read.skeleton.roles == clip.skeleton.roles
    world, expected = (kinematics.forward(c.skeleton, c.positions, c.rotations)[0] for c in (read, clip))
    np.testing.assert_allclose(world, expected, atol=2e-4)
    for joint, end in clip.skeleton.end_sites.items():
        np.testing.assert_allclose(read.skeleton.end_sites[joint], end, atol=1e-5)


def hundred() -> Clip:
    """The walker with fingers, twist joints and props: 100 joints, all of which lie still."""
    clip = synthetic.walk(seconds=1)
    rig = clip.skeleton
    names, parents, offsets = list(rig.names), rig.parents.tolist(), rig.offsets.tolist()

    def add(name: str, parent: int, offset: tuple[float, float, float]) -> int:
        names.append(name)
        parents.append(parent)
        offsets.append(offset)
        return len(names) - 1

    for side in ("Left", "Right"):
        for part in ("UpLeg", "Leg", "Arm", "ForeArm"):
            for k in (1, 2):
                add(f"{side}{part}Twist{k}", names.index(side + part), (0, -0.1 * k, 0))
        for f, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Pinky")):
            at = names.index(f"{side}Hand")
            for k in range(1, 5):
                at = add(f"{side}Hand{finger}{k}", at, (0.01 * f if k == 1 else 0, -0.02, 0.01))
        for toe in range(1, 6):
            add(f"{side}ToeBase{toe}", names.index(f"{side}Toe"), (0.01 * toe, 0, 0.02))
        add(f"{side}Eye", names.index("Head"), (0.03, 0.05, 0.08))
        add(f"{side}HandProp", names.index(f"{side}Hand"), (0, -0.1, 0))
    while len(names) < 100:
        add(f"Hair{len(names)}", names.index("Head"), (0, 0.1, -0.01 * len(names)))
    skeleton = Skeleton(tuple(names), np.array(parents), np.array(offsets), rig.roles)
    more = len(names) - len(rig)
    identity = np.tile([1.0, 0, 0, 0], (len(clip), more, 1))
    return clip.replace(
        skeleton=skeleton,
        positions=np.concatenate([clip.positions, np.tile(offsets[len(rig) :], (len(clip), 1, 1))], 1),
        rotations=np.concatenate([clip.rotations, identity], 1),
    )


@pytest.mark.parametrize("name", ["blender", "rokoko", "mixamo"])
def test_a_hundred_joints_with_fingers_twists_and_props(tmp_path: Path, name: str) -> None:
    clip, dialect = hundred(), DIALECTS[name]
    assert len(clip.skeleton) == 100
    (tmp_path / "rig.bvh").write_bytes(printed(clip, dialect))
    read = sources.load(tmp_path / "rig.bvh")
    assert len(read.skeleton) == 100 and read.unit_to_m == 0.01
    roles = {role: read.skeleton.names[j] for role, j in read.skeleton.roles.items()}
    expected = {role: dialect.rename(clip.skeleton.names[j]) for role, j in clip.skeleton.roles.items()}
    assert roles == expected
    place = [read.skeleton.index(dialect.rename(joint)) for joint in clip.skeleton.names]
    world, truth = (kinematics.forward(c.skeleton, c.positions, c.rotations)[0] for c in (read, clip))
    np.testing.assert_allclose(world[:, place], truth, atol=2e-4)


ONE = (
    "HIERARCHY\nROOT a\n{\nOFFSET 1 2 3\nCHANNELS %s\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
    "MOTION\nFrames: 2\nFrame Time: 0.1\n%s\n"
)  # a joint's channels, the rows


@pytest.mark.parametrize(
    ("channels", "row", "place", "euler"),
    [
        ("1 Yposition", "9", [1, 9, 3], None),
        ("1 Yrotation", "90", [1, 2, 3], ("Y", [90])),
        ("2 Zposition Xposition", "9 8", [8, 2, 9], None),
        ("2 Yrotation Xrotation", "30 40", [1, 2, 3], ("YX", [30, 40])),
        ("3 Zposition Yrotation Xposition", "9 30 8", [8, 2, 9], ("Y", [30])),
        ("4 Xrotation Xposition Zrotation Yrotation", "10 9 20 30", [9, 2, 3], ("XZY", [10, 20, 30])),
        (
            "5 Xrotation Yposition Zrotation Xposition Yrotation",
            "10 9 20 8 30",
            [8, 9, 3],
            ("XZY", [10, 20, 30]),
        ),
        ("7 Xposition Yposition Zposition Zrotation Xrotation Yrotation Yscale", "9 8 7 1 2 3 1",
         [9, 8, 7], ("ZXY", [1, 2, 3])),
        ("9 Xscale Yscale Zscale Xposition Yposition Zposition Zrotation Xrotation Yrotation",
         "1 1.0 1e0 9 8 7 1 2 3", [9, 8, 7], ("ZXY", [1, 2, 3])),
    ],
)  # fmt: skip
def test_any_number_of_channels(tmp_path, channels, row, place, euler):
    (tmp_path / "one.bvh").write_text(ONE % (channels, f"{row}\n{row}"))
    clip = bvh.read(tmp_path / "one.bvh")
    assert clip.positions[1, 0].tolist() == place
    turn = Rotation.from_euler(euler[0], euler[1], degrees=True) if euler else Rotation.identity()
    found = Rotation.from_quat(clip.rotations[1, 0], scalar_first=True)
    assert (found * turn.inv()).magnitude() < 1e-12


ODD = {
    "mixed line ends": lambda text: text.replace("\n", "\r", 4).replace("\n", "\r\n", 2),
    "line ends converted twice": lambda text: text.replace("\n", "\r\r\n"),
    "the end of a file under DOS": lambda text: text + "\x1a",
    "no space before braces": lambda text: text.replace("a\n{", "a{").replace("Site\n{", "Site{"),
    "numbers up to the brace": lambda text: text.replace("0 1 0\n}", "0 1 0}"),
    "MOTION behind a brace": lambda text: text.replace("}\nMOTION", "} MOTION"),
    "the count behind MOTION": lambda text: text.replace("MOTION\n", "MOTION "),
    "an end site without an offset": lambda text: text.replace("OFFSET 0 1 0\n", ""),
    "an end site with no channels": lambda text: text.replace("0 1 0\n", "0 1 0\nCHANNELS 0\n"),
    "no end site": lambda text: text.replace("End Site\n{\nOFFSET 0 1 0\n}\n", ""),
    "everything on one line": lambda text: text.replace("\n", " ", 10),
    "forms of numbers": lambda text: text.replace("7 8 9", "+7. 80E-1 .9e1"),
    "a vertical tab": lambda text: text.replace("7 8 9", "7\v8\f9"),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_but_plain_enough(tmp_path, name):
    text = ONE % ("3 Xposition Yposition Zposition", "4 5 6\n7 8 9")
    changed = ODD[name](text)
    assert changed != text
    (tmp_path / "odd.bvh").write_bytes(changed.encode())
    document = bvh.parse(tmp_path / "odd.bvh")
    assert document.names == ("a",) and document.values.tolist() == [[4, 5, 6], [7, 8, 9]]
    assert document.offsets.tolist() == [[1, 2, 3]]
    assert [end.tolist() for end in document.end_sites[0]] in ([[0, 1, 0]], [])


@pytest.mark.parametrize(
    ("old", "new", "line", "what", "remedy"),
    [
        ("4 5 6", "4,0 5,0 6,0", 14, "no finite number: '4,0'", "decimal point"),
        ("OFFSET 1 2 3", "OFFSET 1,5 2,0 3,0", 4, "found '1,5 2,0 3,0'", "decimal point"),
        ("4 5 6", "4 5 6 nan", 14, "more than the 3 values", "whole copy"),
        ("4 5 6", "4 5 -nan(ind)", 14, "no finite number: '-nan(ind)'", "cut the frame out"),
        ("3 X", "12 X", 5, "CHANNELS needs a count of 0 to 9, found '12'", "whole copy"),
        ("3 X", "9" * 5000 + " X", 5, "CHANNELS needs a count", "whole copy"),
        ("Xposition", "Xscale", 2, "joint 'a' is scaled by its channel Xscale", "positions"),
        ("Frames: 2", "Frames: 2 3", 12, "expected 'Frames:' and 'Frame Time:'", "whole copy"),
        ("Frames: 2", "Frames: " + 300 * "0" + "2", 12, "expected 'Frames:'", "whole copy"),
        ("0.1", "0,1", 13, "Frame Time '0,1' is no positive number", "write the seconds"),
        ("OFFSET 0 1 0", "OFFSET 0 1 0\nJOINT b", 9, "JOINT inside an End Site", "whole copy"),
    ],
)
def test_what_stays_refused_is_named_with_its_line(tmp_path, old, new, line, what, remedy):
    text = ONE % ("3 Xposition Yposition Zposition", "4 5 6\n7 8 9")
    assert old in text
    (tmp_path / "bad.bvh").write_text(text.replace(old, new, 1))
    with pytest.raises(UserError) as error:
        bvh.parse(tmp_path / "bad.bvh")
    assert what in error.value.what and remedy in error.value.remedy and error.value.line == line
