"""Roles of joints: naming schemes of many programs, shapes without names, and the override file."""

import dataclasses

import numpy as np
import pytest

from motion import bvh, contacts, kinematics, quat, roles, sources
from motion.errors import UserError
from motion.skeleton import Skeleton


def rig(text: str) -> Skeleton:
    """A skeleton from chains such as ``hips>thigh>shin; hips>spine``."""
    names: list[str] = []
    parents: list[int] = []
    for chain in text.split(";"):
        joints = [joint.strip() for joint in chain.split(">")]
        for above, joint in zip([None, *joints], joints, strict=False):
            if joint not in names:
                parents.append(names.index(above) if above else -1)
                names.append(joint)
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3)))


def both(text: str, left: str, right: str) -> str:
    return ";".join(text.replace("*", side) for side in (left, right))


MIDDLE = ("hips", "spine", "chest", "neck", "head")
SIDED = ("up_leg", "leg", "foot", "toe", "shoulder", "arm", "forearm", "hand")

# scheme: (hierarchy, sides, root, middle roles, sided roles with * for the side)
SCHEMES = {
    "mixamo": (
        "m:Hips>m:Spine>m:Spine1>m:Spine2>m:Neck>m:Head>m:HeadTop_End;"
        + both(
            "m:Spine2>m:*Shoulder>m:*Arm>m:*ForeArm>m:*Hand>m:*HandIndex1>m:*HandIndex2;"
            "m:Hips>m:*UpLeg>m:*Leg>m:*Foot>m:*ToeBase>m:*Toe_End",
            "Left",
            "Right",
        ),
        ("Left", "Right"),
        None,
        "m:Hips m:Spine m:Spine2 m:Neck m:Head",
        "m:*UpLeg m:*Leg m:*Foot m:*ToeBase m:*Shoulder m:*Arm m:*ForeArm m:*Hand",
    ),
    "unreal": (
        "root>pelvis>spine_01>spine_02>spine_03>neck_01>head;root>ik_foot_root;root>ik_hand_root;"
        + both(
            "spine_03>clavicle_*>upperarm_*>upperarm_twist_01_*;upperarm_*>lowerarm_*>lowerarm_twist_01_*;"
            "lowerarm_*>hand_*>index_01_*;pelvis>thigh_*>thigh_twist_01_*;thigh_*>calf_*>foot_*>ball_*;"
            "ik_foot_root>ik_foot_*;ik_hand_root>ik_hand_*",
            "l",
            "r",
        ),
        ("l", "r"),
        "root",
        "pelvis spine_01 spine_03 neck_01 head",
        "thigh_* calf_* foot_* ball_* clavicle_* upperarm_* lowerarm_* hand_*",
    ),
    "rigify deform bones": (
        "DEF-spine>DEF-spine.001>DEF-spine.002>DEF-spine.003>DEF-spine.004>DEF-spine.005>DEF-spine.006;"
        + both(
            "DEF-spine>DEF-pelvis.*;DEF-spine>DEF-thigh.*>DEF-thigh.*.001>DEF-shin.*>DEF-shin.*.001>DEF-foot.*"
            ">DEF-toe.*;DEF-spine.003>DEF-breast.*;DEF-spine.003>DEF-shoulder.*>DEF-upper_arm.*"
            ">DEF-upper_arm.*.001>DEF-forearm.*>DEF-forearm.*.001>DEF-hand.*>DEF-f_index.01.*",
            "L",
            "R",
        ),
        ("L", "R"),
        None,
        "DEF-spine DEF-spine.001 DEF-spine.003 DEF-spine.004 DEF-spine.006",
        "DEF-thigh.* DEF-shin.* DEF-foot.* DEF-toe.* DEF-shoulder.* DEF-upper_arm.* DEF-forearm.* DEF-hand.*",
    ),
    "biped": (
        "Bip01>Bip01 Pelvis>Bip01 Spine>Bip01 Spine1>Bip01 Neck>Bip01 Head>Bip01 HeadNub;"
        + both(
            "Bip01 Neck>Bip01 * Clavicle>Bip01 * UpperArm>Bip01 * Forearm>Bip01 * Hand>Bip01 * Finger0;"
            "Bip01 Spine>Bip01 * Thigh>Bip01 * Calf>Bip01 * Foot>Bip01 * Toe0>Bip01 * Toe0Nub",
            "L",
            "R",
        ),
        ("L", "R"),
        None,
        "Bip01 Pelvis|Bip01 Spine|Bip01 Spine1|Bip01 Neck|Bip01 Head",
        "|".join(f"Bip01 * {part}" for part in "Thigh Calf Foot Toe0 Clavicle UpperArm Forearm Hand".split()),
    ),
    "smpl": (
        "Pelvis>Spine1>Spine2>Spine3>Neck>Head;"
        + both(
            "Pelvis>*_Hip>*_Knee>*_Ankle>*_Foot;Spine3>*_Collar>*_Shoulder>*_Elbow>*_Wrist>*_Hand", "L", "R"
        ),
        ("L", "R"),
        None,
        "Pelvis Spine1 Spine3 Neck Head",
        "*_Hip *_Knee *_Ankle *_Foot *_Collar *_Shoulder *_Elbow *_Wrist",
    ),
    "xsens": (
        "Pelvis>L5>L3>T12>T8>Neck>Head;"
        + both(
            "T8>*Shoulder>*UpperArm>*ForeArm>*Hand;Pelvis>*UpperLeg>*LowerLeg>*Foot>*Toe", "Left", "Right"
        ),
        ("Left", "Right"),
        None,
        "Pelvis L5 T8 Neck Head",
        "*UpperLeg *LowerLeg *Foot *Toe *Shoulder *UpperArm *ForeArm *Hand",
    ),
    "kinect": (
        "SpineBase>SpineMid>SpineShoulder>Neck>Head;"
        + both(
            "SpineShoulder>Shoulder*>Elbow*>Wrist*>Hand*;SpineBase>Hip*>Knee*>Ankle*>Foot*", "Left", "Right"
        ),
        ("Left", "Right"),
        None,
        "SpineBase SpineMid SpineShoulder Neck Head",
        "Hip* Knee* Ankle* Foot* - Shoulder* Elbow* Wrist*",
    ),
    "genesis": (
        "hip>pelvis;hip>abdomenLower>abdomenUpper>chestLower>chestUpper>neckLower>neckUpper>head>lEye;"
        + both(
            "pelvis>*ThighBend>*ThighTwist>*Shin>*Foot>*Metatarsals>*Toe>*BigToe;"
            "chestUpper>*Collar>*ShldrBend>*ShldrTwist>*ForearmBend>*ForearmTwist>*Hand>*Thumb1",
            "l",
            "r",
        ),
        ("l", "r"),
        None,
        "hip abdomenLower chestUpper neckLower head",
        "*ThighBend *Shin *Foot *Toe *Collar *ShldrBend *ForearmBend *Hand",
    ),
    "horse": (
        "Root>Pelvis>Spine1>Spine2>Neck>Head;Pelvis>Tail1>Tail2;"
        + both(
            "Spine2>*_FrontUpperLeg>*_FrontLowerLeg>*_FrontFoot;Pelvis>*_HindThigh>*_HindCalf>*_HindFoot",
            "L",
            "R",
        ),
        ("L", "R"),
        "Root",
        "Pelvis Spine1 Spine2 Neck Head",
        "*_HindThigh *_HindCalf *_HindFoot - - *_FrontUpperLeg *_FrontLowerLeg *_FrontFoot",
    ),
    "mixamo with all fingers": (
        "m:Hips>m:Spine>m:Spine1>m:Spine2>m:Neck>m:Head>m:HeadTop_End;"
        + both(
            "m:Spine2>m:*Shoulder>m:*Arm>m:*ForeArm>m:*Hand;m:Hips>m:*UpLeg>m:*Leg>m:*Foot>m:*ToeBase;"
            + ";".join(
                "m:*Hand>" + ">".join(f"m:*Hand{finger}{i}" for i in range(1, 5))
                for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky")
            ),
            "Left",
            "Right",
        ),
        ("Left", "Right"),
        None,
        "m:Hips m:Spine m:Spine2 m:Neck m:Head",
        "m:*UpLeg m:*Leg m:*Foot m:*ToeBase m:*Shoulder m:*Arm m:*ForeArm m:*Hand",
    ),
    "mixamo in three.js": (
        "Armature>mixamorigHips>mixamorigSpine>mixamorigSpine1>mixamorigNeck>mixamorigHead;"
        + both(
            "mixamorigSpine1>mixamorig*Shoulder>mixamorig*Arm>mixamorig*ForeArm>mixamorig*Hand"
            ">mixamorig*HandThumb1;mixamorigHips>mixamorig*UpLeg>mixamorig*Leg>mixamorig*Foot>mixamorig*ToeBase",
            "Left",
            "Right",
        ),
        ("Left", "Right"),
        "Armature",
        " ".join(f"mixamorig{part}" for part in "Hips Spine Spine1 Neck Head".split()),
        " ".join(f"mixamorig*{part}" for part in "UpLeg Leg Foot ToeBase Shoulder Arm ForeArm Hand".split()),
    ),
    "vroid": (
        "Root>J_Bip_C_Hips>J_Bip_C_Spine>J_Bip_C_UpperChest>J_Bip_C_Neck>J_Bip_C_Head>J_Sec_Hair1_01;"
        + both(
            "J_Bip_C_UpperChest>J_Sec_*_Bust1;J_Bip_C_UpperChest>J_Bip_*_Shoulder>J_Bip_*_UpperArm"
            ">J_Bip_*_LowerArm>J_Bip_*_Hand>J_Bip_*_Index1;J_Bip_C_Hips>J_Bip_*_UpperLeg>J_Bip_*_LowerLeg"
            ">J_Bip_*_Foot>J_Bip_*_ToeBase;J_Bip_*_UpperLeg>J_Sec_*_SkirtFront0_01;J_Bip_C_Head>J_Adj_*_FaceEye",
            "L",
            "R",
        ),
        ("L", "R"),
        "Root",
        " ".join(f"J_Bip_C_{part}" for part in "Hips Spine UpperChest Neck Head".split()),
        " ".join(
            f"J_Bip_*_{part}"
            for part in "UpperLeg LowerLeg Foot ToeBase Shoulder UpperArm LowerArm Hand".split()
        ),
    ),
    "rigify in three.js": (
        "DEF-spine>DEF-spine001>DEF-spine002>DEF-spine003>DEF-spine004>DEF-spine005>DEF-spine006;"
        + both(
            "DEF-spine>DEF-thigh*>DEF-thigh*001>DEF-shin*>DEF-shin*001>DEF-foot*>DEF-toe*;DEF-spine003"
            ">DEF-shoulder*>DEF-upper_arm*>DEF-upper_arm*001>DEF-forearm*>DEF-forearm*001>DEF-hand*",
            "L",
            "R",
        ),
        ("L", "R"),
        None,
        "DEF-spine DEF-spine001 DEF-spine003 DEF-spine004 DEF-spine006",
        "DEF-thigh* DEF-shin* DEF-foot* DEF-toe* DEF-shoulder* DEF-upper_arm* DEF-forearm* DEF-hand*",
    ),
    "lower case": (
        "hips>spine>spine1>neck>head;"
        + both("hips>*upleg>*leg>*foot>*toe;spine1>*shoulder>*arm>*forearm>*hand", "left", "right"),
        ("left", "right"),
        None,
        "hips spine spine1 neck head",
        "*upleg *leg *foot *toe *shoulder *arm *forearm *hand",
    ),
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_naming_schemes(scheme):
    hierarchy, sides, root, middle, sided = SCHEMES[scheme]
    skeleton = rig(hierarchy)
    cut = "|" if "|" in middle else " "
    expected = dict(zip(MIDDLE, middle.split(cut), strict=True))
    for side, mark in zip(("left", "right"), sides, strict=True):
        names = zip(SIDED, sided.split(cut), strict=True)
        expected |= {f"{side}_{part}": name.replace("*", mark) for part, name in names if name != "-"}
    if root:
        expected["root"] = root
    assert {role: skeleton.names[j] for role, j in roles.guess(skeleton).items()} == expected


REAL = {
    "bandai/dataset-1/dataset-1_run_normal_001.bvh": (
        "joint_Root", "Hips Spine Chest Neck Head",
        "UpperLeg_* LowerLeg_* Foot_* Toes_* Shoulder_* UpperArm_* LowerArm_* Hand_*", "LR",
    ),
    "cmu/daz_bvh/02/02_01.bvh": (
        None, "hip abdomen chest neck head", "*Thigh *Shin *Foot - *Collar *Shldr *ForeArm *Hand", "lr",
    ),
    "cmu/asfamc/02/02_01.amc": (
        None, "hips lowerback thorax lowerneck head",
        "*femur *tibia *foot *toes *clavicle *humerus *radius *hand", "lr",
    ),
    "pfnn/animations/NewCaptures10_000.bvh": (
        None, "Hips LowerBack Spine1 Neck Head",
        "*UpLeg *Leg *Foot *ToeBase *Shoulder *Arm *ForeArm *Hand", ("Left", "Right"),
    ),
    "lafan1/mirror_oracle/walk1_subject1_walk2_mirror_filtered.bvh": (
        "SimulationBone", "Hips Spine Spine2 Neck Head",
        "*UpLeg *Leg *Foot *Toe *Shoulder *Arm *ForeArm *Hand", ("Left", "Right"),
    ),
    "dog_mann/D1_010_KAN01_002.bvh": (
        None, "Hips Spine Spine1 Neck Head",
        "*UpLeg *Leg *Foot - *Shoulder *Arm *ForeArm *Hand", ("Left", "Right"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_real_skeletons(data, name):
    root, middle, sided, sides = REAL[name]
    skeleton = sources.load(data / name).skeleton
    expected = dict(zip(MIDDLE, middle.split(), strict=True)) | ({"root": root} if root else {})
    for side, mark in zip(("left", "right"), sides, strict=True):
        names = zip(SIDED, sided.split(), strict=True)
        expected |= {f"{side}_{part}": n.replace("*", mark) for part, n in names if n != "-"}
    assert {role: skeleton.names[j] for role, j in roles.guess(skeleton).items()} == expected


def nameless(skeleton: Skeleton) -> Skeleton:
    return dataclasses.replace(skeleton, names=tuple(f"b{i}" for i in range(len(skeleton))), roles={})


def test_a_rig_without_names_by_its_shape(walker):
    skeleton = walker.skeleton
    assert roles.guess(nameless(skeleton)) == {**roles.guess(skeleton)}
    swapped = dataclasses.replace(nameless(skeleton), offsets=skeleton.offsets * [-1, 1, 1])
    found = roles.guess(swapped)
    assert found["left_foot"] == skeleton.roles["right_foot"]
    assert found["left_hand"] == skeleton.roles["right_hand"]


@pytest.mark.parametrize(
    "name",
    [
        "cmu/daz_bvh/02/02_01.bvh",
        "lafan1/original_30fps/obstacles1_subject2.bvh",
        "dog_mann/D1_010_KAN01_002.bvh",
    ],
)
def test_real_rigs_without_names_by_their_shape_in_a_frame(data, name):
    clip = bvh.read(data / name)
    world, _ = kinematics.forward(clip.skeleton, clip.positions[10], clip.rotations[10])
    assert roles.guess(nameless(clip.skeleton), world) == roles.guess(clip.skeleton)


def test_shapes_that_are_no_body_do_not_fail():
    assert roles.guess(Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))) == {}
    chain = Skeleton(("a", "b", "c"), np.array([-1, 0, 1]), np.ones((3, 3)))
    assert set(roles.guess(chain)) <= set(roles.ROLES)
    camera = rig("Camera>Lens")
    assert roles.guess(camera) == {}


def test_every_role_has_its_opposite():
    assert roles.opposite("left_foot") == "right_foot" and roles.opposite("right_arm") == "left_arm"
    assert roles.opposite("chest") == "chest"
    assert {roles.opposite(role) for role in roles.ROLES} == set(roles.ROLES)


def test_overrides(tmp_path, walker):
    path = tmp_path / "roles.toml"
    path.write_text('[roles]\nleft_foot = "LeftToe"\nneck = ""\n')
    changed = roles.apply(walker.skeleton, roles.load_overrides(path))
    assert changed.role("left_foot") == walker.skeleton.index("LeftToe")
    assert "neck" not in changed.roles
    with pytest.raises(UserError, match=r"neck.*the joints are Hips, LeftUpLeg"):
        changed.role("neck")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[roles]\nleft_paw = "x"', "unknown role 'left_paw'.*left_foot"),
        ("[roles]\nleft_foot = 3", "roles.left_foot is 3"),
        ('[joints]\na = "b"', "unknown key 'joints'"),
        ("", r"no table \[roles\]"),
        ("[roles\n", "roles.toml:1: not valid TOML"),
        ("\xff", "not a text file"),
        ("a = " + "[" * 20_000, "nested too deeply"),
        ("a = " + "9" * 5_000, "not valid TOML"),
    ],
)
def test_bad_override_files(tmp_path, text, message):
    path = tmp_path / "roles.toml"
    path.write_bytes(text.encode("latin1"))
    with pytest.raises(UserError, match=message):
        roles.load_overrides(path)


