"""NPZ: whole clips without loss, everybody's keys and formats, SMPL by the model's formula, hostile files."""

import io
import json
import struct
import warnings
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import axes, bvh, kinematics, npz, quat, roles, sources, units
from motion.errors import Note, UserError
from motion.npz import archive, directions, smpl


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


@pytest.fixture
def save(tmp_path):
    """Write arrays as an NPZ file; returns its path."""

    def call(name="a.npz", **arrays):
        np.savez(tmp_path / name, **{key: np.asarray(value) for key, value in arrays.items()})
        return tmp_path / name

    return call


def plain(clip, **more):
    """A file's arrays of a clip with positions and a rest pose."""
    skeleton = clip.skeleton
    return {"fps": 60, "names": skeleton.names, "parents": skeleton.parents, "unit": "m"} | more


# Our own files


def same(a, b):
    for x, y in (
        *((a.positions, b.positions), (a.rotations, b.rotations), (a.skeleton.offsets, b.skeleton.offsets)),
        (a.skeleton.parents, b.skeleton.parents),
    ):
        np.testing.assert_array_equal(x, y)
    assert a.fps == b.fps and a.skeleton.names == b.skeleton.names
    assert json.dumps(a.skeleton.to_json()) == json.dumps(b.skeleton.to_json())


def test_a_clip_comes_back_to_the_last_bit(walker, tmp_path):
    path = tmp_path / "out" / "walk.npz"
    clip = walker.replace(fps=30000 / 1001, positions=walker.positions + np.pi * 1e-3)  # bones that move
    npz.write(path, clip)
    same(npz.read(path), clip)
    back = sources.load(path)
    same(back, clip)
    assert back.name == "walk" and back.source == path and back.unit_to_m == 1
    npz.write(tmp_path / "again.npz", back)
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
    assert sources.load(path, fps=30, unit_to_m=0.01).fps == 30


def test_roles_that_were_told_come_back(walker, tmp_path):
    told = {"hips": 3, "left_foot": 7}
    npz.write(tmp_path / "a.npz", walker.replace(skeleton=walker.skeleton.with_roles(told)))
    assert sources.load(tmp_path / "a.npz").skeleton.roles == told
    npz.write(tmp_path / "a.npz", walker.replace(skeleton=walker.skeleton.with_roles({})))
    assert sources.load(tmp_path / "a.npz").skeleton.roles == walker.skeleton.roles


@pytest.mark.parametrize("name", ["bandai/dataset-1/dataset-1_run_normal_001.bvh", "cmu/asfamc/02/02_01.amc"])
def test_real_clips(data, tmp_path, name):
    clip = sources.load(data / name)
    npz.write(tmp_path / "a.npz", clip)
    same(sources.load(tmp_path / "a.npz"), clip)


def test_other_units_and_axes(walker, tmp_path):
    there = axes.convert(walker, up="z", forward="x", handedness="left")
    npz.write(tmp_path / "a.npz", there, unit_to_m=0.0254, axes=("z", "x", "left"))
    with np.load(tmp_path / "a.npz") as found:
        np.testing.assert_allclose(found["local_positions"], there.positions / 0.0254)
    back = npz.read(tmp_path / "a.npz")
    assert back.unit_to_m == 0.0254
    np.testing.assert_allclose(world(back)[0], world(walker)[0], atol=1e-12)


def test_what_cannot_be_written(walker, tmp_path):
    holes = walker.positions.copy()
    holes[3, 2] = np.nan
    for clip in (walker.replace(positions=walker.positions[:0], rotations=walker.rotations[:0]),
                 walker.replace(positions=holes)):  # fmt: skip
        with pytest.raises(UserError, match=r"has no frames|not finite"):
            npz.write(tmp_path / "a.npz", clip)
    assert not (tmp_path / "a.npz").exists()


# Rotations of all kinds


def scipy(rotations):
    return Rotation.from_quat(np.roll(rotations.reshape(-1, 4), -1, axis=-1))


def shaped(values, rotations):
    return values.reshape(*rotations.shape[:2], *values.shape[1:])


