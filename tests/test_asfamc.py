"""ASF/AMC: positions worked out by hand, and the same captures in another format."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import asfamc, bvh, kinematics, quat, roles
from motion.clip import Clip
from motion.errors import UserError

ASF = """# made by hand
:version 1.10
:name LEG
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
   none
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 1 0 0
     length 2
     axis 0 0 0 XYZ
  end
  begin
     id 2
     name femur
     direction 0 -1 0
     length 4
     axis 0 0 90 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
     id 3
     name tibia
     direction 0 -1 0
     length 5
     axis 0 0 0 XYZ
    dof rx
  end
:hierarchy
  begin
    root hip
    hip femur
    femur tibia
  end
"""
AMC = """#!OML:ASF
:FULLY-SPECIFIED
:DEGREES
1
root 0 10 0 0 0 0
femur 0 0 0
tibia 0
2
root 1 10 0 0 90 0
femur 90 0 0
tibia -90
"""


@pytest.fixture
def save(tmp_path):
    def write(amc: str | bytes = AMC, asf: str | bytes | None = ASF):
        if asf is not None:
            (tmp_path / "07.asf").write_bytes(asf.encode() if isinstance(asf, str) else asf)
        path = tmp_path / "07_01.amc"
        path.write_bytes(amc.encode() if isinstance(amc, str) else amc)
        return path

    return write


def world(clip: Clip) -> np.ndarray:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def test_positions_by_hand(save):
    clip = asfamc.read(save())
    unit = 2.54 / 45
    assert clip.unit_to_m == pytest.approx(unit) and clip.fps == 120 and clip.name == "07_01"
    assert clip.skeleton.names == ("hips", "hip", "femur", "tibia")
    assert clip.skeleton.parents.tolist() == [-1, 0, 1, 2]
    np.testing.assert_allclose(clip.skeleton.end_sites[3], [0, -5 * unit, 0])
    # Frame 1 is the rest pose: the femur hangs from the end of the hip bone.
    # Frame 2: the root turns x to -z and z to x. Its own x axis is y of the body (axis 0 0 90), so
    # 90 degrees do that again. The tibia's x is x of the body: -90 take its -y to z, then turned twice.
    expected = [
        [[0, 10, 0], [0, 10, 0], [2, 10, 0], [2, 6, 0]],
        [[1, 10, 0], [1, 10, 0], [1, 10, -2], [1, 6, -2]],
    ]
    np.testing.assert_allclose(world(clip) / unit, expected, atol=1e-9)
    rotations = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[1]
    tip = world(clip)[:, 3] + quat.rotate(rotations[:, 3], np.tile(clip.skeleton.end_sites[3], (2, 1)))
    np.testing.assert_allclose(tip / unit, [[2, 1, 0], [1, 6, -7]], atol=1e-9)


@pytest.mark.parametrize("order", ["XYZ", "ZXY", "YZX"])
def test_axes_and_angles_about_fixed_axes(save, order):
    asf = ASF.replace("axis 0 0 90 XYZ", f"axis 20 30 40 {order}")
    asf = asf.replace("dof rx ry rz", "dof " + " ".join(f"r{axis.lower()}" for axis in order))
    clip = asfamc.read(save(AMC.replace("femur 90 0 0", "femur 15 -25 35"), asf))
    axis = Rotation.from_euler(order.lower(), [20, 30, 40], degrees=True)  # lower case: about fixed axes
    turn = Rotation.from_euler(order.lower(), [15, -25, 35], degrees=True)
    truth = (axis * turn * axis.inv()).as_matrix()
    np.testing.assert_allclose(quat.to_matrix(clip.rotations)[1, 2], truth, atol=1e-12)


def test_radians_and_units(save):
    asf = ASF.replace("angle deg", "angle rad").replace("length 0.45", "length 2")
    asf = asf.replace("axis 0 0 90 XYZ", f"axis 0 0 {np.pi / 2} XYZ")
    amc = AMC.replace(":DEGREES\n", "").replace("90", str(np.pi / 2))
    radians, degrees = asfamc.read(save(amc, asf)), asfamc.read(save())
    np.testing.assert_allclose(radians.rotations, degrees.rotations, atol=1e-12)
    assert radians.unit_to_m == pytest.approx(0.0127)
    given = asfamc.read(save(), unit_to_m=0.01, fps=60)
    assert given.unit_to_m == 0.01 and given.fps == 60 and given.positions[0, 0, 1] == pytest.approx(0.1)


def test_order_of_the_root_and_moving_bones(save):
    asf = ASF.replace("TX TY TZ RX RY RZ", "RZ RY RX TZ TY TX").replace("dof rx\n", "dof ty rx\n")
    amc = AMC.replace("root 1 10 0 0 90 0", "root 0 90 0 0 10 1").replace("tibia -90", "tibia 1 -90")
    clip, plain = asfamc.read(save(amc.replace("tibia 0", "tibia 0 0"), asf)), asfamc.read(save())
    np.testing.assert_allclose(clip.rotations[1], plain.rotations[1], atol=1e-12)
    np.testing.assert_allclose(clip.positions[1, 0], plain.positions[1, 0], atol=1e-12)
    assert (clip.positions[1, 3] - plain.positions[1, 3]).tolist() == pytest.approx([0, clip.unit_to_m, 0])


@pytest.mark.parametrize(
    "amc",
    [
        AMC.replace("\n", "\r\n"),
        AMC.rstrip("\n"),
        AMC.replace("\n", "\n\n"),
        AMC.replace(" ", "\t"),
        AMC.replace("femur 90 0 0\ntibia -90", "tibia -9e1\nfemur 90.0 -0 0.0000000000000000000001"),
    ],
)
def test_spellings(save, amc):
    np.testing.assert_allclose(asfamc.read(save(amc)).rotations, asfamc.read(save()).rotations, atol=1e-12)


def test_many_numbers_that_need_care(save):
    rng = np.random.default_rng(6)
    values = rng.normal(size=(3000, 3))
    frames = [
        f"{t + 1}\nroot 0 0 0 0 0 0\nfemur {' '.join(f'{v:.25e}' for v in row)}\ntibia 0"
        for t, row in enumerate(values.tolist())
    ]
    clip = asfamc.read(save("\n".join(frames)))
    axis = Rotation.from_euler("z", 90, degrees=True)
    truth = axis * Rotation.from_euler("xyz", values, degrees=True) * axis.inv()
    np.testing.assert_allclose(quat.to_matrix(clip.rotations[:, 2]), truth.as_matrix(), atol=1e-12)


# Against the same captures as BVH


@pytest.mark.parametrize(
    "name", ["02/02_01", "02/02_03", "03/03_01", "05/05_01", "09/09_11", "35/35_01", "35/35_17"]
)
def test_twins(data, name):
    """The BVH was retargeted to one skeleton: bone lengths differ, directions and times do not."""
    acclaim = asfamc.read(data / "cmu" / "asfamc" / f"{name}.amc")
    daz = bvh.read(data / "cmu" / "daz_bvh" / f"{name}.bvh", unit_to_m=0.01)
    a, b = world(acclaim), world(daz)[1:]  # its first frame is a T-pose
    frames = min(len(a), len(b))
    assert abs(len(a) - len(b)) <= 1
    a, b = a[:frames], b[:frames]
    ours, theirs = roles.guess(acclaim.skeleton), roles.guess(daz.skeleton)

    path_a, path_b = (np.linalg.norm(np.diff(p[:, 0, [0, 2]], axis=0), axis=1).sum() for p in (a, b))
    assert 0.92 < path_b / path_a < 1.02  # mostly about 4 % shorter
    travel = np.linalg.norm(a[-1, 0] - a[0, 0])
    assert np.linalg.norm((b[-1, 0] - b[0, 0]) - (a[-1, 0] - a[0, 0])) < 0.08 * travel

    for side in ("left", "right"):
        for upper, lower in (("up_leg", "leg"), ("leg", "foot"), ("up_leg", "foot"), ("arm", "forearm")):
            bones = []
            for p, found in ((a, ours), (b, theirs)):
                bone = p[:, found[f"{side}_{lower}"]] - p[:, found[f"{side}_{upper}"]]
                bones.append(bone / np.linalg.norm(bone, axis=-1, keepdims=True))
            angles = np.degrees(np.arccos(np.clip(np.sum(bones[0] * bones[1], axis=-1), -1, 1)))
            assert np.median(angles) < 12, (side, upper, lower, np.median(angles))


def test_a_real_foot_stands_on_the_ground(data):
    clip = asfamc.read(data / "cmu" / "asfamc" / "16" / "16_15.amc")
    toe = world(clip)[:, clip.skeleton.index("ltoes"), 1]
    assert 0 < np.percentile(toe, 5) < 0.06
    assert len(clip.skeleton) == 31


# Skeletons found, or not


def test_the_skeleton_is_found(save, tmp_path):
    path = save()
    assert asfamc.find_asf(path).name == "07.asf"
    (tmp_path / "08.asf").write_text(ASF)
    assert asfamc.find_asf(path).name == "07.asf"
    (tmp_path / "07_01.ASF").write_text(ASF)
    assert asfamc.find_asf(path).name == "07_01.ASF"
    for skeleton in ("07.asf", "07_01.ASF"):
        (tmp_path / skeleton).unlink()
    assert asfamc.find_asf(path).name == "08.asf"  # the only one there
    (tmp_path / "09.asf").write_text(ASF)
    with pytest.raises(UserError, match="unclear"):
        asfamc.find_asf(path)


def test_the_skeleton_in_a_neighbouring_folder(tmp_path):
    for folder in ("bad", "good/07"):
        (tmp_path / folder).mkdir(parents=True)
    path = tmp_path / "bad" / "07_01.amc"
    path.write_text(AMC)
    with pytest.raises(UserError, match="no skeleton") as error:
        asfamc.read(path)
    assert error.value.remedy == "put 07.asf beside it"
    (tmp_path / "good" / "07" / "07.asf").write_text(ASF)
    assert len(asfamc.read(path)) == 2


def test_missing_motion(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        asfamc.read(tmp_path / "01_01.amc")


# Bad input

AMC_FAULTS = {
    "empty": ("", None, "the file is empty"),
    "binary": (b"\x00\x01\x02" * 100, 1, "before the first frame's number"),
    "no frames": ("#\n:DEGREES\n", None, "no frames"),
    "no number": (AMC.replace("\n1\nroot", "\nroot"), 4, "'root' before the first frame's number"),
    "cut in a frame": (AMC[: AMC.rindex("tibia")], 10, "frame 2 lacks some of the 3 bones"),
    "cut in a bone": (AMC[: AMC.index("90 0 0")], 10, "too few values for this bone in frame 2"),
    "bone missing": (AMC.replace("tibia 0\n", ""), 7, "frame 1 lacks some of the 3 bones"),
    "unknown bone": (AMC.replace("tibia -90", "fibula -90"), 11, "no moving bone 'fibula'"),
    "bone twice": (AMC.replace("tibia -90", "femur 0 0 0"), 11, "bone 'femur' twice in frame 2"),
    "too many": (AMC.replace("tibia -90", "tibia -90 1"), 11, "more values than the bone has degrees"),
    "nan": (AMC.replace("tibia -90", "tibia nan"), 11, "no finite number: 'nan'"),
    "infinite": (AMC.replace("tibia -90", "tibia 1e400"), 11, "no finite number: '1e400'"),
}  # fmt: skip

ASF_FAULTS = {
    "empty": ("", None, "the file is empty"),
    "binary": (b"\x00\x01\n" * 100, None, "not an ASF file"),
    "cut in a bone": (ASF[: ASF.index("dof rx\n")], None, "the last bone has no 'end'"),
    "no hierarchy": (ASF[: ASF.index(":hierarchy")], 16, "bone 'hip' hangs on nothing"),
    "a loop": (ASF.replace("root hip\n", "tibia hip\n"), 16, "bone 'hip' hangs on nothing"),
    "two parents": (ASF.replace("femur tibia", "femur tibia hip"), 46, "bone 'hip' has two parents"),
    "unknown in hierarchy": (ASF.replace("femur tibia", "femur fibula"), 46, "no bone 'fibula' in :bonedata"),
    "bad direction": (ASF.replace("direction 1 0 0", "direction 1 x 0"), 19, "expected 3 finite numbers"),
    "bad length": (ASF.replace("length 2", "length inf"), 20, "expected 1 finite numbers"),
    "unit": (ASF.replace("length 0.45", "length 0"), 6, "the unit of length is not positive"),
    "bad axis": (ASF.replace("0 0 90 XYZ", "0 0 90 XYY"), 28, "axis order 'xyy'"),
    "bad dof": (ASF.replace("dof rx\n", "dof rx l\n"), 40, "degree of freedom 'l'"),
    "name twice": (ASF.replace("name tibia", "name femur"), 41, "a bone without a name of its own"),
}  # fmt: skip


@pytest.mark.parametrize("fault", AMC_FAULTS)
def test_amc_faults(save, fault):
    content, line, message = AMC_FAULTS[fault]
    path = save(content)
    with pytest.raises(UserError) as error:
        asfamc.read(path)
    assert message in error.value.what and error.value.remedy
    assert error.value.path == str(path)
    assert line is None or error.value.line == line


@pytest.mark.parametrize("fault", ASF_FAULTS)
def test_asf_faults(save, tmp_path, fault):
    content, line, message = ASF_FAULTS[fault]
    with pytest.raises(UserError) as error:
        asfamc.read(save(asf=content))
    assert message in error.value.what and error.value.remedy
    assert error.value.path == str(tmp_path / "07.asf")
    assert line is None or error.value.line == line


@pytest.mark.parametrize("which", ["amc", "asf"])
def test_any_damage_is_a_user_error_or_reads(save, which):
    rng = np.random.default_rng(7)
    plain = np.frombuffer((AMC if which == "amc" else ASF).encode(), np.uint8)
    outcomes = set()
    for _ in range(800):
        damaged = plain.copy()
        damaged[rng.integers(0, len(plain), rng.integers(1, 4))] = rng.integers(0, 256)
        try:
            clip = asfamc.read(save(**{which: damaged.tobytes()}))
            assert np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()
            outcomes.add("read")
        except UserError:
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}