def test_an_override_file_may_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "roles.toml").write_text('[roles]\nhips = "Hips"\n', "utf-8-sig")
    assert roles.load_overrides(tmp_path / "roles.toml") == {"hips": "Hips"}


def test_roles_that_exclude_each_other(walker):
    with pytest.raises(UserError, match="'LeftFoot' is told to play two roles, left_foot and right_foot"):
        roles.apply(walker.skeleton, {"left_foot": "LeftFoot", "right_foot": "LeftFoot"})
    with pytest.raises(UserError, match=r"'LeftUpLeg' \(left_leg\) is not below 'LeftLeg' \(left_up_leg\)"):
        roles.apply(walker.skeleton, {"left_up_leg": "LeftLeg", "left_leg": "LeftUpLeg"})


def test_a_chain_of_a_thousand_joints_is_no_fault():
    count = 1000
    legs = [f"{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot")]
    parents = [*range(-1, count - 1), 0, count, count + 1, 0, count + 3, count + 4]
    offsets = np.tile([0.0, 0.1, 0.0], (len(parents), 1))
    chain = Skeleton(("Hips", *(f"t{i}" for i in range(1, count)), *legs), parents, offsets)
    assert roles.guess(chain)["left_foot"] == count + 2
    assert roles.tree.Tree(chain).longest_chain(0) == list(range(count))