KINDS = {
    "quaternions": lambda r: {"quats": r},
    "not unit": lambda r: {"rotations": 3 * r},
    "float32": lambda r: {"rotations": r.astype("f4")},
    "x first": lambda r: {"rotations": np.roll(r, -1, axis=-1), "rotation_format": "XYZW"},
    "axis-angle": lambda r: {"rotvec": shaped(scipy(r).as_rotvec(), r)},
    "named axis-angle": lambda r: {
        "rotations": shaped(scipy(r).as_rotvec(degrees=True), r),
        "rotation_format": "axis_angle", "angle_unit": "degrees",
    },
    "flat poses": lambda r: {"poses": scipy(r).as_rotvec().reshape(len(r), -1)},
    "euler": lambda r: {"euler": shaped(scipy(r).as_euler("ZXY"), r), "order": "zxy"},
    "euler degrees": lambda r: {
        "euler_angles": shaped(scipy(r).as_euler("YXZ", degrees=True), r),
        "euler_order": "YXZ", "angle_unit": "degrees",
    },
    "matrices": lambda r: {"rotmats": shaped(scipy(r).as_matrix(), r)},
    "columns": lambda r: {
        "rot6d": shaped(np.swapaxes(scipy(r).as_matrix()[..., :2], 1, 2).reshape(-1, 6), r),
    },
    "rows": lambda r: {
        "rotations": shaped(scipy(r).as_matrix()[:, :2].reshape(-1, 6), r), "rotation_format": "6d_rows",
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore:Gimbal lock")
def test_formats_of_rotations(walker, save, kind):
    found = KINDS[kind](walker.rotations)
    clip = npz.read(
        save(**plain(walker), offsets=walker.skeleton.offsets, trans=walker.positions[:, 0], **found)
    )
    assert quat.angle_between(clip.rotations, walker.rotations).max() < (1e-6 if kind == "float32" else 1e-9)
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-6)
    assert (np.sum(clip.rotations[1:] * clip.rotations[:-1], axis=-1) >= 0).all()


@pytest.mark.parametrize(
    "places",
    [
        lambda c, w: {"offsets": c.skeleton.offsets, "root_pos": c.positions[:, 0]},
        lambda c, w: {"rest_positions": bind(c.skeleton), "transl": c.positions[:, 0]},
        lambda c, w: {"J": bind(c.skeleton), "trans": c.positions[:, 0]},
        lambda c, w: {"local_positions": c.positions},
        lambda c, w: {"positions": w},
        lambda c, w: {"joints": w, "offsets": c.skeleton.offsets},
    ],
)
@pytest.mark.parametrize("in_world", [False, True])
def test_places_of_joints(walker, save, places, in_world):
    where, turns = world(walker)
    rotations = {"global_rotations": turns} if in_world else {"rotations": walker.rotations}
    clip = npz.read(save(**plain(walker), **rotations, **places(walker, where)))
    np.testing.assert_allclose(world(clip)[0], where, atol=1e-9)
    assert quat.angle_between(clip.rotations, walker.rotations).max() < 1e-9
    np.testing.assert_allclose(clip.skeleton.offsets[1:], walker.skeleton.offsets[1:], atol=1e-9)


def bind(skeleton):
    return kinematics.forward(skeleton, skeleton.offsets.copy(), quat.identity(len(skeleton)))[0]


# Hierarchies, rates, units, axes


@pytest.mark.parametrize("root", [-1, "itself", 2**32 - 1])
def test_joints_in_any_order(walker, save, root):
    order = np.random.default_rng(9).permutation(len(walker.skeleton))
    place = np.argsort(order)
    above = place[np.maximum(walker.skeleton.parents, 0)][order]
    top = int(place[0])
    above[top] = top if root == "itself" else root
    names = np.array(walker.skeleton.names)[order]
    turns, offsets = walker.rotations[:, order], walker.skeleton.offsets[order]
    found = {"rotations": turns, "offsets": offsets, "trans": walker.positions[:, 0]}
    clip = npz.read(save(fps=60, joint_names=names, kintree_table=np.stack([above, order]), **found))
    joints = [clip.skeleton.index(name) for name in walker.skeleton.names]
    np.testing.assert_allclose(world(clip)[0][:, joints], world(walker)[0], atol=1e-9)


@pytest.mark.parametrize(
    ("given", "fps"),
    [
        ({"mocap_framerate": 120.0}, 120),
        ({"FPS": [25]}, 25),
        ({"frame_time": 0.033333}, 30),
        ({"dt": 1 / 60}, 60),
    ],
)
def test_frame_rates(walker, save, given, fps):
    path = save(parents=walker.skeleton.parents, positions=world(walker)[0], **given)
    assert npz.read(path).fps == pytest.approx(fps, abs=1e-9)
    assert npz.read(path, fps=50).fps == 50 and sources.load(path, fps=50).fps == 50


def test_a_rate_may_be_given_where_the_file_has_none(walker, save):
    path = save(parents=walker.skeleton.parents, positions=world(walker)[0])
    assert sources.load(path, fps=24).fps == 24
    with pytest.raises(UserError, match=r"no frame rate; the file has parents .*; add the key fps, or give"):
        npz.read(path)


@pytest.mark.parametrize("said", [{}, {"unit": "cm"}, {"unit_to_m": 0.01}])
def test_units(walker, save, said):
    given = {"fps": 60, "names": walker.skeleton.names, "parents": walker.skeleton.parents}
    clip = npz.read(save(**given, positions=100 * world(walker)[0], **said))
    assert clip.unit_to_m == units.UNITS["centimetre"]
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-9)


def test_z_up_and_left_handed_files(walker, save):
    there = axes.convert(walker, up="z", forward="x", handedness="left")
    found = {"up": "Z", "forward": "x", "handedness": "left", "positions": world(there)[0]}
    clip = npz.read(save(**plain(walker), **found))
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-9)
    z_up = npz.read(
        save(**plain(walker), up="z", positions=world(axes.convert(walker, up="z", forward="-y"))[0])
    )
    np.testing.assert_allclose(world(z_up)[0], world(walker)[0], atol=1e-9)


# Rotations from places


def test_places_alone(walker, save):
    clip = sources.load(save(**plain(walker), positions=world(walker)[0]))
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-9)
    assert clip.skeleton.roles == walker.skeleton.roles
    lengths = np.linalg.norm(walker.skeleton.offsets[1:], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(clip.skeleton.offsets[1:], axis=-1), lengths, atol=1e-9)
    middle = len(clip) // 2  # the rest pose
    assert quat.angle_between(clip.rotations[middle], quat.identity(1)).max() < 1e-6
    np.testing.assert_allclose(
        np.delete(clip.positions, 0, 1), clip.skeleton.offsets[None, 1:].repeat(len(clip), 0), atol=1e-6
    )


def test_rotations_turn_bones_to_where_they_point(walker):
    """What is known without twists: with the true rest pose, hips and chest whole, limbs to their bones."""
    where, turns = world(walker)
    _, found = directions.recover(walker.skeleton, where)
    _, recovered = kinematics.forward(walker.skeleton, walker.positions, found)
    for name in ("Hips", "Spine2"):  # bones in several directions
        j = walker.skeleton.index(name)
        assert quat.angle_between(recovered[:, j], turns[:, j]).max() < 1e-6
    for j, parent in enumerate(walker.skeleton.parents.tolist()):
        if parent >= 0:
            bone = np.broadcast_to(walker.skeleton.offsets[j], where[:, j].shape)
            np.testing.assert_allclose(
                quat.rotate(recovered[:, parent], bone), where[:, j] - where[:, parent], atol=1e-6
            )
    for side in ("Left", "Right"):  # knees and elbows only bend, so least twist is the truth there
        j = walker.skeleton.index(f"{side}Leg")
        angles = quat.angle_between(found[:, j], quat.identity(1))
        np.testing.assert_allclose(
            angles, quat.angle_between(walker.rotations[:, j], quat.identity(1)), atol=1e-6
        )


def test_bones_without_length_and_bodies_that_vanish(walker, save):
    where = world(walker)[0]
    where[100] = where[100, :1]  # all joints in one place
    where[:, 4] = where[:, 3]
    clip = npz.read(save(**plain(walker), positions=where))
    np.testing.assert_allclose(world(clip)[0], where, atol=1e-9)


# SMPL