def test_overrides_that_do_not_exist(tmp_path, walker):
    with pytest.raises(UserError, match="cannot read"):
        roles.load_overrides(tmp_path / "none.toml")
    with pytest.raises(UserError, match=r"no joint 'Paw'.*LeftToe"):
        roles.apply(walker.skeleton, {"left_foot": "Paw"})
    with pytest.raises(UserError, match=r"unknown role 'paw'.*left_foot"):
        roles.apply(walker.skeleton, {"paw": "LeftToe"})


def crawling(clip):
    """World positions of the walker with knees, back and arms bent, so that the hands come to the ground."""
    rotations, positions = clip.rotations.copy(), clip.positions.copy()
    skeleton = clip.skeleton
    rotations[:, skeleton.index("Spine")] = quat.from_axis_angle([1.0, 0.0, 0.0], np.radians(100))
    for side in ("Left", "Right"):
        rotations[:, skeleton.index(side + "Arm")] = quat.from_axis_angle([1.0, 0.0, 0.0], -np.radians(100))
        rotations[:, skeleton.index(side + "ForeArm")] = quat.identity()
        rotations[:, skeleton.index(side + "UpLeg")] = quat.from_axis_angle([1.0, 0.0, 0.0], -1.4)
        rotations[:, skeleton.index(side + "Leg")] = quat.from_axis_angle([1.0, 0.0, 0.0], 2.6)
    return kinematics.forward(skeleton, positions, rotations)[0]


def test_who_walks_on_all_fours(walker):
    skeleton = walker.skeleton
    upright = kinematics.forward(skeleton, walker.positions, walker.rotations)[0]
    down = crawling(walker)
    assert not roles.on_all_fours(skeleton, upright)
    assert roles.on_all_fours(skeleton, down)
    # Down now and then is not.
    assert not roles.on_all_fours(skeleton, np.concatenate([upright, down[:200]]))
    no_hands = {role: j for role, j in skeleton.roles.items() if not role.endswith("hand")}
    assert not roles.on_all_fours(skeleton.with_roles(no_hands), down)


def test_animals_and_people(data):
    for folder, fours in (("dog_mann", True), ("bandai/dataset-2", False), ("cmu/asfamc", False)):
        clips = [sources.load(file) for file in sources.find(data / folder)[::12]]
        assert all(roles.on_all_fours(c.skeleton, contacts.some_positions([c])) == fours for c in clips)