TO_SMPL = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2",
    "neck": "Neck", "head": "Head",
} | {
    f"{side}_{part}": f"{side.title()}{theirs}"
    for side in ("left", "right")
    for part, theirs in {
        "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "Toe",
        "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    }.items()
}  # fmt: skip
Z_UP = Rotation.from_euler("x", 90, degrees=True)  # from our axes to AMASS's


def amass(clip, count=22):
    """A clip of SMPL's joints under other names as AMASS has it: poses [T, 3 J] and trans, Z up."""
    names = smpl.LAYOUTS[count]
    joints = [clip.skeleton.index(TO_SMPL[name]) for name in names[:22]]
    turns = scipy(clip.rotations[:, joints]).as_rotvec().reshape(len(clip), -1)
    turns[:, :3] = (Z_UP * Rotation.from_rotvec(turns[:, :3])).as_rotvec()
    poses = np.concatenate([turns, np.zeros((len(clip), 3 * (count - 22)))], axis=1)
    return joints, {"poses": poses, "trans": Z_UP.apply(clip.positions[:, 0]), "mocap_framerate": clip.fps}


@pytest.mark.parametrize("count", smpl.LAYOUTS)
def test_roles_and_hierarchies(count):
    names = smpl.LAYOUTS[count]
    skeleton = smpl.rest(names, 1.7)
    assert skeleton.names == names and len(set(names)) == count
    found = {role: names[j] for role, j in roles.guess(skeleton).items()}
    expected = {"hips": "pelvis", "spine": "spine1", "chest": "spine3", "neck": "neck", "head": "head"}
    parts = dict(up_leg="hip", leg="knee", foot="ankle", toe="foot", shoulder="collar", arm="shoulder",
                 forearm="elbow", hand="wrist")  # fmt: skip
    expected |= {f"{s}_{role}": f"{s}_{part}" for s in ("left", "right") for role, part in parts.items()}
    assert found == expected
    place = bind(skeleton)
    assert place[names.index("left_knee"), 0] > 0  # the left is +X
    mirrored = [
        names.index(n.replace("left", "?").replace("right", "left").replace("?", "right")) for n in names
    ]
    np.testing.assert_allclose(place[mirrored], place * [-1, 1, 1], atol=1e-12)
    if count > 50:
        chain = skeleton.chain(names.index("left_pinky3"), names.index("left_wrist"))
        assert [names[j] for j in chain] == ["left_wrist", "left_pinky1", "left_pinky2", "left_pinky3"]


def test_the_number_of_joints_names_the_model():
    assert [len(names) for names in smpl.LAYOUTS.values()] == list(smpl.LAYOUTS)
    assert smpl.LAYOUTS[52][22] == "left_index1" and smpl.LAYOUTS[52][37] == "right_index1"
    assert smpl.LAYOUTS[55][22:25] == ("jaw", "left_eye", "right_eye")


@pytest.mark.parametrize("lent", ["in the file", "beside", "above", "a clip beside"])
def test_poses_with_a_rest_pose_put_joints_where_the_model_does(walker, save, tmp_path, lent):
    joints, found = amass(walker)
    rest = bind(walker.skeleton)[joints] + [0.01, -0.25, 0.03]  # the model's origin is not the pelvis
    found["trans"] = found["trans"] - rest[0]
    folder = tmp_path if lent != "above" else tmp_path / "CMU" / "01"
    folder.mkdir(parents=True, exist_ok=True)
    if lent == "a clip beside":
        skeleton = replace(
            walker.skeleton, names=tuple({v: k for k, v in TO_SMPL.items()}[n] for n in walker.skeleton.names)
        )
        npz.write(tmp_path / "skeleton.npz", walker.replace(skeleton=skeleton))
        found["trans"] = found["trans"] + rest[0]  # bones alone do not say where the model has the pelvis
    elif lent != "in the file":
        save("skeleton.npz", J=rest)
    path = folder / "01_01_poses.npz"
    np.savez(path, **found, **({"joints": rest} if lent == "in the file" else {}))
    clip = sources.load(path)
    assert clip.fps == 60 and clip.unit_to_m == 1 and clip.skeleton.names == smpl.LAYOUTS[22]
    np.testing.assert_allclose(world(clip)[0], world(walker)[0][:, joints], atol=1e-9)
    bones = quat.angle_between(clip.rotations, walker.rotations[:, joints])  # the body's frames stand Y up
    assert bones.max() < 1e-6
    assert {p.name for p in sources.inputs(folder)} >= (
        {path.name} if lent == "in the file" else {path.name, "skeleton.npz"}
    )


def test_the_model_s_formula(save):
    """Random poses of SMPL-H by matrices: x_j = x_p + R_p (J_j - J_p), x_0 = trans + J_0."""
    rng, names = np.random.default_rng(11), smpl.LAYOUTS[52]
    rest, above = rng.normal(size=(52, 3)), smpl.parents(names)
    poses, trans = rng.normal(size=(20, 52, 3)), rng.normal(size=(20, 3))
    matrices = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(20, 52, 3, 3)
    places, turns = np.empty((20, 52, 3)), np.empty_like(matrices)
    for j in range(52):
        p = above[j]
        turns[:, j] = matrices[:, j] if p < 0 else turns[:, p] @ matrices[:, j]
        places[:, j] = trans + rest[0] if p < 0 else places[:, p] + turns[:, p] @ (rest[j] - rest[p])
    clip = npz.read(save(poses=poses.reshape(20, -1), trans=trans, mocap_frame_rate=120.0, J=rest, up="z"))
    np.testing.assert_allclose(
        world(clip)[0], Z_UP.inv().apply(places.reshape(-1, 3)).reshape(20, 52, 3), atol=1e-9
    )


def test_a_real_clip_as_axis_angles(data, save):
    clip = bvh.read(data / "lafan1/original_30fps/obstacles1_subject2.bvh", unit_to_m=0.01)
    clip = clip.replace(positions=clip.positions[:600], rotations=clip.rotations[:600])
    joints, found = amass(clip)
    read = npz.read(save(**found, offsets=clip.skeleton.offsets[joints], up="z"))
    # Its bones are 1 mm longer or shorter in some frames, which rotations alone do not show.
    np.testing.assert_allclose(world(read)[0], world(clip)[0][:, joints], atol=5e-3)
    assert read.fps == 30


@pytest.mark.parametrize("count", smpl.LAYOUTS)
@pytest.mark.parametrize("apart", ["", "amass", "smplx"])
def test_layouts_and_parts(walker, save, count, apart):
    joints, found = amass(walker, count)
    rest = np.concatenate([bind(walker.skeleton)[joints], np.zeros((count - 22, 3))])
    found["trans"] -= rest[0]
    poses = found["poses"]
    if apart:
        found.pop("poses")
        body, face, hands = poses[:, 3:66], poses[:, 66:-90], poses[:, -90:]
        names = {
            "amass": ("root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand"),
            "smplx": ("global_orient", "body_pose", "jaw_pose", "leye_pose", "left_hand_pose"),
        }[apart]
        if count == 24:
            body = poses[:, 3:]
        parts = [poses[:, :3], body] + ([face[:, :3], face[:, 3:], hands] if count == 55 else [])
        found |= dict(zip(names, parts, strict=False)) | ({names[-1]: hands} if count == 52 else {})
        if apart == "smplx":
            found["transl"] = found.pop("trans")
    clip = npz.read(save(**found, J=rest))
    assert clip.skeleton.names == smpl.LAYOUTS[count]
    np.testing.assert_allclose(world(clip)[0][:, :22], world(walker)[0][:, joints], atol=1e-9)


def test_files_with_y_up_are_told_by_the_body(walker, save):
    joints, found = amass(walker)
    turns = Z_UP.inv() * Rotation.from_rotvec(found["poses"][:, :3])
    found["poses"][:, :3], found["trans"] = turns.as_rotvec(), walker.positions[:, 0]
    offsets = walker.skeleton.offsets[joints]
    np.testing.assert_allclose(
        world(npz.read(save(**found, offsets=offsets)))[0], world(walker)[0][:, joints], atol=1e-9
    )


@pytest.mark.parametrize("stature", [1.55, 1.7, 1.95])
def test_without_a_rest_pose_the_stature_is_that_at_which_feet_stand(walker, save, stature):
    names = smpl.LAYOUTS[22]
    joints, found = amass(walker)
    truth = smpl.rest(names, stature)
    # The walker's turns on another body: put its feet on the ground.
    positions = np.repeat(truth.offsets[None], len(walker), axis=0)
    positions[:, 0] = walker.positions[:, 0] * [1, 0, 1]
    where = kinematics.forward(truth, positions, walker.rotations[:, joints])[0]
    feet = [
        [names.index(f"{s}_{p}"), h] for p, h in (("ankle", 0.039), ("foot", 0.01)) for s in ("left", "right")
    ]
    lift = -np.min([where[:, int(j), 1] - h * stature for j, h in feet], axis=0)
    found["trans"] = Z_UP.apply(positions[:, 0] + lift[:, None] * [0, 1, 0])
    with pytest.warns(Note, match="skeleton.npz with the body model's joints"):
        clip = sources.load(save(**found))
    np.testing.assert_allclose(clip.skeleton.offsets, truth.offsets, atol=0.02 * stature)
    assert clip.skeleton.roles["left_toe"] == names.index("left_foot")
    assert abs(np.percentile(world(clip)[0][:, names.index("left_foot"), 1], 5)) < 0.04


def test_a_clip_that_does_not_show_the_stature(save):
    poses, trans = np.zeros((5, 156)), np.full((5, 3), 7.0)
    with pytest.warns(Note):
        clip = npz.read(save(poses=poses, trans=trans, mocap_framerate=60.0))
    np.testing.assert_allclose(clip.skeleton.offsets, smpl.rest(smpl.LAYOUTS[52], 1.7).offsets)


def test_the_stature_s_proportions():
    """Winter's figure 4.1: heights of joints over the ground and lengths of segments, in statures."""
    skeleton = smpl.rest(smpl.LAYOUTS[24], 1.0)
    place = bind(skeleton)
    height = {
        name: place[j, 1] - place[skeleton.index("left_ankle"), 1] + 0.039
        for j, name in enumerate(skeleton.names)
    }
    for name, expected in {"left_hip": 0.530, "left_knee": 0.285, "left_shoulder": 0.818}.items():
        assert height[name] == pytest.approx(expected)
    for name, expected in {"left_elbow": 0.186, "right_wrist": 0.146}.items():
        assert np.linalg.norm(skeleton.offsets[skeleton.index(name)]) == pytest.approx(expected)


def test_shapes_and_lent_skeletons_are_no_clips(save, tmp_path, walker):
    save("shape.npz", betas=np.zeros(16), gender="male")
    save("male_stagei.npz", betas=np.zeros(16))
    save("skeleton.npz", J=np.zeros((52, 3)))
    save("walk.npz", **plain(walker), positions=world(walker)[0])
    assert sources.find(tmp_path) == [tmp_path / "walk.npz"]
    with pytest.raises(UserError, match="a shape or rest pose, not a motion"):
        sources.load(tmp_path / "shape.npz")


# Bad input

GOOD = {
    "fps": 30.0,
    "names": ["a", "b", "c"],
    "parents": [-1, 0, 1],
    "positions": np.arange(36.0).reshape(4, 3, 3),
}
TURNS = {"fps": 30.0, "parents": [-1, 0, 1], "rotations": np.tile([1.0, 0, 0, 0], (4, 3, 1)),
         "offsets": np.ones((3, 3)), "trans": np.zeros((4, 3))}  # fmt: skip
SMPL = {"poses": np.zeros((4, 156)), "trans": np.zeros((4, 3)), "mocap_framerate": 60.0}
NAN = np.where(np.arange(36).reshape(4, 3, 3) == 20, np.nan, 1.0)
FAULTS = {
    "nothing to tell": ({"x": [1.0], "fps": 30}, "the file has x [1] float64, fps int64; needed"),
    "no rate": ({**GOOD, "fps": None}, "no frame rate"),
    "rates": ({**GOOD, "fps": [30, 60]}, "fps is [30.0, 60.0]; give one positive number"),
    "rate 0": ({**GOOD, "fps": 0}, "fps is"),
    "rate nan": ({**GOOD, "fps": np.nan}, "fps has a value that is no finite number"),
    "no hierarchy": ({**GOOD, "parents": None}, "no motion that can be told"),
    "ring": ({**GOOD, "parents": [-1, 2, 1]}, "parents: joints hang on one another in a ring"),
    "all in a ring": ({**GOOD, "parents": [2, 0, 1]}, "in a ring"),
    "two roots": ({**GOOD, "parents": [-1, -1, 1]}, "parents: it has several roots"),
    "beyond": ({**GOOD, "parents": [-1, 0, 3]}, "parents: joint 2 hangs on joint 3, of 3"),
    "below": ({**GOOD, "parents": [-1, 0, -2]}, "parents: joint 2 hangs on joint -2, of 3"),
    "fractions": ({**GOOD, "parents": [-1, 0, 0.5]}, "expected 1 to 1000 whole numbers"),
    "many": ({**GOOD, "parents": np.arange(1001) - 1}, "expected 1 to 1000 whole numbers"),
    "names": ({**GOOD, "names": ["a", "b"]}, "names has 2 names for 3 joints"),
    "shape": ({**GOOD, "positions": np.zeros((4, 3, 2))}, "is [4, 3, 2] float64, expected [T, 3, 3]"),
    "flat": ({**GOOD, "positions": np.zeros(36)}, "positions is [36] float64, expected [T, 3, 3]"),
    "no frames": ({**GOOD, "positions": np.zeros((0, 3, 3))}, "arrays of 0 frames"),
    "nan": ({**GOOD, "positions": NAN}, "positions has a value that is no finite number in frame 3: nan"),
    "infinite": ({**GOOD, "positions": np.full((4, 3, 3), np.inf)}, "no finite number in frame 1: inf"),
    "strings": ({**GOOD, "positions": np.full((4, 3, 3), "1")}, "positions holds <U1, expected numbers"),
    "complex": ({**GOOD, "positions": np.zeros((4, 3, 3), complex)}, "positions is of type complex128"),
    "objects": ({**GOOD, "positions": np.full((4, 3, 3), None)}, "positions is of type object, which is not"),
    "unit": ({**GOOD, "unit": "parsec"}, "unit is 'parsec'; choose m, cm, mm, inch, foot"),
    "metres": ({**GOOD, "unit_to_m": -1}, "unit_to_m is no positive number"),
    "axes": ({**GOOD, "up": "z", "forward": "-z"}, "lie along one axis"),
    "up": ({**GOOD, "up": "north"}, "up is 'north'; choose x, y, z"),
    "roles": ({**GOOD, "roles": ["hip"], "role_joints": [0]}, "roles and role_joints do not"),
    "role's joint": ({**GOOD, "roles": ["hips"], "role_joints": [3]}, "role_joints names joints that the"),
    "ends": ({**GOOD, "end_site_joints": [1], "end_site_offsets": np.zeros((2, 3))}, "expected [1, 3]"),
    "no root": ({**TURNS, "trans": None}, "rotations, but no root positions"),
    "no rest": ({**TURNS, "offsets": None}, "rotations, but no rest pose"),
    "lengths": ({**TURNS, "trans": np.zeros((5, 3))}, "arrays of 4, 5 frames"),
    "zero": ({**TURNS, "rotations": np.zeros((4, 3, 4))}, "a quaternion has no length"),
    "joints": ({**TURNS, "rotations": np.ones((4, 2, 4))}, "expected one rotation for each of 3 joints"),
    "unknown form": ({**TURNS, "rotations": np.ones((4, 3, 3))}, "name it in rotation_format"),
    "form": ({**TURNS, "rotation_format": "lie"}, "rotation_format is 'lie'; choose quaternion"),
    "other form": ({**TURNS, "rotation_format": "euler"}, "expected [3] numbers a joint for"),
    "euler order": ({**TURNS, "rotations": None, "euler": np.zeros((4, 3, 3))}, "angles need a euler_order"),
    "no matrix": ({**TURNS, "rotations": np.ones((4, 3, 3, 3))}, "matrices that are no rotations"),
    "no plane": ({**TURNS, "rotations": np.zeros((4, 3, 6))}, "six numbers that span no plane"),
    "smpl root": ({**SMPL, "trans": None}, "no root positions"),
    "smpl frames": ({**SMPL, "trans": np.zeros((5, 3))}, "trans is [5, 3] float64, expected [4, 3]"),
    "smpl empty": ({**SMPL, "poses": np.zeros((0, 156))}, "no frames"),
    "smpl rest": ({**SMPL, "J": np.zeros((22, 3))}, "its rest pose lacks some of the 52 joints"),
    "smpl width": ({**SMPL, "poses": np.zeros((4, 100))}, "no motion that can be told"),
    "smpl parts": ({**SMPL, "poses": None, "root_orient": np.zeros((4, 3)), "pose_body": np.zeros((3, 63))},
                   "pose_body is [3, 63] float64, expected [frames, 3 joints]"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults(save, fault):
    arrays, message = FAULTS[fault]
    path = save(**{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(UserError) as error:
        npz.read(path)
    assert message in f"{error.value.what}; {error.value.remedy}"
    assert error.value.path == str(path) and error.value.remedy


def test_what_the_faults_are_made_from_is_good(save):
    assert len(npz.read(save(**GOOD))) == len(npz.read(save(**TURNS))) == 4
    with pytest.warns(Note):
        assert len(npz.read(save(**SMPL))) == 4


def header(shape, dtype="<f8"):
    text = repr({"descr": dtype, "fortran_order": False, "shape": shape}).encode()
    text += b" " * (-(10 + len(text) + 1) % 64) + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text


def member(path, **blocks):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for key, block in blocks.items():
            out.writestr(f"{key}.npy", block)


def array(value):
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.asarray(value))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (header((10**6, 3, 3)), "positions is said to be [1000000, 3, 3] float64, but has"),
        (header((10**15, 3, 3)), "GiB; at most 1 GiB are read"),
        (header((-4, 3, 3)), "positions has the shape [-4, 3, 3]"),
        (header((4, 3, 3)) + b"\0" * 100, "but has"),
        (header((4, 3, 3), "|O") + b"\0" * 288, "positions is of type object, which is not read"),
        (b"\x93NUMPY\x09\0", "not an NPZ file, or cut short"),
        (b"no array", "not an NPZ file, or cut short"),
        (header("__import__('os')"), "not an NPZ file, or cut short"),
    ],
)
def test_headers_that_lie(tmp_path, positions, message):
    path = tmp_path / "a.npz"
    member(path, fps=array(30.0), parents=array([-1, 0, 1]), positions=positions)
    with pytest.raises(UserError) as error:
        npz.read(path)
    assert message in str(error.value)


def test_a_bomb_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_BYTES", 1 << 20)
    frames = 100_000
    block = header((frames, 3, 3)) + b"\0" * (72 * frames)
    member(tmp_path / "a.npz", fps=array(30.0), parents=array([-1, 0, 1]), positions=block)
    assert (tmp_path / "a.npz").stat().st_size < 20_000
    with pytest.raises(UserError, match="positions is said to be"):
        npz.read(tmp_path / "a.npz")


def test_a_pickle_is_never_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("unpickled",))

    np.savez(tmp_path / "a.npz", fps=30.0, parents=[-1, 0, 1], positions=np.full((1, 3, 3), Trap()))
    with pytest.raises(UserError, match="Python objects in files may run any program"):
        npz.read(tmp_path / "a.npz")


@pytest.mark.parametrize("content", [b"", b"PK", b"\x93NUMPY", b"x" * 1000])
def test_files_that_are_none(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(UserError, match="not an NPZ file, or cut short"):
        npz.read(tmp_path / "a.npz")


@pytest.mark.parametrize("deflated", [False, True])
def test_any_damage_is_a_user_error_or_reads(walker, tmp_path, deflated):
    short = walker.replace(positions=walker.positions[:5], rotations=walker.rotations[:5])
    npz.write(tmp_path / "a.npz", short)
    if deflated:
        with np.load(tmp_path / "a.npz") as found:
            np.savez_compressed(tmp_path / "a.npz", **found)
    content = np.frombuffer((tmp_path / "a.npz").read_bytes(), np.uint8)
    rng, outcomes = np.random.default_rng(12), set()
    for i in range(200):
        damaged = content.copy()
        damaged[rng.integers(0, len(content), rng.integers(1, 4))] = rng.integers(0, 256)
        (tmp_path / "b.npz").write_bytes(
            damaged[: rng.integers(1, len(content)) if i % 8 == 0 else None].tobytes()
        )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", Note)
                clip = npz.read(tmp_path / "b.npz")
            assert np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()
            outcomes.add("read")
        except UserError as error:
            assert error.path == str(tmp_path / "b.npz")
            outcomes.add("refused")
    assert "refused" in outcomes
